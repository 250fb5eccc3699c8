"""Files with the names of Python's own modules, in the folder from which a user starts SPOTS."""

import subprocess
import sys

import pytest

pytestmark = pytest.mark.board

SCRIPT = """
import spots
print("starts", __name__)
with spots.open("virtual") as board:
    print("touch", next(iter(board.touches())).trusted)
"""


def run(folder, *words):
    """Run Python in a folder; return its exit code and its output."""
    run = subprocess.run(
        [sys.executable, *words],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    return run.returncode, run.stdout, run.stderr


def test_no_file_of_the_current_folder_runs_in_a_virtual_board(tmp_path, monkeypatch):
    """Fails if a process that we start imports from the current folder, whatever starts it."""
    monkeypatch.setenv("SPOTS_VIRTUAL_RUNTIME", "cpython")
    for name in ("random", "secrets", "json", "select"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('a file of the user runs')")
    (tmp_path / "pty.py").write_text(SCRIPT)
    main = "import sys; from spots.cli import main; sys.exit(main(sys.argv[1:]))"
    line = ["monitor", "--port", "virtual", "--seconds", "0.3"]
    assert run(tmp_path, "-I", "-c", main, *line)[::2] == (0, "")


@pytest.mark.parametrize("name", ["random", "secrets"])
def test_a_script_that_would_start_itself_is_told_once(name, tmp_path):
    path = tmp_path / f"{name}.py"
    path.write_text(SCRIPT)
    code, said, error = run(tmp_path, path.name)
    assert code == 1
    assert said.count("starts") <= 2
    assert error.count("rename it") == 1
    assert error.splitlines()[-1].startswith(
        f"spots.errors.SettingError: {path} has the name of a module"
    )


def test_a_script_in_the_python_path_starts_no_board_inside_a_board(tmp_path, monkeypatch):
    """Fails if each process of a board starts the next one, without an end."""
    (tmp_path / "pty.py").write_text(SCRIPT)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    code, said, error = run(tmp_path, "pty.py")
    assert (code, said.count("starts")) == (1, 1)
    assert error.count("rename it") == 1
