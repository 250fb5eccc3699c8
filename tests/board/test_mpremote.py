"""mpremote, unchanged, puts the firmware on a blank virtual board and starts it."""

import subprocess
import sys

import spots
from spots.stage import stage
from test_recovery import Bench

TIMEOUT_S = 60


def mpremote(port, *arguments):
    done = subprocess.run(
        [sys.executable, "-m", "mpremote", "connect", port, *arguments],
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_mpremote_copies_starts_and_connects_while_the_application_runs(tmp_path):
    files, flash = tmp_path / "files", tmp_path / "flash"
    flash.mkdir()
    stage("virtual", files)
    bench = Bench(flash)
    try:
        copied = [str(path) for path in sorted(files.iterdir(), key=lambda p: p.name == "main.py")]
        mpremote(bench.port, "fs", "cp", "-r", *copied, ":")
        assert {path.name for path in flash.iterdir()} == {path.name for path in files.iterdir()}
        mpremote(bench.port, "reset")
        with spots.open(bench.port) as board:
            assert board.info["board"] == "virtual"
            assert len([t for t, _ in zip(board.touches(), range(50))]) == 50
        # The application runs: Ctrl-C, which mpremote sends first, gives the board to it.
        assert mpremote(bench.port, "exec", "print(6 * 7)").strip() == "42"
        mpremote(bench.port, "reset")
        with spots.open(bench.port) as board:
            assert board.info["board"] == "virtual"
    finally:
        bench.close()
