"""A file that a command writes at its end is checked before the board is opened."""

import os

import pytest

from spots.cli import main
from spots.common import atomic


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """Working directory with a folder ``d.toml``, a pipe ``p.toml`` and a file ``kept.toml``."""
    (tmp_path / "d.toml").mkdir()
    os.mkfifo(tmp_path / "p.toml")
    (tmp_path / "kept.toml").write_text("kept")
    monkeypatch.chdir(tmp_path)
    return tmp_path


# The port does not exist: an error about the port means that the file was not checked first.
@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("calibrate --session no/a.jsonl", "there is no folder no: make it first"),
        ("calibrate --rough --session a.jsonl --out no/a.toml", "there is no folder no: make it"),
        (
            "calibrate position --session a.jsonl --out d.toml",
            "cannot write d.toml: Is a directory",
        ),
        ("calibrate force --session d.jsonl", "cannot write d.toml: Is a directory"),
        ("calibrate joint --session a.jsonl --out p.toml", "p.toml: it is not a regular file"),
        ("calibrate --session kept.toml/a.jsonl", "there is no folder kept.toml: make it first"),
        ("controller --calibrate --settings no/c.toml", "there is no folder no: make it first"),
        ("twin --measure no/points.csv --linkage arm.toml", "there is no folder no: make it first"),
        ("twin --measure d.toml --linkage arm.toml", "cannot write d.toml: Is a directory"),
    ],
)
def test_what_cannot_be_written_is_refused_before_a_board_is_opened(folder, capsys, line, says):
    before = sorted(folder.rglob("*"))
    assert main([*line.split(), "--port", "/dev/nope"]) == 2
    errors = capsys.readouterr().err
    assert says in errors
    assert errors.count("\n") == 1
    assert sorted(folder.rglob("*")) == before
    assert (folder / "kept.toml").read_text() == "kept"


def test_a_calibration_that_cannot_be_replaced_is_not_rezeroed(folder, capsys, monkeypatch):
    def refuse(*arguments, **options):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(atomic.tempfile, "NamedTemporaryFile", refuse)
    monkeypatch.setattr("spots.calibrate.session.calibrate.load", lambda path: None)
    assert main(["rezero", "kept.toml", "--port", "/dev/nope"]) == 2
    assert "cannot write kept.toml: Permission denied" in capsys.readouterr().err


def test_a_file_that_can_be_written_is_unchanged_by_the_check(folder):
    before = (folder / "kept.toml").stat()
    for append in (False, True):
        atomic.check_writable(folder / "kept.toml", append=append)
        atomic.check_writable(folder / "new.toml", append=append)
    assert (folder / "kept.toml").stat().st_mtime_ns == before.st_mtime_ns
    assert not (folder / "new.toml").exists()
