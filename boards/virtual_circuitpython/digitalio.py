"""`digitalio` of the virtual board. While its button is pressed, every input is low."""

import os

import _protocol
import _simulator


class Pull:
    UP = "up"
    DOWN = "down"


class DriveMode:
    PUSH_PULL = "push_pull"
    OPEN_DRAIN = "open_drain"


class DigitalInOut:
    def __init__(self, pin):
        if pin.taken:
            raise ValueError("pin in use")
        self._pin = pin
        self._level = False

    @property
    def value(self):
        wire = self._pin.wire
        if wire is None or wire >= _simulator.STRIP_LED or wire % _simulator.WIRES == 0:
            return self._level
        return bool(_simulator.sda(wire // _simulator.WIRES))

    @value.setter
    def value(self, level):
        self._level = level
        if self._pin.wire >= _simulator.STRIP_LED:
            bus = _protocol.SECOND_BUS * (self._pin.wire - _simulator.STRIP_LED)
            _simulator.call(_protocol.LIGHT, bus | (1 if level else 0), 0, 0)
        else:
            _simulator.set_wire(self._pin.wire, level)

    def deinit(self):
        pass

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.deinit()

    def switch_to_input(self, pull=None):
        self._level = pull == Pull.UP and os.getenv("SPOTS_BUTTON") != "held"

    def switch_to_output(self, value=False, drive_mode=DriveMode.PUSH_PULL):
        if self._pin.wire >= _simulator.STRIP_LED:
            self._pin.taken = True
        elif drive_mode != DriveMode.OPEN_DRAIN:
            raise NotImplementedError("a wire of the I2C bus must be open-drain")
        self.value = value
