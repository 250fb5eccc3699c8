"""The spectra that a board's calibration expects, as the page draws them over the counts."""

from __future__ import annotations

from spots_device.calibration import CalibrationError
from spots_device.decode import DARK_SAMPLES
from spots_device.settings import checksum

from ..calibrate.expect import expected
from ..link.board import Board


def expected_shown(board: Board, info: dict, dark: list[int]) -> dict | None:
    """Return what is expected along the strip.

    Parameters
    ----------
    board : Board
    info : dict
        Its ``hello``.
    dark : list of int
        Its dark frame, from ``get``.

    Returns
    -------
    dict or None
        None where the host does not know the calibration that the board uses, or it is invalid.
    """
    lines = board.calibration
    if lines is None or checksum(lines) != info["calibration"]:
        return None
    try:
        position_um, logs = expected(lines, info.get("strain_ppm") or 0)
    except CalibrationError:
        return None  # a recording may hold anything
    return {
        "from_um": float(position_um[0]),
        "step_um": float(position_um[1] - position_um[0]),
        "logs": logs.round(3).tolist(),
        "dark": [one / DARK_SAMPLES for one in dark],
    }
