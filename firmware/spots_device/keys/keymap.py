"""A layout of keys in use: keys, layers, behaviours and limits."""


class KeyMap:
    """A validated layout, made by `layout.parse`.

    Each statement of `layout.LIMITS` is an attribute; a duration is in ticks (see tracker.py), and
    ends in ``_t`` instead of ``_ms``. `keys` has `KEY_SIZE` integers for each key, and a key's row
    is the index of its first one.
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
