"""The examples end cleanly when the program that reads their output ends."""

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.board

EXAMPLES = Path(__file__).parents[2] / "examples"
PRINTING = sorted(path.name for path in EXAMPLES.glob("*.py") if "print(" in path.read_text())


@pytest.mark.parametrize("name", PRINTING)
def test_an_example_ends_without_a_traceback_when_nobody_reads_on(name):
    with subprocess.Popen(
        [sys.executable, EXAMPLES / name], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as run:
        assert run.stdout.readline()
        run.stdout.close()
        errors = run.stderr.read()
    assert run.returncode == 0, errors
    assert "Error" not in errors
    assert len(PRINTING) >= 4
