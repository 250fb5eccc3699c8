"""The calibration of a strip: its attributes, and the lines that the board stores.

calibration_lines.py describes and reads the lines. A board imports it when it reads a calibration.
"""

from collections import namedtuple

from ..runtime.modules import drop
from ..sensor.smux import CHANNELS
from .decode import BOUNDS, CROSS, FORCES, SEGMENTS

# Settings of a reading, for which a calibration is valid: unique id of the board (str), diodes of
# ADC 0 to 5 (tuple of str), register code of the gain, exposure in us, LED current in mA.
Conditions = namedtuple("Conditions", ("board", "plan", "gain", "exposure_us", "led_mA"))


class Calibration:
    """A validated calibration, parsed for one strain, from lines as in calibration_lines.py.

    Between two calibrated strains the tables are interpolated linearly. Lines or a strain that are
    invalid raise a `calibration_lines.CalibrationError`.
    """

    def __init__(self, lines, strain_ppm=0):
        # `fill` sets, besides other attributes:
        # - relative_force: forces have no unit: 3000 then means the mean light of the calibration's
        #   presses, and 6000 twice that light.
        # - presser: what the tables are for: ``finger`` or ``indenter``; ``no_finger`` if an
        #   indenter calibrated a strip that a finger will press; None if it is unknown.
        # - baseline: light of the untouched strip without the dark frame: six sums of counts over
        #   `decode.DARK_SAMPLES` samples, with the settings of `conditions`; empty if unknown.
        # - compensation, thermal: of silicone.py and thermal.py, or None.
        # - tables, see `decode.SEGMENTS`. Views of it are the columns of the force table:
        #   brightnesses, forces_mN and tolerances.
        # - drift_max: shift of the misfit since the calibration up to which keys work, Q12 of log2.
        #   A drift of the LED with this shift moves positions by 3 to 4 % of the strip's length.
        # - decay: of the light by the dye in log2 units per um, times 2**24; at most 1000.
        from . import calibration_lines

        try:
            self.conditions = Conditions(*calibration_lines.fill(self, lines, strain_ppm))
        finally:
            drop(calibration_lines)
        self.find_cross()

    def find_cross(self):
        """Set `cross` by the tables. It is stored, so that its users allocate nothing.

        It is None, or the cross-sensitivity of the strip, for two fingers: change of the correction
        of positions, in um, from the weakest to the strongest calibrated light, at both ends of the
        strip; and this light as brightness, Q20 of log2.
        """
        tables = self.tables
        self.cross = None
        if not tables[CROSS]:
            return
        forces = tables[FORCES]
        last = forces + tables[forces]
        shares = last + 1 + 2 * tables[forces]
        change = tables[shares] - tables[shares + tables[forces] - 1]
        near = tables[BOUNDS + 1] + 2 * CHANNELS
        far = tables[BOUNDS + 2 * tables[SEGMENTS] - 1] + 2 * CHANNELS
        self.cross = (
            tables[near + 4 * tables[near] + 1] * change >> 12,
            tables[far + 5 * tables[far]] * change >> 12,
            tables[last],
        )

    def mismatch(self, conditions):
        """Return why these `Conditions` of readings do not fit (sentence), or None.

        Any exposure is valid, see `rescale`.
        """
        made = self.conditions
        if conditions.board != made.board:
            return "the calibration was made on board %s, this is %s: calibrate again" % (
                made.board,
                conditions.board,
            )
        if conditions.plan != made.plan:
            what = "with channels=" + ",".join(made.plan)
        elif (conditions.gain, conditions.led_mA) != (made.gain, made.led_mA):
            what = "at gain=%d led_mA=%d" % (made.gain, made.led_mA)
        else:
            return None
        return "the calibration was made %s; set this, or calibrate again" % what


class CalibrationSlot:
    """Stores the uploaded lines of a calibration, and caches them in parsed form.

    Parsing takes 0.2 s and produces tens of kilobytes of garbage on an RP2040. So the lines are
    parsed again only for another strain or exposure, not each time a lost sensor is found again.
    """

    def __init__(self):
        self.use([])

    def use(self, lines):
        """Validate and store lines of a calibration (list of str); an empty list removes it.

        If the lines are invalid, this raises a ValueError and stores nothing.
        """
        parsed = Calibration(lines) if lines else None
        self.lines = lines
        self._parsed = parsed
        self._key = parsed and (0, parsed.conditions.exposure_us)

    def choose(self, conditions, strain_ppm):
        """Return the calibration for readings of these `Conditions`, and why there is none.

        The second one is a sentence. One is None if there is the other, and both are None if no
        calibration is stored.
        """
        if not self.lines:
            return None, None
        try:
            key = strain_ppm, conditions.exposure_us
            if self._parsed is None or self._key != key:
                self._parsed = None  # frees memory for the new one
                parsed = Calibration(self.lines, strain_ppm)
                if conditions.exposure_us != parsed.conditions.exposure_us:
                    from . import rescale  # only for another exposure

                    rescale.rescale(parsed, conditions.exposure_us)
                    drop(rescale)
                self._parsed, self._key = parsed, key
        except ValueError as error:
            return None, str(error)
        except MemoryError:
            return None, "no memory is left for the calibration: save and reboot"
        why_not = self._parsed.mismatch(conditions)
        return (None, why_not) if why_not else (self._parsed, None)
