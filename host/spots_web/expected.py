"""Computes the spectra of presses from a board's calibration; the web UI shows these spectra."""

from spots.calibrate.fit.expect import expected
from spots.link.board import Board
from spots_device.board.settings import checksum
from spots_device.reading.calibration_lines import CalibrationError
from spots_device.reading.decode import DARK_SAMPLES


def expected_shown(board: Board, info: dict, dark: list[int]) -> dict | None:
    """Return the spectra of presses along the strip, computed from the board's calibration.

    `dark` is that of the board's reply to ``get``: sums of `DARK_SAMPLES` counts; ``dark`` of the
    result is per sample. ``logs`` are log2 of the counts at positions from ``from_um`` in steps of
    ``step_um``, see `expect.expected`. None if the calibration is unknown or invalid, has no
    spectra, or if `board.calibration` is not the one that the board stores.
    """
    lines = board.calibration
    if lines is None or checksum(lines) != info["calibration"]:
        return None
    try:
        found = expected(lines, info.get("strain_ppm") or 0)
    except CalibrationError:
        return None  # the calibration in a recording is not validated
    if found is None:
        return None
    position_um, logs = found
    return {
        "from_um": float(position_um[0]),
        "step_um": float(position_um[1] - position_um[0]),
        "logs": logs.round(3).tolist(),
        "dark": [one / DARK_SAMPLES for one in dark],
    }
