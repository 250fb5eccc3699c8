"""Views of a calibration's tables by name, for the host; boards do not have this module."""

from array import array

from .calibration import BOUNDS, SEGMENTS, WEIGHTS, columns_of
from .smux import CHANNELS


class Segment:
    """A part of the strip with its own weights and tables.

    Parameters
    ----------
    tables : memoryview of int
        Tables of the calibration, see calibration.py.
    place : int
        Index of the segment's weights in `tables`.

    Attributes
    ----------
    position, force : memoryview of int
        Six weights each, Q13.
    contrasts, positions_um, fits, offsets : memoryview of int
        Columns of the table of knots (points between which the board interpolates): contrast,
        position, misfit of one press, and correction that is subtracted from the brightness.
    """

    def __init__(self, tables, place):
        self.position = tables[place : place + CHANNELS]
        self.force = tables[place + CHANNELS : place + 2 * CHANNELS]
        columns = columns_of(tables, place + 2 * CHANNELS, 4)
        self.contrasts, self.positions_um, self.fits, self.offsets = columns


def view(calibration, name):
    """Return weights, bounds or segments of a calibration by name.

    Parameters
    ----------
    calibration : calibration.Calibration
        Calibration whose `tables` are viewed.
    name : str
        ``coarse`` or ``fit``, six weights each; ``bounds``, the contrasts at which segments begin;
        or ``segments``.
    """
    if name not in ("coarse", "fit", "bounds", "segments"):
        raise AttributeError(name)
    tables = memoryview(calibration.tables)
    if name == "coarse":
        return tables[WEIGHTS : WEIGHTS + CHANNELS]
    if name == "fit":
        return tables[WEIGHTS + CHANNELS : WEIGHTS + 2 * CHANNELS]
    places = range(BOUNDS, BOUNDS + 2 * tables[SEGMENTS], 2)
    if name == "bounds":
        return array("i", [tables[place] for place in places])
    return tuple(Segment(tables, tables[place + 1]) for place in places)
