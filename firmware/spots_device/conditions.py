"""What a reading is taken with, and what a calibration is valid for."""


class Conditions:
    """Board, channel plan, gain, exposure and LED current. Compared by value; never changed.

    Parameters
    ----------
    board : str
        Unique id.
    plan : sequence of str
        Diodes of ADC 0 to 5.
    gain : int
        Register code, 0 to 10.
    exposure_us, led_mA : int
    """

    def __init__(self, board, plan, gain, exposure_us, led_mA):
        self.board = board
        self.plan = tuple(plan)
        self.gain = gain
        self.exposure_us = exposure_us
        self.led_mA = led_mA

    def __eq__(self, other):
        return isinstance(other, Conditions) and self._values() == other._values()

    def __hash__(self):
        return hash(self._values())

    def _values(self):
        return self.board, self.plan, self.gain, self.exposure_us, self.led_mA
