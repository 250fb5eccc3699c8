"""The scripts in examples/, on a board in simulated time."""

import os
import runpy
import signal
import subprocess
import sys
import time
from pathlib import Path

import matplotlib
import pytest
from support.reels import replayed

import spots
from spots.link.frames import Touch

pytestmark = pytest.mark.board

EXAMPLES = Path(__file__).parents[2] / "examples"
matplotlib.use("Agg")


@pytest.fixture
def run(opened, monkeypatch):
    """Return a function that runs an example for two seconds of simulated time.

    Its arguments are the name of the script, and the arguments of its command line. It returns the
    global variables of the script.
    """

    def run(name, *arguments):
        board = opened()
        touches = board.touches
        board.touches = lambda: touches(2.0)
        asked = []
        monkeypatch.setattr(spots, "open", lambda port: asked.append(port) or board)
        monkeypatch.setattr(sys, "argv", [name, *map(str, arguments)])
        found = runpy.run_path(str(EXAMPLES / name), run_name="__main__")
        assert asked == ["virtual"]
        return found

    yield run
    signal.signal(signal.SIGINT, signal.default_int_handler)  # an example may set its own


def test_read_touches_prints_readings(run, capsys):
    run("read_touches.py", "virtual")
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) > 50
    words = [line.split() for line in lines]
    assert all(unit == ["s", "mm", "N"] for unit in ([w[1], w[3], w[5]] for w in words))
    assert 0 < float(words[0][2]) < 85


def test_the_gripper_closes_with_the_force_and_opens_in_the_end(run, capsys):
    run("gripper.py")  # without a port argument, each example uses the port `virtual`
    words = [line.split() for line in capsys.readouterr().out.splitlines()]
    openings_mm = [float(word[2]) for word in words]
    assert len(openings_mm) > 10
    assert openings_mm[0] == openings_mm[-1] == 80
    assert 0 <= min(openings_mm) < 40


def test_record_and_plot_records_and_plots(run, tmp_path):
    path = tmp_path / "run.spots"
    found = run("record_and_plot.py", path)
    frames, recording = replayed(path)
    assert recording.complete
    trusted = [frame for frame in frames if isinstance(frame, Touch) and frame.trusted]
    drawn_mm = found["place_dots"].get_ydata()
    assert len(drawn_mm) > 50
    assert list(drawn_mm) == [frame.position_um / 1e3 for frame in trusted[: len(drawn_mm)]]
    found["plt"].close("all")


NAMES = sorted(path.name for path in EXAMPLES.glob("*.py"))
FIRST = {"record_and_plot.py": "run.spots"}  # argument of an example before the port


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    ("arguments", "code", "sentence"),
    [
        (["--help"], 0, "usage: "),
        (["--nope"], 2, "unrecognized arguments: --nope"),
        (["nope", "/dev/ttyNOPE", "third", "fourth"], 2, "usage: "),
        (["/nope/nope"], 2, "nope"),
    ],
)
def test_an_example_that_is_misused_prints_its_usage(
    name, arguments, code, sentence, monkeypatch, capsys
):
    if arguments == ["--nope"]:
        arguments = [*arguments, *filter(None, [FIRST.get(name)])]
    monkeypatch.setattr(sys, "argv", [name, *arguments])
    with pytest.raises(SystemExit) as end:
        runpy.run_path(str(EXAMPLES / name), run_name="__main__")
    printed = "".join(capsys.readouterr())
    assert end.value.code == code
    assert sentence in printed
    assert f"usage: {name}" in printed


@pytest.mark.parametrize("name", NAMES)
def test_ctrl_c_ends_an_example_cleanly(name, tmp_path):
    path = tmp_path / "run.spots"
    arguments = [path] if name in FIRST else []
    with subprocess.Popen(
        [sys.executable, EXAMPLES / name, *arguments],
        env=os.environ | {"MPLBACKEND": "Agg"},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        if arguments:
            while process.poll() is None and not (path.exists() and path.stat().st_size > 1000):
                time.sleep(0.05)
        else:
            for _ in range(3):
                assert process.stdout.readline(), process.stderr.read()
        process.send_signal(signal.SIGINT)
        try:
            _, errors = process.communicate(timeout=30)
        finally:
            process.kill()
    assert "Traceback" not in errors
    assert process.returncode == 0, errors
