"""``spots calibrate --rough`` in a terminal: a simulated person does what the terminal shows."""

import numpy as np
import pytest
from support.terminal_session import calibrate_in_terminal

from spots.calibrate import calibration_file as file
from spots.calibrate.session.session_file import Session
from spots_sim.person.person import Habits


@pytest.mark.board
def test_a_person_before_a_terminal_calibrates_in_twelve_presses(tmp_path):
    words = ["--rough", "--seed", "5", "--sensor", "short_30mm"]
    person, code, text = calibrate_in_terminal(tmp_path, words, 30.0, Habits(slips=0.3), 5)
    assert code == 0, text[-2000:]
    assert person.presses <= 12
    taken = Session(tmp_path / "calibration.jsonl").of("hand")
    assert len(taken) == 12
    made = file.load(tmp_path / "calibration.toml")
    assert "relative" in made.lines
    assert made.residuals[0].position_rms_um < 1000
    assert np.ptp([p.place_um for p in taken]) > 25_000
