"""A calibration by hand in a PTY, operated by a simulated person."""

import fcntl
import os
import pty
import re
import struct
import subprocess
import sys
import termios

from spots_sim.person.person import Person, line_of

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
