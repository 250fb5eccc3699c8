"""Explains to the user why all readings of a strip are untrusted, and what to do."""

from spots_device.reading import decode

from ..link.frames import Touch

# Time of untrusted readings before a warning, in s. Applications need a reading every 0.3 s at
# least, so the warning comes within a second.
_UNTRUSTED_S = 0.7
# Two fingers teach the board no drift, and seldom touch twice in a row without a lone finger.
_DRIFT = (
    "the strip has drifted since its calibration: positions are wrong; next: 'spots doctor' for "
    "the size of the error; a re-zero is advised: spots rezero"
)
# The first reading of this touch was trusted, so another finger may have caused the others.
_ANOTHER = (
    "two fingers touch the strip, or it has drifted since its calibration; next: lift all but one "
    "finger; if that changes nothing, a re-zero is advised: spots rezero"
)
_PRESSES = 2  # presses in a row that do not fit one press, from which on a drift is the cause
# Causes and remedies by flags; the first entry whose flags are all set applies.
CAUSES = {
    decode.NOT_CALIBRATED: ("the board has no calibration for its settings; next: spots calibrate"),
    decode.SATURATED: (
        "the sensor is saturated; next: shade the strip, or calibrate it with a smaller gain"
    ),
    decode.LED_OFF: (
        "the board keeps measuring its dark frame; next: lift all fingers, and keep the ambient "
        "light steady"
    ),
    decode.FITS_WITH_DRIFT: _DRIFT,
    decode.MISFIT: (
        "two fingers touch the strip, or the spectrum does not fit one press; next: lift all "
        "fingers and wipe the strip; if that changes nothing, a re-zero is advised: spots rezero"
    ),
    decode.TOO_DARK: (
        "force or position is beyond the calibrated range; next: press less hard, and stretch the "
        "strip less"
    ),
}
# Instead of a misfit, if the light of the untouched strip changes.
_LIGHT = (
    "the ambient light changes; next: shade the strip from sun and lamps, and run 'spots doctor' "
    "near a lamp that flickers"
)


class Untrusted:
    """Detects that all readings of a strip have been untrusted for 0.7 s.

    Usually the next reading without a fault ends the warning. There is a special case: the spectrum
    of each press does not fit the calibration. Since one press may be too short for a warning, the
    durations of successive presses are added up. Only a trusted press then ends the warning.
    `sentence` has cause and remedy; it is empty while there is no warning. `drifted` is whether the
    cause is a drift of the strip.
    """

    def __init__(self):
        self.sentence = ""
        self.drifted = False
        self._lasted_s = 0.0
        self._last_s: float | None = None  # of the last reading, if it was untrusted
        self._misfit_press = False
        self._presses = 0  # in a row that do not fit
        self._touching = False

    def take(self, touch: Touch, now_s: float, light_moves: bool = False) -> None:
        """Take a reading, which arrived at a time of `Board.now_s`, and update `sentence`.

        If `light_moves`, the ambient light changes, which is then the probable cause of a misfit.
        """
        # Without a press, `TOO_DARK` is always set. It is cleared here, because it belongs to
        # `FITS_WITH_DRIFT`, too, which has its meaning only during a press.
        known = touch.flags if touch.touching else touch.flags & ~decode.TOO_DARK
        flag = next((flag for flag in CAUSES if known & flag == flag), None)
        begins = touch.touching and not self._touching
        self._touching = touch.touching
        if flag is None:
            self._last_s = None
            if touch.touching or not self._misfit_press:
                self.sentence, self._lasted_s, self._misfit_press = "", 0.0, False
                self.drifted, self._presses = False, 0
            return
        if flag == decode.LED_OFF and self._misfit_press:
            self._last_s = None  # the board repeats its dark frame because presses do not fit
            return
        if self._last_s is not None:
            self._lasted_s += now_s - self._last_s
        self._last_s = now_s
        self._misfit_press = touch.touching and flag in (decode.FITS_WITH_DRIFT, decode.MISFIT)
        self._presses += begins and self._misfit_press
        if self._lasted_s >= _UNTRUSTED_S:
            cause = CAUSES[flag]
            if light_moves and flag & decode.MISFIT:
                cause = _LIGHT
            elif self._misfit_press and self._presses >= _PRESSES:
                cause = _DRIFT
            elif cause is _DRIFT and not self._presses:
                cause = _ANOTHER
            self.drifted = cause is _DRIFT
            self.sentence = f"every reading is untrusted, because {cause}"
