"""Flashes a virtual board with an empty file system through its serial port."""

import io
import re
import shutil
import subprocess
import sys
from types import SimpleNamespace

import pytest
from mpremote.transport import TransportError
from mpremote.transport_serial import SerialTransport
from support.boards import refused, virtual_board
from support.refusals import refusal

import spots
from spots.advice import lamps
from spots.cli import main
from spots.deploy import flash as flashing
from spots.deploy import place
from spots.deploy import prompt as prompts
from spots.deploy.build import files_of
from spots.deploy.doctor import examine_board
from spots.deploy.prompt import Prompt
from spots.deploy.staging import device_of
from spots.errors import BoardError, PortError
from spots.link import serial_link as link

pytestmark = pytest.mark.usefixtures("shared_builds")


@pytest.fixture
def empty(tmp_path):
    """An empty folder that becomes the file system of a board."""
    folder = tmp_path / "board"
    folder.mkdir()
    return folder


@pytest.mark.board
def test_plain_mpremote_flashes_an_empty_board(empty, built):
    source = built("virtual")
    with virtual_board(empty) as port:
        command = [sys.executable, "-m", "mpremote", "connect", port]
        command += ["cp", "-r", "spots_device", "board_config.py", "spots.sha256", ":"]
        command += ["+", "cp", "main.py", ":"]
        run = subprocess.run(
            [*command, "+", "reset"], cwd=source, capture_output=True, text=True, timeout=120
        )
        assert run.returncode == 0, run.stdout + run.stderr
        with spots.open(port) as board:
            assert board.info["board"] == "virtual"
    assert files_of(empty) == files_of(source)


@pytest.mark.board
def test_twice_and_the_second_time_there_is_nothing_to_do(empty, built, capsys):
    (empty / "settings.txt").write_text("mine\n")
    (empty / "calibration.txt").write_text("mine too\n")
    (empty / "notes.py").write_text("the user's own")
    (empty / "spots_device" / "board").mkdir(parents=True)
    (empty / "spots_device" / "board" / "app.py").write_text("an older version")
    (empty / "spots_device" / "board" / "app.mpy.part").write_text("half")
    (empty / "spots_device" / "hers.py").write_text("the user's own")
    wanted = files_of(built("virtual"))
    with virtual_board(empty) as port:
        assert main(["flash", "virtual", "--port", port, "--dry-run"]) == 0
        said = capsys.readouterr().out
        assert "remove spots_device/board/app.py" in said
        assert "mip install" not in said  # the virtual board contains a substitute for the library
        assert (empty / "spots_device" / "board" / "app.py").exists()
        assert main(["flash", "virtual", "--port", port]) == 0
        said = capsys.readouterr().out
        assert f"{len(wanted)} files copied" in said
        assert port in said
        assert spots.__version__ in said
        assert main(["flash", "virtual", "--port", port]) == 0
        assert "nothing to copy" in capsys.readouterr().out
    own = {"settings.txt": b"mine\n", "calibration.txt": b"mine too\n"}
    own |= dict.fromkeys(("notes.py", "spots_device/hers.py"), b"the user's own")
    assert files_of(empty) == wanted | own


@pytest.mark.board
def test_unplugged_in_mid_copy_nothing_starts_and_again_completes(empty, built, capsys):
    wanted = files_of(built("virtual"))
    (empty / "main.py").write_text("print('the one before')")
    write = Prompt.write
    written = []
    with pytest.MonkeyPatch.context() as patch:

        def cut(prompt, path, data):
            written.append(path)
            if len(written) == 5:
                board.close()
            write(prompt, path, data)

        patch.setattr(Prompt, "write", cut)
        board = virtual_board(empty)
        port, board = board.__enter__(), _Closer(board)
        assert "was disconnected" in refused(capsys, "flash", "virtual", "--port", port)
    assert "main.py" not in files_of(empty)
    with virtual_board(empty) as port:
        assert main(["flash", "virtual", "--port", port]) == 0
    assert files_of(empty) == wanted | {"main.py.before-spots": b"print('the one before')"}


@pytest.mark.board
@pytest.mark.parametrize("flashed", [False, True])
def test_a_users_file_with_the_name_of_a_firmware_file_is_kept(empty, built, capsys, flashed):
    wanted = files_of(built("virtual"))
    if flashed:
        shutil.copytree(built("virtual"), empty, dirs_exist_ok=True)
    own = {"main.py": b"print('mine')", "board_config.py": b"NAME = 'mine'"}
    kept = {f"{path}.before-spots2": data for path, data in own.items()}
    kept["main.py.before-spots"] = kept["board_config.py.before-spots"] = b"older"
    for path, data in (own | kept).items():
        if not path.endswith("2"):
            (empty / path).write_bytes(data)
    before = files_of(empty)
    with virtual_board(empty) as port:
        assert main(["flash", "virtual", "--port", port, "--dry-run"]) == 0
        assert "rename main.py to main.py.before-spots2\n" in capsys.readouterr().out
        assert files_of(empty) == before
        assert main(["flash", "virtual", "--port", port]) == 0
        said = capsys.readouterr().out
        assert "your main.py is now main.py.before-spots2\n" in said
        assert said.index("your main.py") < said.index("your board_config.py")
        assert files_of(empty) == wanted | kept
        assert main(["flash", "virtual", "--port", port]) == 0
        assert "nothing to copy" in capsys.readouterr().out
        assert main(["erase", "virtual", "--port", port, "--yes"]) == 0
    assert files_of(empty) == kept


@pytest.mark.board
def test_the_firmware_of_before_does_not_answer_for_the_new_one(empty, built, monkeypatch):
    shutil.copytree(built("virtual"), empty, dirs_exist_ok=True)
    monkeypatch.setattr(place, "_RETURN_S", 1.0)
    monkeypatch.setattr(flashing, "__version__", "9.9")
    with virtual_board(empty) as port:
        there = place.Place(port, None, lambda: [port])
        with refusal(PortError):
            flashing._greet(there)


class _Closer:
    def __init__(self, context):
        self._context = context

    def close(self):
        self._context.__exit__(None, None, None)


@pytest.mark.board
def test_a_late_answer_of_the_prompt_is_not_taken_for_the_answer_to_a_later_try(empty, monkeypatch):
    enter, tries = SerialTransport.enter_raw_repl, []

    def late(transport, **options):
        tries.append(options)
        if len(tries) == 1:  # the board receives the request, but answers after the timeout
            transport.serial.write(b"\r\x03\r\x01")
            raise TransportError("could not enter raw repl")
        enter(transport, **options)

    monkeypatch.setattr(SerialTransport, "enter_raw_repl", late)
    with virtual_board(empty) as port:
        for _ in range(3):
            tries.clear()
            prompt = Prompt(port)
            assert prompt.facts["runtime"] == "micropython"
            assert prompt.run("print(6 * 7)").strip() == "42"
            prompt.close()


@pytest.mark.board
@pytest.mark.parametrize(
    ("number", "sentence", "operation", "form"),
    [
        (28, "the board has a full file system: remove", "run", "{0}"),
        (28, "the board has a full file system: remove", "write", "{0}, 'text'"),
        (30, "the board has a read-only file system: reset", "run", "{0}, 'text'"),
        (5, "input/output error: replug the board, and run", "write", "{0}"),
    ],
)
def test_an_error_of_the_boards_file_system_is_said_in_words(
    empty, number, sentence, operation, form
):
    fails = f"raise OSError({form.format(number)})\n"
    with virtual_board(empty) as port, Prompt(port) as prompt:
        if operation == "write":  # as mpremote writes: it raises an OSError itself
            prompt.run(f"def open(*arguments):\n {fails}")
        arguments = ("a.txt", b"some") if operation == "write" else (fails,)
        with pytest.raises(spots.SpotsError) as raised:
            getattr(prompt, operation)(*arguments)
    assert sentence in str(raised.value)
    assert "disconnected" not in str(raised.value)
    assert not re.search(r"\d", str(raised.value).replace(port, ""))


@pytest.mark.board
def test_a_full_disk_in_mid_copy(empty, capsys, monkeypatch):
    write = Prompt.write

    def full(prompt, path, data):
        if path == "spots_device/board/app.mpy":
            prompt.run("raise OSError(28)")
        write(prompt, path, data)

    monkeypatch.setattr(Prompt, "write", full)
    with virtual_board(empty) as port:
        assert "has a full file system" in refused(capsys, "flash", "virtual", "--port", port)
    assert "main.py" not in files_of(empty)


@pytest.mark.board
def test_a_full_littlefs_has_no_negative_number_of_bytes(empty, capsys, monkeypatch):
    monkeypatch.setattr(prompts, "_FACTS", prompts._FACTS.replace("_s[1] * _s[3]", "-40960"))
    with virtual_board(empty) as port:
        assert "has 0 bytes free" in refused(capsys, "flash", "virtual", "--port", port)


@pytest.mark.board
def test_too_little_room_is_seen_before_anything_is_touched(empty, capsys, monkeypatch):
    started = Prompt.__init__

    def small(prompt, port):
        started(prompt, port)
        prompt.facts["free"] = 1000

    monkeypatch.setattr(Prompt, "__init__", small)
    (empty / "main.py").write_text("print('the one before')")
    with virtual_board(empty) as port:
        assert "1000 bytes free" in refused(capsys, "flash", "virtual", "--port", port)
    assert set(files_of(empty)) == {"main.py"}


@pytest.mark.board
def test_a_dry_run_without_hardware(capsys):
    assert main(["flash", "virtual", "--dry-run"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[-2].startswith("copy main.py")  # the last file, after all others


@pytest.mark.board
@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"runtime": "circuitpython"}, "other_runtime"),
        ({"version": (1, 22, 2)}, "old_runtime"),
        ({"mpy": (5, 4)}, "old_runtime"),
        ({"mpy": (6, 10)}, "other_board"),
    ],
)
def test_a_board_that_will_not_do(changed, why, built):
    facts = {"runtime": "micropython", "version": (1, 23, 0), "mpy": (6, 4)}
    files = files_of(built("pico"))
    flashing.refuse(facts, device_of("pico"), files, "/dev/x")
    with refusal(BoardError, why=why):
        flashing.refuse(facts | changed, device_of("pico"), files, "/dev/x")


def test_no_board_and_two_boards(capsys, monkeypatch):
    ports = []
    monkeypatch.setattr(link, "usb_ports", lambda: ports)
    assert "no board found" in refused(capsys, "flash", "pico")
    ports += [SimpleNamespace(device=name, serial_number=None) for name in ("/dev/a", "/dev/b")]
    assert "--port: /dev/a, /dev/b" in refused(capsys, "flash", "pico")


@pytest.mark.board
def test_no_mpremote_says_how_to_get_it(capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "mpremote.transport", None)
    assert '[flash]"' in refused(capsys, "flash", "pico", "--port", "/dev/x")


@pytest.mark.board
def test_a_port_that_may_not_be_opened(capsys, monkeypatch):
    def denied(*arguments, **named):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(link.serial, "Serial", denied)
    monkeypatch.setattr(sys, "platform", "linux")
    usb = SimpleNamespace(device="/dev/null", vid=0x2E8A, serial_number="1")
    monkeypatch.setattr(link, "usb_ports", lambda: [usb])
    line = refused(capsys, "flash", "pico", "--port", "/dev/null")
    assert "no permission to open" in line
    assert 'idVendor}=="2e8a"' in line
    assert 'idVendor}=="2e8a"' in refused(capsys, "monitor", "--port", "/dev/null")
    assert main(["doctor", "--port", "/dev/null"]) == 2
    assert 'idVendor}=="2e8a"' in capsys.readouterr().out.splitlines()[-1]


@pytest.mark.board
def test_erase_takes_what_is_ours_and_asks_first(empty, built, capsys, monkeypatch):
    shutil.copytree(built("virtual"), empty, dirs_exist_ok=True)
    for name in ("settings.txt", "saved-b.txt", "layout1-a.txt", "notes.py"):
        (empty / name).write_text("")
    monkeypatch.setattr(sys.stdin, "isatty", lambda: False)
    with virtual_board(empty) as port:
        assert "--yes" in refused(capsys, "erase", "virtual", "--port", port)
        assert (empty / "main.py").exists()
        assert main(["erase", "virtual", "--port", port, "--yes"]) == 0
        assert [path.name for path in empty.iterdir()] == ["notes.py"]
        assert main(["erase", "virtual", "--port", port, "--yes"]) == 0
        assert "nothing to remove" in capsys.readouterr().out


@pytest.mark.board
def test_erase_takes_nothing_from_a_board_that_never_had_our_firmware(empty, capsys):
    for name in ("main.py", "board_config.py", "settings.txt"):
        (empty / name).write_text("the user's own")
    before = files_of(empty)
    with virtual_board(empty) as port:
        assert main(["erase", "virtual", "--port", port, "--yes"]) == 0
    assert "nothing to remove" in capsys.readouterr().out
    assert files_of(empty) == before


@pytest.mark.board
@pytest.mark.parametrize("typed", ["n\n", ""])
def test_erase_takes_all_but_yes_for_no(empty, built, capsys, monkeypatch, typed):
    shutil.copytree(built("virtual"), empty, dirs_exist_ok=True)
    before = files_of(empty)
    person = io.StringIO(typed)
    person.isatty = lambda: True
    monkeypatch.setattr(sys, "stdin", person)
    with virtual_board(empty) as port:
        assert "nothing was removed" in refused(capsys, "erase", "virtual", "--port", port)
    assert files_of(empty) == before


@pytest.mark.board
def test_a_doctor_for_a_healthy_board(capsys):
    for _ in range(3):  # if the machine stalls, the sensor seems to have stopped
        capsys.readouterr()
        code = main(["doctor", "--port", "virtual"])
        if code == 0:
            break
    assert code == 0
    lines = [line.split()[:2] for line in capsys.readouterr().out.splitlines()]
    # The result of the first light check depends on whether the simulated finger touches then.
    assert [line for n, line in enumerate(lines) if line not in lines[:n]] == [
        ["ok", check]
        for check in ("hello", "firmware", "sensor", "light", "fit", "lamps", "rate", "calibrated")
    ]


@pytest.fixture
def no_lamps(monkeypatch):
    monkeypatch.setattr(lamps, "mains_hz", lambda board: 0)


@pytest.mark.usefixtures("no_lamps")
def test_a_doctor_counts_readings_of_many_exposures_and_waits_for_them():
    class Blinks(Patient):
        def spectra(self, seconds):
            assert seconds > 12 * 0.64
            dark_us, lit_us = range(0, 50_000, 10_000), range(400_000, 4_880_000, 640_000)
            at_us = [*((t_us, 1 << 7) for t_us in dark_us), *((t_us, 0) for t_us in lit_us)]
            for i, (t_us, flags) in enumerate(at_us):
                yield spots.Spectrum(0, i, t_us, flags, 9, (500,) * 6, 100.0)

    (rate,) = [found for found in examine_board(Blinks(average=64)) if found.check == "rate"]
    assert rate.ok
    assert rate.text == "1.6 readings a second of 1.6 that exposure and average allow"


class Patient:
    """A substitute for `Board` with a given state; each call of its clock takes a second."""

    def __init__(
        self,
        firmware=spots.__version__,
        fault=None,
        counts=(500,) * 6,
        led_mA=20,
        step=10,
        average=1,
        lost=frozenset(),
    ):
        self.info = {"board": "pico", "runtime": "micropython", "id": "1", "firmware": firmware}
        self._state = {"fault": fault, "exposure_us": 10_000, "full_scale": 1000, "dark": [0] * 6}
        self._state |= {"average": average, "led_mA": led_mA, "led": "ldr", "missed": 0}
        self._state |= {"mains_hz": 0, "keys": 0, "channels": ["F3", "F4", "F5", "F6", "F7", "F8"]}
        self._spectra = [
            spots.Spectrum(0, i, i * step * 1000, 0, 9, counts, 100.0)
            for i in range(12)
            if i not in lost
        ]
        self._now_s = 0.0

    def now_s(self):
        self._now_s += 1
        return self._now_s

    def command(self, line, timeout_s=None):
        return self._state

    def spectra(self, seconds):
        return iter(self._spectra)

    def frames(self, seconds):
        return iter(self._spectra)


@pytest.mark.parametrize(
    ("ill", "check", "advice"),
    [
        ({"firmware": "0.0.1"}, "firmware", "spots flash pico"),
        ({"fault": "no answer"}, "sensor", "no answer: check SDA"),
        ({"counts": (0,) * 6}, "light", "check the wire from LDR"),
        ({"counts": (990,) * 6}, "light", "99.0 %"),
        ({"led_mA": 0}, "light", "set led_mA"),
        ({"step": 20, "lost": {4, 7, 8}}, "rate", "50.0 readings a second"),
        ({"step": 20}, "rate", "50.0 readings a second"),
        (
            {"step": 80, "average": 4},
            "rate",
            "12.5 readings a second of 25.0 that exposure and average allow",
        ),
    ],
)
@pytest.mark.usefixtures("no_lamps")
def test_a_doctor_for_an_ill_board(ill, check, advice):
    problems = [found for found in examine_board(Patient(**ill)) if not found.ok]
    assert [found.check for found in problems] == [check]
    assert advice in problems[0].text
    healthy = list(examine_board(Patient()))
    assert all(found.ok for found in healthy)
    assert healthy[-1] == ("calibrated", True, "not yet; next: spots calibrate")


def test_a_doctor_without_a_port(capsys, monkeypatch):
    assert main(["doctor", "--port", "/dev/ttyNOPE"]) == 2
    assert capsys.readouterr().out.startswith("problem  port")
    monkeypatch.setattr(link, "usb_ports", list)
    assert main(["doctor"]) == 2
    assert "no board found" in capsys.readouterr().out
