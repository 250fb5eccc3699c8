"""Which layers of a layout are on."""

from .layout import LAYERS_MAX, MOMENTARY, TO, TOGGLE


class Layers:
    """Layers that keys hold, and layers that stay on."""

    def __init__(self):
        self._held = bytearray(LAYERS_MAX)  # switches that hold each layer
        self.clear()

    def clear(self, on=0):
        """Switch all layers off, but those of the bits `on`."""
        self._on = on
        for number in range(LAYERS_MAX):
            self._held[number] = 0

    def top(self):
        """Return the number of the layer that the next press uses."""
        layer = LAYERS_MAX - 1
        while layer:
            if self._on >> layer & 1 or self._held[layer]:
                return layer
            layer -= 1
        return 0

    def press(self, kind, number):
        """Press an action of the kind `MOMENTARY`, `TOGGLE` or `TO`."""
        if kind == MOMENTARY:
            self.hold(number, 1)
        elif kind == TOGGLE:
            self._on ^= 1 << number
        elif kind == TO:
            self.clear(1 << number)

    def hold(self, number, change):
        """Change by `change` how many holders a layer has."""
        self._held[number] = max(0, self._held[number] + change)
