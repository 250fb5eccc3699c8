"""The Rerun SDK in an environment of its own takes our readings; run by ``make labs``."""

from __future__ import annotations

import rerun as rr

import spots
from spots_net.to_rerun import Rerun


def test_rerun_gets_the_readings_of_a_board(tmp_path):
    out = tmp_path / "run.rrd"
    with spots.open("virtual") as board:
        board.stream("touch", "spectrum")
        outlet = Rerun(board, str(out))
        for frame in board.frames(2):
            outlet.put(frame, frame.time_s)
            outlet.turn()
        outlet.close()
    assert out.stat().st_size > 10_000
    assert rr.__version__
