"""The commands and programs of the documents run on a virtual board.

tests/cli/test_readme.py runs those of README, and tests/top those of the pages about Python.
"""

from __future__ import annotations

import ast
import contextlib
import io
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from textwrap import dedent

import pytest
from make import build_site
from support.documents import PRINTED, check_printed
from support.readme import LINES, walk

from spots.cli import main

pytestmark = pytest.mark.board
MINI = build_site.ROOT / "host/spots/keyboard/layouts/mini.toml"
DATA = Path(__file__).parents[1] / "data"
RUN = DATA / "run.spots"
# Nothing of a page leaves this computer.
ZENOH = '{scouting: {multicast: {enabled: false}}, listen: {endpoints: ["tcp/127.0.0.1:0"]}}'
LSL = "[multicast]\nResolveScope = machine\n[log]\nlevel = -2\n"
TIMEOUT_S = 120
# A comment before a block explains why it does not run here.
BLOCK = re.compile(
    r"^(?: *<!-- not run: (?P<why>[^\n]+) -->\n)? *```(?P<kind>sh|python)\n(?P<text>.*?)^ *```"
    + PRINTED,
    re.MULTILINE | re.DOTALL,
)
# The layout that a page tells to save.
SAVED = re.compile(r"Save this as `mine\.toml`.*?^```toml\n(.*?)^```", re.MULTILINE | re.DOTALL)
# Commands that do not end by themselves: they are interrupted after their first line of output.
ENDLESS = re.compile(r"spots (serve|monitor|publish|subscribe|twin(?!.* --mjcf)|demo --page)\b")
# Half a minute of the simulated stage each; tests/calibrate runs these commands with these options.
MEASURES = re.compile(r"spots (characterize|demo .*--rezero)\b")
# Of a page's own test.
ELSEWHERE = {"build/first-press.md"}
PAGES = [page for page, kind in build_site.pages().items() if kind != "evidence"]


def blocks(kind):
    """Yield (page, text, shown output) of each block of a kind that runs here."""
    for page in PAGES:
        if page not in ELSEWHERE:
            for block in BLOCK.finditer(build_site.source(page).read_text(encoding="utf-8")):
                if block["kind"] == kind and not block["why"]:
                    yield page, dedent(block["text"]), block["printed"]


def commands():
    """Return each command of `spots` one time, with a page that has it, and the shown output."""
    found = {}
    for page, text, printed in blocks("sh"):
        for line in text.splitlines():
            command = re.sub(r"\s+#.*$", "", line).strip()
            if command in {*LINES, *walk()} or not command.startswith("spots "):
                continue
            if MEASURES.match(command):
                continue
            if printed or command not in found:
                found[command] = page, printed
    return found


def prints(program):
    """Return whether a program prints, not counting its functions and classes."""
    run = (one for one in ast.parse(program).body if not hasattr(one, "decorator_list"))
    return any("print(" in ast.unparse(one) for one in run)


def virtual(command):
    """Return the words of a command, on a virtual board unless it needs none."""
    words = shlex.split(command)[1:]
    if words[0] == "serve":
        words += ["--http-port", "0"]
    words = ["foxglove=127.0.0.1:0" if word == "foxglove" else word for word in words]
    on_board = words[0] in ("command", "doctor", "monitor", "publish", "record", "rezero", "serve")
    return words if not on_board or "--port" in words else [*words, "--port", "virtual"]


COMMANDS = commands()


class Interrupting(io.StringIO):
    """Output of a command, with Ctrl-C at the end of its first line."""

    lines = False

    def write(self, text):
        written = super().write(text)
        if "\n" in text and not self.lines:
            self.lines = True
            os.kill(os.getpid(), signal.SIGINT)
        return written


@pytest.mark.parametrize("command", COMMANDS)
def test_a_command_of_a_page_runs(command, tmp_path, monkeypatch, capfd):
    for name in ("run.spots", "first.spots"):
        if f"record {name}" not in command:
            shutil.copy(RUN, tmp_path / name)
    page, shown = COMMANDS[command]
    saved = SAVED.search(build_site.source(page).read_text(encoding="utf-8"))
    (tmp_path / "mine.toml").write_text(saved[1] if saved else MINI.read_text("utf-8"), "utf-8")
    shutil.copy(DATA / "linkage.toml", tmp_path / "arm.toml")
    (tmp_path / "zenoh.json5").write_text(ZENOH)
    (tmp_path / "lsl.cfg").write_text(LSL)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("ZENOH_CONFIG", "zenoh.json5")
    monkeypatch.setenv("LSLAPICFG", "lsl.cfg")
    monkeypatch.setattr(sys, "stdin", open(os.devnull))
    if not ENDLESS.match(command):
        assert main(virtual(command)) == 0
        check_printed(shown, "".join(capfd.readouterr()))
        return
    output = Interrupting()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(output):
        assert main(virtual(command)) in (0, 130)
    assert output.lines
    check_printed(shown, output.getvalue())


# A program of a page opens the board on USB, here a virtual one.
ON_VIRTUAL = """\
import spots
real_open = spots.open
spots.open = lambda port=None: real_open(port or "virtual")
"""
BETWEEN = "-- the next program --"
PROGRAMS = dict.fromkeys(page for page, *_ in blocks("python") if not page.startswith("program/"))


@pytest.mark.parametrize("page", PROGRAMS)
def test_the_programs_of_a_page_run_one_after_the_other(page, tmp_path):
    shutil.copy(RUN, tmp_path)
    programs, shown = zip(*(found for one, *found in blocks("python") if one == page))
    whole = f'\nprint("{BETWEEN}")\n'.join([ON_VIRTUAL, *programs])
    (tmp_path / "program.py").write_text(whole, encoding="utf-8")
    run = subprocess.run(
        [sys.executable, "program.py"],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=TIMEOUT_S,
    )
    assert run.returncode == 0, run.stderr
    _, *printed = run.stdout.split(f"{BETWEEN}\n")
    assert [text for text, out in zip(programs, printed) if prints(text) and not out] == []
    for one, out in zip(shown, printed):
        check_printed(one, out)


def test_a_block_is_left_out_only_with_a_reason():
    text = "<!-- not run: why -->\n```sh\nspots a\n```\n\n```sh\nspots b\n```\n"
    assert [block["why"] for block in BLOCK.finditer(text)] == ["why", None]
    assert len(commands()) > 20
