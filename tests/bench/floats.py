"""Computes a reading with floats, in MicroPython, for comparison with the firmware's integers.

This module uses the same registers and calibration as the firmware, and is written as most makers
write such scripts. It does not check that the spectrum fits one press. A touch begins and ends at
the same force, and its data has no checksum.
"""

import json
import math
import struct

from spots_device.reading import decode
from spots_device.reading.calibration import Calibration
from spots_device.reading.calibration_lines import ONE_Q13

_STATUS = 0x93
_CLEAR = b"\x93\x08"
_LN_2 = math.log(2)
_Q20 = float(1 << 20)


class FloatPath:
    """Reads the sensor's registers, computes a reading with floats, and sends it.

    Parameters
    ----------
    lines : sequence of str
        Lines of the calibration, see `spots_device.reading.calibration_lines`.
    dark : sequence of float
        Dark counts of the six channels.
    bus, clock, serial : object
        Substitutes from the module `canned`.
    """

    def __init__(self, lines, dark, bus, clock, serial):
        calibration = Calibration(lines)
        self._dark = dark
        self._bus = bus
        self._clock = clock
        self._serial = serial
        self._raw = bytearray(14)
        tables = memoryview(calibration.tables)
        segments = [decode.BOUNDS + 2 * i for i in range(tables[decode.SEGMENTS])]
        self._coarse = _weights(tables[decode.WEIGHTS : decode.WEIGHTS + 6])
        self._bounds = _logs([tables[at] for at in segments])
        self._segments = [_segment(tables, tables[at + 1]) for at in segments]
        self._brightnesses = _logs(calibration.brightnesses)
        self._forces_mN = calibration.forces_mN
        self._touch_mN = calibration.touch_on_mN

    def read(self):
        """Return the six counts of the chip's newest sample."""
        self._bus.read_into(0x39, _STATUS, self._raw)
        self._bus.write(_CLEAR)
        return struct.unpack_from("<6H", self._raw, 2)

    def estimate(self, counts):
        """Compute a reading.

        Returns (time s, contrast, brightness, position mm, force N, touching); contrast and
        brightness are in log2 units.
        """
        logs = [math.log(count - dark) / _LN_2 for count, dark in zip(counts, self._dark)]
        i = len(self._bounds) - 1
        coarse = _dot(self._coarse, logs)
        while i > 0 and coarse < self._bounds[i]:
            i -= 1
        position, force, contrasts, positions_um, offsets = self._segments[i]
        contrast = _dot(position, logs)
        brightness = _dot(force, logs) - _interpolate(contrasts, offsets, contrast)
        force_mN = _interpolate(self._brightnesses, self._forces_mN, brightness)
        return (
            self._clock.ticks_us() / 1e6,
            contrast,
            brightness,
            _interpolate(contrasts, positions_um, contrast) / 1000,
            force_mN / 1000,
            force_mN >= self._touch_mN,
        )

    def send_json(self, counts):
        """Send a reading as a line of JSON."""
        time_s, contrast, brightness, position_mm, force_N, touching = self.estimate(counts)
        reading = {
            "time_s": round(time_s, 6),
            "contrast": round(contrast, 5),
            "brightness": round(brightness, 5),
            "position_mm": round(position_mm, 3),
            "force_N": round(force_N, 3),
            "touching": touching,
        }
        line = (json.dumps(reading) + "\n").encode()
        self._serial.write(line, len(line))

    def send_struct(self, counts):
        """Send a reading as five floats and a flag, without frame and checksum."""
        data = struct.pack("<5fB", *self.estimate(counts))
        self._serial.write(data, len(data))


def _segment(tables, place):
    position, force = tables[place : place + 6], tables[place + 6 : place + 12]
    contrasts, positions_um, _, offsets = decode.columns_of(tables, place + 12, 4)
    return _weights(position), _weights(force), _logs(contrasts), positions_um, _logs(offsets)


def _weights(integers):
    return [weight / ONE_Q13 for weight in integers]


def _logs(integers):
    return [log / _Q20 for log in integers]


def _dot(weights, logs):
    return sum(weight * log for weight, log in zip(weights, logs))


def _interpolate(xs, ys, x):
    i = 0
    while i < len(xs) - 2 and x >= xs[i + 1]:
        i += 1
    share = (x - xs[i]) / (xs[i + 1] - xs[i])
    return ys[i] + min(max(share, 0.0), 1.0) * (ys[i + 1] - ys[i])
