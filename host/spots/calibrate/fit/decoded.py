"""The parts of a calibration's tables, and a reading's results, by name."""

from __future__ import annotations

from collections.abc import Sequence

from spots_device.reading.calibration import Calibration
from spots_device.reading.decode import (
    BOUNDS,
    CROSS,
    FLOOR,
    FLOOR_SAMPLES,
    FORCES,
    SAMPLES,
    SEGMENTS,
    SUMS,
    WEIGHTS,
    Decode,
    columns_of,
)
from spots_device.reading.kernel import estimate
from spots_device.sensor.smux import CHANNELS

_FIELDS = "flags", "contrast", "brightness", "position_um", "force_mN"
_MEAN_SAMPLES = 64  # mean counts are multiplied by this number before they are rounded


class Segment:
    """A part of the strip with its own weights and tables.

    `tables` are those of the calibration, see calibration.py; `place` is the index of the segment's
    weights in them. `position` and `force` are six weights each, Q13, for the position contrast and
    for the brightness. The columns of the table of knots (points between which the board
    interpolates) are contrast, position, expected misfit of a single press, and correction that is
    subtracted from the brightness. `cross` has two further columns if the calibration has the
    cross-sensitivity: size of the correction of the position in um, and that of the expected
    misfit.
    """

    def __init__(self, tables: memoryview, place: int):
        self.position = tables[place : place + CHANNELS]
        self.force = tables[place + CHANNELS : place + 2 * CHANNELS]
        columns = columns_of(tables, place + 2 * CHANNELS, 4 + 2 * bool(tables[CROSS]))
        self.contrasts, self.positions_um, self.fits, self.offsets, *self.cross = columns


def coarse_of(calibration: Calibration) -> memoryview:
    """Return the six weights of the contrast that selects a segment, Q13."""
    return memoryview(calibration.tables)[WEIGHTS : WEIGHTS + CHANNELS]


def fit_of(calibration: Calibration) -> memoryview:
    """Return the six weights of the misfit, Q13."""
    return memoryview(calibration.tables)[WEIGHTS + CHANNELS : WEIGHTS + 2 * CHANNELS]


def bounds_of(calibration: Calibration) -> list[int]:
    """Return the coarse contrast, Q20 of log2, at which each segment begins."""
    tables = calibration.tables
    return [tables[BOUNDS + 2 * i] for i in range(tables[SEGMENTS])]


def segments_of(calibration: Calibration) -> tuple[Segment, ...]:
    """Return a view of each segment's weights and tables; writing to it changes the calibration."""
    tables = memoryview(calibration.tables)
    return tuple(Segment(tables, tables[BOUNDS + 2 * i + 1]) for i in range(tables[SEGMENTS]))


def shares_of(calibration: Calibration) -> memoryview:
    """Return the share of the cross-sensitivity at each brightness of the table of forces, Q12."""
    tables = memoryview(calibration.tables)
    return columns_of(tables, tables[FORCES], 4)[3]


class Decoded(Decode):
    """Computes position and force from counts; the results of the latest reading are attributes.

    `flags` are those of decode.py, without `DROPPED`, which `frame.Framer` sets. `contrast` and
    `brightness` are in Q20 of log2. Position and force are 0 if the flags mark them as unknown.
    """

    def __getattr__(self, name):
        try:
            return self.state[_FIELDS.index(name)]
        except ValueError:
            raise AttributeError(name) from None

    def update(self, sums: Sequence[int], samples: int, dark: Sequence[int], flags: int):
        """Decode one reading of 1 to `AVERAGE_MAX` samples.

        `sums` are counts over these samples, `dark` are sums over the number of samples that
        `scale` has set, zeros without a dark frame. The flags that apply to `sums` are `SATURATED`,
        `DARK_SUBTRACTED` and `LED_OFF`.
        """
        if samples != self.state[SAMPLES]:
            self.scale(samples, self.state[FLOOR_SAMPLES])
        for i in range(CHANNELS):
            self.state[SUMS + i] = sums[i]
            self.state[FLOOR + i] = dark[i]
        estimate(self.state, self.tables, flags)

    def update_mean(self, counts: Sequence[float]):
        """Decode mean dark-subtracted counts; a negative count is taken as 0."""
        sums = [max(round(_MEAN_SAMPLES * count), 0) for count in counts]
        self.update(sums, _MEAN_SAMPLES, [0] * CHANNELS, 0)
