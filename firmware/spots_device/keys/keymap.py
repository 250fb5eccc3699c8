"""A layout of keys in use: keys, layers, behaviours and limits."""


class KeyMap:
    """A validated layout, made by `layout.parse`.

    Each statement of `layout.LIMITS` is an attribute. Durations are in ticks (see tracker.py), and
    the names of their attributes end in ``_t`` instead of ``_ms``.

    Attributes
    ----------
    keys : array of int
        `KEY_SIZE` integers for each key. The row of a key is the index of its first integer.
    behaviours : array of int
        Kind and numbers of all behaviours; `behaviour` returns where one begins. Times are in
        ticks.
    steps : array of int
        Steps of all texts.
    kinds : tuple of int
        Kinds of all behaviours.
    moves : bool
        Whether there are slides or swipes.
    pages : tuple of int
        Kinds of all actions that press something, see `layout.KEYBOARD`.
    """

    def first(self, layer):
        """Return the row (index in `keys`) of a layer's first key.

        If ``layer == layers``, return the length of `keys`.
        """
        return self._firsts[layer]

    def is_on(self, layer, row):
        """Return whether the key whose first integer is ``keys[row]`` belongs to `layer`."""
        return self._firsts[layer] <= row < self._firsts[layer + 1]

    def behaviour(self, number):
        """Return the index in `behaviours` of a behaviour's kind; its numbers follow."""
        return self._begins[number]

    def swipe(self, layer, plus):
        """Return a layer's action for a swipe; `plus` is True for a swipe away from the sensor."""
        return self._swipes[2 * layer + (1 if plus else 0)]
