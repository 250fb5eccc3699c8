"""Key repeat: presses the last key again. Imported only if the layout uses it."""


class Repeat:
    """The key repeat of an `engine.Engine`."""

    def __init__(self, engine):
        self._engine = engine
        self._last = 0

    def pressed(self, action):
        """Remember a pressed key with all modifiers that are down."""
        self._last = action

    def press(self, i, t):
        """Press the last key with the switch `i`."""
        self._engine.then(i, self._last, t)
