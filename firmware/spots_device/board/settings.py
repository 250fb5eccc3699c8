"""Settings of the board, and the checksum of lines."""

from binascii import crc32

from ..reading.calibration_lines import STRAIN_MAX_PPM
from ..reading.decode import AVERAGE_MAX
from ..sensor.exposure import (
    DEFAULT_GAIN,
    DEFAULT_LED_MA,
    DEFAULT_US,
    GAIN_MAX,
    LED_MAX_MA,
    LED_MIN_MA,
    MAX_US,
    MIN_US,
    actual_mA,
    choose,
)
from ..sensor.smux import smux_map

# Values of the setting ``radio``: what goes by Bluetooth LE.
RADIO = ("off", "hid", "data", "both")
DEFAULT_CHANNELS = ("F3", "F4", "F5", "F6", "F7", "F8")

# Name of a setting: minimum, maximum, default.
LIMITS = {
    "exposure_us": (MIN_US, MAX_US, DEFAULT_US),
    "gain": (0, GAIN_MAX, DEFAULT_GAIN),
    "led_mA": (0, LED_MAX_MA, DEFAULT_LED_MA),
    "average": (1, AVERAGE_MAX, 1),
    "strain_ppm": (0, STRAIN_MAX_PPM, 0),
    "dark_every": (0, 10_000, 0),  # samples between two dark samples, even during a touch; 0: off
    "mains_hz": (0, 60, 0),  # mains frequency of the lamps, 50 or 60; 0: no such lamps
    "keys": (0, 1, 0),
    "gamepad": (0, 1, 0),
    "watchdog": (0, 1, 0),
}
# Settings that can change without a restart of the sensor.
_AFTER_THE_SENSOR = (
    "average",
    "strain_ppm",
    "dark_every",
    "keys",
    "gamepad",
    "watchdog",
    "radio",
)


class BoardSettings:
    """Settings that the user can change.

    Parameters
    ----------
    board : object
        Module board_config, or an object with ``LED_MAX_MA``, the maximum current of the board's
        LED in mA (int). Optional attributes: ``STRIP_LED``, the default of the setting ``led``
        (one of `light.LEDS`), and ``STRIP_LED_PIN``, the pin that ``led=gpio`` needs.

    Attributes
    ----------
    values : dict
        Values by name: an int for each name in `LIMITS`; ``channels``, a tuple of the names of six
        diodes; ``led``, one of `light.LEDS`; ``dark``, a list: the stored dark frame of an LED that
        is always on (gain, exposure in us, and six sums over `decode.DARK_SAMPLES` samples), or
        empty.
    """

    def __init__(self, board):
        self._board = board
        self.led_max_mA = board.LED_MAX_MA
        self.values = {name: default for name, (_, _, default) in LIMITS.items()}
        self.values["channels"] = DEFAULT_CHANNELS
        self.values["dark"] = []
        self.values["led"] = "ldr"
        self.values["radio"] = RADIO[0]
        self._led = getattr(board, "STRIP_LED", "ldr")
        if self._led != "ldr":
            self.change(["led=" + self._led])

    def change(self, words):
        """Change settings; on an error no setting changes.

        Exposure and LED current are rounded to values that the chip and the setting ``mains_hz``
        allow.

        Parameters
        ----------
        words : list of str
            Assignments such as ``gain=9``.

        Returns
        -------
        bool
            Whether the sensor must be restarted.

        Raises
        ------
        ValueError
            If a setting is unknown or out of range. The message names setting and valid values.
        """
        checked = {}
        for word in words:
            name, _, text = word.partition("=")
            if name == "channels":
                checked[name] = tuple(text.split(","))
                smux_map(checked[name])
            elif name == "radio":
                if text not in RADIO:
                    raise ValueError("radio must be one of " + ", ".join(RADIO))
                if text != RADIO[0] and not getattr(self._board, "BLUETOOTH", False):
                    raise ValueError("this board has no radio that can bond", "no_radio")
                checked[name] = text
            elif name == "led" or name == "dark":
                checked[name] = text
            elif name in LIMITS:
                checked[name] = self._number(name, text)
            else:
                raise ValueError(
                    "no setting is called '%s'; use one of %s"
                    % (name, ", ".join(sorted(LIMITS) + ["led", "radio", "channels"]))
                )
        mains_hz = checked.get("mains_hz", self.values["mains_hz"])
        if mains_hz not in (0, 50, 60):
            raise ValueError("mains_hz must be 50 or 60, or 0 for no lamps")
        if "exposure_us" in checked or "mains_hz" in checked:
            exposure_us = checked.get("exposure_us", self.values["exposure_us"])
            checked["exposure_us"] = choose(exposure_us, mains_hz)
        if "led_mA" in checked:
            checked["led_mA"] = actual_mA(checked["led_mA"])
        if self.values["led"] != "ldr" or "led" in checked or "dark" in checked:
            from .light import settle  # most strips do not need it

            settle(checked, self.values, self._board)
        self.values.update(checked)
        return bool(set(checked).difference(_AFTER_THE_SENSOR))

    def reply(self):
        """Return the settings except ``dark`` as a dict for a reply; ``channels`` is a list."""
        reply = dict(self.values)
        reply["channels"] = list(reply["channels"])
        del reply["dark"]  # the reply to ``get`` contains these sums
        return reply

    def rate_mHz(self):
        """Return the rate in mHz at which the chip allows readings of ``average`` samples."""
        return 1_000_000_000 // (self.values["exposure_us"] * self.values["average"])

    def lines(self):
        """Return all settings as a list of assignments for `change`."""
        values = self.values
        lines = ["%s=%d" % (name, values[name]) for name in sorted(LIMITS)]
        lines.append("channels=" + ",".join(values["channels"]))
        if values["led"] != self._led:
            lines.append("led=" + values["led"])
        if values["radio"] != RADIO[0]:
            lines.append("radio=" + values["radio"])
        if values["dark"]:
            lines.append("dark=" + ",".join(map(str, values["dark"])))
        return lines

    def _number(self, name, text):
        low, high, _ = LIMITS[name]
        if name == "led_mA":
            high = min(high, self.led_max_mA)
        try:
            value = int(text)
        except ValueError:
            value = low - 1
        if name == "led_mA" and 0 < value < LED_MIN_MA:
            low = LED_MIN_MA
        if not low <= value <= high:
            raise ValueError("%s must be a whole number from %d to %d" % (name, low, high))
        return value


def checksum(lines):
    """Return the CRC-32 of lines (list of str, without line ends) as eight hexadecimal digits."""
    crc = 0
    for line in lines:  # line by line: the memory may not suffice for all lines in one piece
        crc = crc32((line + "\n").encode(), crc)
    return "%08x" % crc
