"""``spots calibrate --rough`` in a terminal: a simulated person does what the terminal shows."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios

import numpy as np

from spots.calibrate import calibration_file as file
from spots.calibrate.session import Session
from spots_sim.person.person import Habits, Person, line_of

_ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")
# The framed picture of a session, or a question below it.
_SHOWN = re.compile(r"╭.*?╯|what do[^(]*\(Enter: [^)]*\) ", re.DOTALL)
_ASKED = re.compile(r"press at [^│]*hold|without lifting[^│]*hold|release")
ROWS, COLUMNS = 40, 120


def calibrate_in_terminal(folder, words, length_mm, habits, seed):
    """Run ``spots calibrate`` in a PTY, operated by a simulated person.

    Parameters
    ----------
    folder : Path
        Working directory of the command.
    words : list of str
        Arguments of the command.
    length_mm : float
        Length of the strip.
    habits : Habits
        Errors and mistakes of the person.
    seed : int
        Random seed of these errors.

    Returns
    -------
    person : Person
    exit_code : int
    text : str
        Output of the command.
    """
    pipe = folder / "finger"
    os.mkfifo(pipe)
    ours, theirs = pty.openpty()
    fcntl.ioctl(theirs, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    command = [sys.executable, "-m", "spots", "calibrate", *words, "--port", f"virtual:{pipe}"]
    environment = {**os.environ, "TERM": "xterm", "NO_COLOR": "1"}
    environment.pop("COLUMNS", None)
    with subprocess.Popen(
        command, stdin=theirs, stdout=theirs, stderr=theirs, cwd=folder, env=environment
    ) as process:
        os.close(theirs)
        with pipe.open("w", buffering=1) as finger:
            person = Person(lambda way: finger.write(line_of(way)), length_mm, habits, seed)
            text = watch(ours, person)
    os.close(ours)
    return person, process.returncode, text


def watch(terminal, person):
    data, done, said = b"", 0, ""
    while True:
        try:
            chunk = os.read(terminal, 1 << 16)
        except OSError:  # the session has ended
            chunk = b""
        if not chunk:
            return data.decode(errors="ignore")
        data += chunk
        text = _ESCAPES.sub("", data.decode(errors="ignore"))
        for shown in _SHOWN.finditer(text, done):
            done = shown.end()
            if shown[0].startswith("what"):
                os.write(terminal, person.answer(shown[0]).encode() + b"\n")
            elif (asked := _ASKED.findall(shown[0])) and asked[-1] != said:
                said = asked[-1]
                person.hear(said)


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
