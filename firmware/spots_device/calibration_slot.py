"""The calibration that the host uploaded, and whether it may be used now."""

from .calibration import Calibration, CalibrationError
from .settings import checksum


class CalibrationSlot:
    """Stores the lines, and parses them once for each strain.

    Parsing takes 0.2 s and tens of kilobytes of garbage on an RP2040: it must not happen whenever
    the sensor returns.

    Attributes
    ----------
    lines : list of str
    """

    def __init__(self):
        self.lines = []
        self._parsed = None
        self._strain_ppm = 0

    def check(self, lines):
        """Raise CalibrationError, a ValueError, if lines must not be used."""
        Calibration(lines)

    def use(self, lines):
        """Store lines that were checked, or none."""
        self.lines = lines
        self._parsed = None

    def checksum(self):
        """Return the checksum of the lines."""
        return checksum(self.lines)

    def choose(self, conditions, strain_ppm):
        """Return the stored calibration if it can be used at the present settings.

        Parameters
        ----------
        conditions : conditions.Conditions
            The settings at which readings are taken.
        strain_ppm : int

        Returns
        -------
        calibration : calibration.Calibration or None
        why_not : str or None
            Why the stored calibration cannot be used.
        """
        if not self.lines:
            return None, None
        try:
            if self._parsed is None or self._strain_ppm != strain_ppm:
                self._parsed = None  # room for the next one
                self._parsed = Calibration(self.lines, strain_ppm)
                self._strain_ppm = strain_ppm
        except CalibrationError as error:
            return None, str(error)
        except MemoryError:
            return None, "no memory is left for the calibration: save and reboot"
        why_not = self._parsed.mismatch(conditions)
        return (None, why_not) if why_not else (self._parsed, None)
