"""Documents point at what exists, and what they show runs."""

from __future__ import annotations

import ast
import importlib
import importlib.metadata
import os
import re
import shlex
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from spots.cli import _parser

ROOT = Path(__file__).parents[1]
FILES = subprocess.run(
    ["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True
).stdout.split()
# What is there now; the changes name what was there once.
PRESENT = [name for name in FILES if name != "CHANGELOG.md"]
LINK = re.compile(r"\]\(([^)#\s]+)(?:#([^)]+))?\)")
NAMED = re.compile(r"`((?:host|firmware|tests|docs|boards|examples)/[a-z0-9_./-]+)`")
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"`(spots [a-z][^`]*)`")
# Words that stand for others, and what may be left out.
PLACEHOLDER = re.compile(r"…|\.\.\.|\[|\||\b[A-Z]{2,}\b(?![a-z])")
TIMEOUT_S = 120
# What does not end by itself or judges the speed of this computer, and what it prints first.
ENDLESS = {
    "spots demo --page": "http://",
    "spots serve --port virtual": "http://",
    "spots monitor --port virtual": " mm",
    "spots publish --port virtual": "publish",
    "spots controller --port virtual --dry-run": "x",
    "spots twin --port virtual": "terminal",
    "spots doctor --port virtual": "hello",
    "spots keyboard --layout mini --dry-run --port virtual": "down",
    "python": " ",
}


def blocks(name):
    return BLOCK.findall((ROOT / name).read_text(encoding="utf-8"))


def shell_lines(name):
    """Return the lines of a document's shell blocks, without their comments."""
    lines = [line for kind, text in blocks(name) if kind == "sh" for line in text.splitlines()]
    bare = [re.sub(r"\s+#.*$", "", line) for line in lines]
    return [one.strip() for line in bare for one in line.split("&&") if one.strip()]


@pytest.mark.parametrize("name", FILES)
def test_links_and_named_files_exist(name):
    text = (ROOT / name).read_text(encoding="utf-8")
    folder = (ROOT / name).parent
    missing = [
        link
        for link, _ in LINK.findall(text)
        if not link.startswith(("http:", "https:")) and not (folder / link).exists()
    ]
    named = NAMED.findall(text) if name in PRESENT else []
    missing += [path for path in named if not (ROOT / path).exists()]
    assert missing == []


def parser_says(words, capsys):
    """Return the parser's exit code and what it prints."""
    code = 0
    try:
        _parser().parse_args(words)
    except SystemExit as end:
        code = end.code
    return code, "".join(capsys.readouterr())


@pytest.mark.parametrize("name", PRESENT)
def test_the_parser_takes_each_command(name, capsys):
    text = (ROOT / name).read_text(encoding="utf-8")
    refused = []
    for line in shell_lines(name):
        command, *words = shlex.split(line)
        assert command != ".venv/bin/spots", "the README activates .venv once"
        if command == "spots" and not PLACEHOLDER.search(line):
            code, said = parser_says(words, capsys)
            refused += [(line, said)] if code else []
    for line in COMMAND.findall(text):
        # In running text it may be a part of one: its name and its options have to exist.
        words = shlex.split(line)[1:]
        if parser_says(words, capsys)[0]:
            code, said = parser_says([words[0], "--help"], capsys)
            options = re.findall(r"(?<!\S)--[a-z-]+", line)
            refused += [(line, one) for one in options if code or one not in said]
            refused += [(line, said)] if code else []
    assert refused == []


@pytest.mark.parametrize("name", PRESENT)
def test_each_import_of_a_snippet_resolves(name):
    for kind, text in blocks(name):
        if kind != "python":
            continue
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    importlib.import_module(alias.name)
            elif isinstance(node, ast.ImportFrom):
                module = importlib.import_module(node.module)
                assert [alias.name for alias in node.names if not hasattr(module, alias.name)] == []


@pytest.mark.parametrize("name", PRESENT)
def test_make_has_each_target(name):
    lines = [line for line in shell_lines(name) if line.startswith("make ")]
    for line in lines:
        run = subprocess.run(["make", "-n", *shlex.split(line)[1:]], cwd=ROOT, capture_output=True)
        assert run.returncode == 0, (line, run.stderr)


def test_each_extra_that_is_named_exists():
    extras = set(importlib.metadata.metadata("spots-tactile").get_all("Provides-Extra"))
    for name in PRESENT:
        text = (ROOT / name).read_text(encoding="utf-8")
        for named in re.findall(r"(?:spots-tactile|-e \.)\[([a-z,]+)\]", text):
            assert set(named.split(",")) <= extras, name


def _installed_by_make_demo():
    """Return the names of the distributions, by what the Makefile asks pip for."""
    recipe = (ROOT / "Makefile").read_text(encoding="utf-8").split("\n.venv/demo:")[1]
    extras = ",".join(re.findall(r"'\.\[([a-z,]+)\]'", recipe.split("\n\n")[0]))
    found, wanted = set(), [Requirement(f"spots-tactile[{extras}]")]
    while wanted:
        one = wanted.pop()
        name = re.sub(r"[-_.]+", "-", one.name).lower()
        key = name, tuple(sorted(one.extras))
        if key in found:
            continue
        found.add(key)
        try:
            requires = importlib.metadata.requires(name) or []
        except importlib.metadata.PackageNotFoundError:
            continue  # for another machine
        wanted += [
            need
            for need in map(Requirement, requires)
            if need.marker is None
            or any(need.marker.evaluate({"extra": extra}) for extra in ("", *one.extras))
        ]
    return {name for name, _ in found}


HIDE = """
import sys
class Hide:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {hidden!r}:
            raise ModuleNotFoundError("No module named " + repr(name), name=name)
sys.meta_path.insert(0, Hide())
"""


@pytest.fixture(scope="module")
def newcomer(tmp_path_factory):
    """A folder to work in, and an environment with the packages of `make demo` alone."""
    folder = tmp_path_factory.mktemp("newcomer")
    installed = _installed_by_make_demo()
    hidden = {
        module
        for module, distributions in importlib.metadata.packages_distributions().items()
        if not installed & {re.sub(r"[-_.]+", "-", one).lower() for one in distributions}
    } - {"pip", "setuptools", "__pycache__"}
    assert {"scipy", "matplotlib", "pytest"} <= hidden
    assert not {"spots", "serial", "aiohttp"} & hidden
    (folder / "sitecustomize.py").write_text(HIDE.format(hidden=hidden), encoding="utf-8")
    path = os.pathsep.join([str(Path(sys.executable).parent), os.environ["PATH"]])
    return folder, os.environ | {"PYTHONPATH": str(folder), "PATH": path, "BROWSER": "true"}


def run(words, said, newcomer):
    """Run to the end, or until it says so and Ctrl-C; return its output."""
    folder, environment = newcomer
    process = subprocess.Popen(
        words,
        cwd=folder,
        env=environment | {"PYTHONUNBUFFERED": "1"},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    timer = threading.Timer(TIMEOUT_S, process.kill)
    timer.start()
    lines, awaited = [], said
    for line in process.stdout:
        lines.append(line)
        if awaited and awaited in line:
            process.send_signal(signal.SIGINT)
            awaited = ""
    timer.cancel()
    output = "".join(lines)
    assert not awaited, output
    assert process.wait() in ((0, 130, -signal.SIGINT) if said else (0,)), output
    return output


# In the order in which they stand there: some work on what earlier ones left.
@pytest.mark.parametrize("line", [one for one in shell_lines("README.md") if "spots " in one])
def test_a_line_of_the_readme_runs_after_make_demo(line, newcomer):
    words = shlex.split(line)
    if words[1] == "serve":
        words += ["--http-port", "0"]  # other programs may have the usual one
    output = run(words, ENDLESS.get(line, ""), newcomer)
    assert "Traceback" not in output


def walk():
    """Return the lines of hardware.md's list, as it says to change them for a virtual board."""
    text = (ROOT / "docs/hardware.md").read_text(encoding="utf-8")
    steps = text.split("## From bare board to key press\n")[1].split("\n## ")[0]
    numbers = [int(number) for number in re.findall(r"^(\d+)\. ", steps, re.MULTILINE)]
    assert numbers == list(range(1, len(numbers) + 1))
    inside = re.findall(r"^ +```sh\n(.*?)^ +```$", steps, re.MULTILINE | re.DOTALL)
    lines = [line.strip() for block in inside for line in block.splitlines()]
    assert "spots flash pico" in lines
    for line in lines:
        if line == "spots flash pico":
            yield "spots flash virtual --dry-run"
        else:
            yield line if line == "spots ports" else line + " --port virtual"


@pytest.mark.parametrize("line", list(walk()))
def test_a_step_from_bare_board_to_key_press_runs_on_a_virtual_board(line, newcomer):
    output = run(shlex.split(line), ENDLESS.get(line, ""), newcomer)
    assert "Traceback" not in output


@pytest.mark.parametrize("text", [text for kind, text in blocks("README.md") if kind == "python"])
def test_a_program_of_the_readme_runs_after_make_demo(text, newcomer):
    run([sys.executable, "-c", text], ENDLESS["python"], newcomer)
