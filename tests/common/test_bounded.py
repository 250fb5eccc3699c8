"""Special files, too large files and too deeply nested files: each command refuses them."""

import os
import resource
import signal

import psutil
import pytest

from spots import SpotsError
from spots.cli import main
from spots.common import toml
from spots.deploy import staging as stage
from spots.link import connect
from spots_linkage import mounted
from spots_sim.demo import virtual

# Memory that a command may use; to read the file completely would need more.
MEMORY_BYTES = 256 << 20
# Timeout after which a command hangs. Even on a slow machine, commands need only a part of it.
HANGS_S = 30

DRAWN = """bar_mm = [100, 100, 100, 100]
base_mm = 80
joint = [{calibration = "a", offset_deg = 0}, {calibration = "b", offset_deg = 0}]
"""
POINTS = "x_mm,y_mm,joint1_deg,joint2_deg,sigma1_deg,sigma2_deg\n"
KEY = ".".join(["a"] * 50_000)
QUOTED = ".".join(['","'] * 25_000)
DEEP = {
    "key": f"{KEY} = 1\n",
    "table": f"[{KEY}]\n",
    "quoted": f"{QUOTED} = 1\n",
    "after_text": f'a = {{x = """\n"{""}"""", {KEY} = 1}}\n',
    "after_escape": f'"\\"".{KEY} = 1\n',
    "inline": f"a = {{{KEY} = 1}}\n",
    "lists": "a = " + "[" * 50_000 + "\n",
    "quotes": '"\\' * 50_000,
}
COMMANDS = {
    "sensor": "monitor --port virtual --seconds 1 --sensor {}",
    "scenario": "monitor --port virtual --seconds 1 --scenario {}",
    "layout": "keys check {}",
    "gestures": "wearable --dry-run --port virtual --seconds 1 --gestures {}",
    "settings": "controller --dry-run --port virtual --seconds 1 --settings {}",
    "linkage": "twin --json --linkage {}",
    "path": "twin --json --path {}",
    "points": "twin --linkage drawn.toml --calibrate {}",
    "session": "calibrate position --port virtual --session {}",
    "recorded calibration": "record --port virtual --seconds 1 --calibration {} new.spots",
    "info": "info {}",
    "replay": "replay {}",
    "export": "export --to npz {}",
    "port": "monitor --port recording:{}",
    "zenoh": "monitor --port zenoh: --seconds 1 --zenoh-config {}",
}
TOML = "sensor", "scenario", "layout", "gestures", "settings", "linkage", "path"


def special(kind, path):
    if kind == "fifo":
        os.mkfifo(path)
    elif kind == "endless":
        path.symlink_to("/dev/zero")
    elif kind == "huge":
        with open(path, "wb") as file:
            file.truncate(300 << 20)
    else:
        path.write_text(DEEP[kind])


@pytest.fixture
def bounded():
    """Limit memory and time, so that the test fails if a command reads a file completely."""

    def hang(number, frame):
        raise AssertionError(f"not refused in {HANGS_S} s")

    before = signal.signal(signal.SIGALRM, hang)
    soft, hard = resource.getrlimit(resource.RLIMIT_AS)
    most = psutil.Process().memory_info().vms + MEMORY_BYTES
    resource.setrlimit(resource.RLIMIT_AS, (most, hard))
    signal.alarm(HANGS_S)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)
        resource.setrlimit(resource.RLIMIT_AS, (soft, hard))


@pytest.fixture
def refused(bounded, tmp_path, monkeypatch, capfd):
    """Return a function that runs a command, which must refuse a file.

    Its arguments are a key of `COMMANDS` and the path of the file; it returns the error message.
    """
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drawn.toml").write_text(DRAWN)

    def refused(command, path):
        if command == "zenoh":
            pytest.importorskip("zenoh")
        assert main(COMMANDS[command].format(path).split()) == 2
        out, error = capfd.readouterr()
        assert out == ""
        assert error.startswith("spots: ")
        assert error.count("\n") == 1
        assert len(error) < 3000
        assert path.name in error
        return error

    return refused


@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize("kind", ["fifo", "endless"])
def test_what_is_no_regular_file_is_refused(tmp_path, refused, command, kind):
    path = tmp_path / "odd.toml"
    special(kind, path)
    assert "not a regular file" in refused(command, path)


@pytest.mark.parametrize("command", sorted(set(COMMANDS) - {"info", "replay", "export", "port"}))
def test_a_huge_file_is_refused_unread(tmp_path, refused, command):
    path = tmp_path / "odd.toml"
    special("huge", path)
    assert "is larger than" in refused(command, path)


@pytest.mark.parametrize("command", sorted(set(COMMANDS) - {"zenoh", "scenario"}))
def test_a_wrong_file_is_refused_before_a_board_is_opened(tmp_path, capsys, monkeypatch, command):
    def opened(*arguments, **options):
        raise AssertionError("a board was opened")

    monkeypatch.setattr(connect, "Board", opened)
    monkeypatch.setattr(virtual, "start_simulator", opened)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drawn.toml").write_text(DRAWN)
    path = tmp_path / "odd.toml"
    path.write_text("=\n")
    assert main(COMMANDS[command].format(path).split()) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert path.name in error


@pytest.mark.parametrize("kind", DEEP)
def test_depth_is_bounded(tmp_path, capsys, kind):
    path = tmp_path / "odd.toml"
    special(kind, path)
    assert main(["keys", "check", str(path)]) == 2
    error = capsys.readouterr().err
    assert str(path) in error
    assert error.count("\n") == 1
    assert "nested too deep" in error or kind == "quotes"


@pytest.mark.parametrize("command", TOML)
def test_depth_is_bounded_in_every_file(tmp_path, capsys, command):
    path = tmp_path / "odd.toml"
    special("key", path)
    assert main(COMMANDS[command].format(path).split()) == 2
    assert "nested too deep" in capsys.readouterr().err


def test_a_deep_zenoh_configuration_is_refused(tmp_path, refused):
    path = tmp_path / "odd.json5"
    path.write_text("[" * 50_000)
    assert "nested too deep" in refused("zenoh", path)


@pytest.mark.parametrize(
    "text",
    [
        'a = "' + "." * 1000 + '"',
        "a = '" + ". " * 1000 + "'",
        "a = [" + "1.5, " * 1000 + "]",
        "# " + "a." * 1000 + "\na = 1",
        'a = """\n' + "a." * 1000 + '"""""',
        "a = '''\n" + "a." * 1000 + "'''''",
        ".".join("a" * 20) + " = 1",
    ],
)
def test_dots_that_are_no_depth_are_taken(text):
    assert "a" in toml.loads(text)


def test_a_link_to_a_regular_file_is_read(tmp_path):
    (tmp_path / "real.toml").write_text("a = 1")
    (tmp_path / "link.toml").symlink_to("real.toml")
    assert toml.find(tmp_path / "link.toml", tmp_path, "x")[1] == "a = 1"


def test_a_folder_with_the_name_of_a_linkage_is_in_nobodys_way(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "default").mkdir()
    assert not mounted.is_mounted("default")


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("x", "board.toml: "),
        ('title = "Odd"', "board.toml: .*runtime"),
        ('title = "Odd"\nruntime = "basic"\n[device]', "board.toml: .*basic"),
        (f"{KEY} = 1", "board.toml: .*nested too deep"),
        (None, "board.toml is not a regular file"),
    ],
)
def test_what_is_wrong_with_a_board_is_said(tmp_path, monkeypatch, capsys, text, says):
    (tmp_path / "odd").mkdir()
    path = tmp_path / "odd" / "board.toml"
    if text is None:
        path.symlink_to("/dev/zero")
    else:
        path.write_text(text)
    monkeypatch.setattr(stage, "BOARDS", tmp_path)
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SpotsError, match=says):
        stage.device_of("odd")
    assert main(["build", "odd"]) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_a_long_mistake_is_quoted_in_part(tmp_path, capsys):
    path = tmp_path / "long.toml"
    path.write_text("a" * 100_000 + " = 1")
    assert main(["keys", "check", str(path)]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert len(error) < 3000


def test_the_points_of_a_linkage_are_still_read(tmp_path):
    path = tmp_path / "points.csv"
    path.write_text("\ufeff" + POINTS, encoding="utf-8")
    assert main(["twin", "--linkage", "default", "--calibrate", str(path)]) == 2
