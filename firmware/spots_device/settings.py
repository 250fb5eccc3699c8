"""What the user may set, and text files that survive a power cut.

A file ends in a checksum line. A new one is written beside the old one, which remains as the last
good copy: at every moment of a save there is at least one valid file. Only the command ``save``
writes.
"""

import os
from array import array

from . import exposure
from .calibration import STRAIN_MAX_PPM
from .decode import AVERAGE_MAX
from .kernel import crc32
from .smux import smux_map

SETTINGS_FILE = "settings.txt"
DEFAULT_PLAN = ("F3", "F4", "F5", "F6", "F7", "F8")

# name: smallest, largest, default
LIMITS = {
    "exposure_us": (exposure.MIN_US, exposure.MAX_US, exposure.DEFAULT_US),
    "gain": (0, exposure.GAIN_MAX, exposure.DEFAULT_GAIN),
    "led_mA": (0, exposure.LED_MAX_MA, exposure.DEFAULT_LED_MA),
    "average": (1, AVERAGE_MAX, 1),
    "strain_ppm": (0, STRAIN_MAX_PPM, 0),
    "baseline": (0, 1, 0),
    "dark_every": (0, 10_000, 0),  # one dark sample in so many, also while touched; 0 for none
    "mains_hz": (0, 60, 0),  # of lamps: 50 or 60; 0 for none
    "keys": (0, 1, 0),
    "gamepad": (0, 1, 0),
    "watchdog": (0, 1, 0),
}
# A change of these needs no restart of the sensor.
_AFTER_THE_SENSOR = (
    "average",
    "strain_ppm",
    "baseline",
    "dark_every",
    "keys",
    "gamepad",
    "watchdog",
)


class BoardSettings:
    """What the user may set.

    Parameters
    ----------
    led_max_mA : int
        Largest current of the board's LED.

    Attributes
    ----------
    values : dict
        By name: those of `LIMITS`, and ``plan``, a tuple of six diodes.
    """

    def __init__(self, led_max_mA):
        self.led_max_mA = led_max_mA
        self.values = {name: limits[2] for name, limits in LIMITS.items()}
        self.values["plan"] = DEFAULT_PLAN

    def change(self, words):
        """Apply assignments such as ``gain=9``; atomic, unchanged on error.

        Exposure and LED current become what the chip makes of them, and what `mains_hz` asks for.

        Returns
        -------
        bool
            Whether the sensor has to be restarted.

        Raises
        ------
        ValueError
            If one is unknown or out of range; the text says which and what would do.
        """
        checked = {}
        for word in words:
            name, _, text = word.partition("=")
            if name == "plan":
                checked[name] = tuple(text.split(","))
                smux_map(checked[name])
            elif name in LIMITS:
                checked[name] = self._number(name, text)
            else:
                raise ValueError(
                    "no setting is called '%s'; there are %s"
                    % (name, ", ".join(sorted(LIMITS) + ["plan"]))
                )
        mains_hz = checked.get("mains_hz", self.values["mains_hz"])
        if mains_hz not in (0, 50, 60):
            raise ValueError("mains_hz must be 50 or 60, or 0 for no lamps")
        if "exposure_us" in checked or "mains_hz" in checked:
            exposure_us = checked.get("exposure_us", self.values["exposure_us"])
            checked["exposure_us"] = exposure.choose(exposure_us, mains_hz)
        if "led_mA" in checked:
            checked["led_mA"] = exposure.actual_mA(checked["led_mA"])
        self.values.update(checked)
        return bool(set(checked).difference(_AFTER_THE_SENSOR))

    def reply(self):
        """Return the settings as replies contain them."""
        reply = dict(self.values)
        reply["plan"] = list(reply["plan"])
        return reply

    def lines(self):
        """Return the settings as assignments, as `change` takes them."""
        return ["%s=%d" % (name, self.values[name]) for name in sorted(LIMITS)] + [
            "plan=" + ",".join(self.values["plan"])
        ]

    def _number(self, name, text):
        low, high, _ = LIMITS[name]
        if name == "led_mA":
            high = min(high, self.led_max_mA)
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if name == "led_mA" and value and value < exposure.LED_MIN_MA:
            value = -1
        if not low <= value <= high:
            raise ValueError("%s must be a whole number from %d to %d" % (name, low, high))
        return value


def checksum(lines):
    """Return the CRC-32 of lines, as eight hexadecimal digits."""
    crc = array("H", (0xFFFF, 0xFFFF))
    for line in lines:  # one by one: a board may have no room for all in one piece
        data = (line + "\n").encode()
        crc32(data, len(data), crc)
    return "%04x%04x" % (crc[1] ^ 0xFFFF, crc[0] ^ 0xFFFF)


def save_lines(path, lines):
    """Replace a text file so that a cut of power leaves the new one or the old one.

    Flash wears: what is stored already is not written again.
    """
    if _lines_of(path) == list(lines):
        return
    _move_in(path)  # what an earlier save could not end: it may be the only good copy
    with open(path + ".new", "w") as file:
        for line in lines:
            file.write(line + "\n")
        file.write("crc " + checksum(lines) + "\n")
    # Only a whole file may take the place of the last good copy.
    if _lines_of(path) is not None:
        _remove(path + ".old")
        os.rename(path, path + ".old")
    _move_in(path)


def _move_in(path):
    if _lines_of(path) is None and _lines_of(path + ".new") is not None:
        _remove(path)  # FAT renames only to where nothing is
        os.rename(path + ".new", path)


def _remove(path):
    try:
        os.remove(path)
    except OSError:
        pass  # there was none


def load_lines(path):
    """Return the lines of a file or of its newest good copy; none if there is no file.

    Raises
    ------
    ValueError
        If there are some and none is whole.
    """
    damaged = False
    for candidate in (path, path + ".new", path + ".old"):
        lines = _lines_of(candidate)
        if lines is not None:
            return lines
        # A new file that is cut short was never valid.
        damaged = damaged or (candidate != path + ".new" and _exists(candidate))
    if damaged:
        raise ValueError("the file %s and its copies are damaged" % path)
    return []


def _exists(path):
    try:
        os.stat(path)
    except OSError:
        return False
    return True


def _lines_of(path):
    """Return the lines of a file, or None if there is no whole one."""
    try:
        with open(path) as file:
            lines = list(filter(None, file.read().split("\n")))
    except (OSError, ValueError):  # none; or bytes that are no text
        return None
    if lines and lines[-1] == "crc " + checksum(lines[:-1]):
        return lines[:-1]
    return None
