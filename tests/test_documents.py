"""Documents refer to existing things, and their examples are valid; see also cli/test_readme.py."""

from __future__ import annotations

import ast
import importlib
import importlib.metadata
import importlib.util
import re
import shlex
import shutil
import subprocess
import sys

import pytest
from support.documents import ROOT, blocks, shell_lines
from support.environments import required

from spots.cli import _parser
from spots.common import toml

FILES = subprocess.run(
    ["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True
).stdout.split()
# Documents about the present state. The change log also names things that no longer exist.
PRESENT = [name for name in FILES if name != "CHANGELOG.md"]
# A package in `examples` adds commands, and is not installed here.
COMMANDS = [name for name in PRESENT if not name.startswith("examples/")]
LINK = re.compile(r"\]\(([^)#\s]+)(?:#([^)]+))?\)")
NAMED = re.compile(r"`((?:host|firmware|tests|docs|boards|examples)/[a-z0-9_./-]+)`")
DOTTED = re.compile(r"`(spots(?:_\w+)?(?:\.[a-z]\w*)+(?:\.\w+)*)")
GROUPS = {"spots.abilities", "spots.commands", "spots.panels", "spots.ports"}  # of entry points
COMMAND = re.compile(r"`(spots [a-z][^`]*)`")
# Placeholders such as FILE, and optional parts such as [--json].
PLACEHOLDER = re.compile(r"…|\.\.\.|\[|\||\b[A-Z]{2,}\b(?![a-z])")


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
    """Parse words of a command line; return the parser's exit code and its output."""
    code = 0
    try:
        _parser().parse_args(words)
    except SystemExit as end:
        code = end.code
    return code, "".join(capsys.readouterr())


@pytest.mark.board
@pytest.mark.parametrize("name", COMMANDS)
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
        # In running text, a command may be incomplete, but its name and its options must exist.
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


def resolves(dotted):
    """Return whether a dotted name is a module, or something in one."""
    module, *rest = dotted.split(".")
    found = importlib.import_module(module)
    for part in rest:
        module = f"{module}.{part}"
        if not hasattr(found, part) and not importlib.util.find_spec(module):
            return False
        found = getattr(found, part, None) or importlib.import_module(module)
    return True


@pytest.mark.parametrize("name", PRESENT)
def test_each_dotted_name_of_ours_exists(name):
    text = (ROOT / name).read_text(encoding="utf-8")
    named = {*DOTTED.findall(text)} - GROUPS
    assert [one for one in named if not resolves(one)] == []


@pytest.mark.board
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
        for named in re.findall(r"(?:spots-tactile|-e \.)\[([a-z0-9,]+)\]", text):
            assert set(named.split(",")) <= extras, name


INSTALL = re.compile(r"pip install ([^`\n,;:]*\[.*?\]['\"]?)")


@pytest.mark.parametrize("name", PRESENT)
def test_extras_are_installed_from_a_checkout_in_any_shell(name):
    # Single quotes fail in cmd.exe, and none in zsh. The package is on no package index.
    text = (ROOT / name).read_text(encoding="utf-8")
    known = {
        *toml.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"][
            "optional-dependencies"
        ]
    }
    for words in INSTALL.findall(text):
        extras = re.fullmatch(r'-e "\.\[([a-z0-9,]+)\]"', words)
        assert extras, words
        assert {*extras[1].split(",")} <= known


def test_the_sizes_of_extras_are_those_of_their_packages():
    text = (ROOT / "docs/try/index.md").read_text(encoding="utf-8")
    ours = importlib.metadata.distribution("spots-tactile")
    sizes = re.findall(r"`\.\[([a-z,]+)\]`[^`()]*\((\d\.\d) GB\)", text)
    assert len(sizes) == 2
    for extras, shown in sizes:
        files = [f for d in required(ours, extras.split(",")).values() for f in d.files]
        # pip adds compiled modules, of which it stores no size.
        assert float(shown) == pytest.approx(sum(f.size or 0 for f in files) / 1e9, rel=0.25)


@pytest.mark.parametrize("name", ["docs/build/index.md", "docs/build/wiring.md"])
def test_the_first_wiring_is_that_of_the_first_breakout(name):
    text = (ROOT / "docs/build/parts.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| AS7341 breakout \| (.*?) \| 1 \|", text, re.MULTILINE)
    (breakout,) = (row for row in rows if "[" not in row)
    (kinds,) = re.findall(rf"^\| {breakout} .*\| (.*) \|$", text, re.MULTILINE)
    led = re.search(r"`(\w+)`", kinds)[1]
    drawn = re.search(r"\(\S*wiring-pico-?(\w*)\.svg\)", (ROOT / name).read_text(encoding="utf-8"))
    assert drawn[1] == led == "gpio"
    picture = (ROOT / "docs/pictures/wiring-pico-gpio.svg").read_text(encoding="utf-8")
    resistors = re.findall(r">(\d+ k?Ω)<", picture)
    assert len(resistors) == 2
    assert all(value in text for value in resistors)


def row(name, text):
    """Return the cells of the table's row with this name, except the name."""
    (line,) = re.findall(rf"^\| {name} \| (.*) \|$", text, re.MULTILINE)
    return [cell.strip() for cell in line.split("|")]


@pytest.mark.parametrize(
    ("name", "measured"),
    {
        "position accuracy": "Position accuracy",
        "position resolution": "Position resolution",
        "force accuracy": "Force accuracy",
        "angle of a joint, accuracy": "Joint: accuracy",
    }.items(),
)
def test_the_figures_of_the_readme_are_the_measured_ones(name, measured):
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    evidence = (ROOT / "docs/evidence/paper.md").read_text(encoding="utf-8")
    _, *figures, _ = row(measured, evidence)
    assert row(name, readme) == figures


def test_the_readme_fits_a_screen():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len([word for word in text.split() if re.search(r"\w", word)]) <= 700


@pytest.mark.board
@pytest.mark.parametrize("minor", [9, 11])
def test_make_replaces_an_environment_of_an_older_python(minor, tmp_path):
    """Fails if make goes on with a Python that is too old, or with an environment of it."""
    shutil.copy(ROOT / "Makefile", tmp_path)
    (tmp_path / "pyproject.toml").touch()

    def python(path, minor):
        """Write a stand-in: it is of a version, and it sets up environments."""
        path.parent.mkdir(parents=True, exist_ok=True)
        code = f"import sys; sys.version_info = (3, {minor}); exec(sys.argv[1])"
        path.write_text(
            f'#!/bin/sh\ncase "$1" in\n-c) exec {sys.executable} -c "{code}" "$2";;\n'
            f"-m) [ $2 = venv ] && mkdir -p $3/bin && ln $0 $3/bin/python;;\nesac\nexit 0\n"
        )
        path.chmod(0o755)

    python(tmp_path / "python3", minor)
    python(tmp_path / ".venv/bin/python", 9)
    (tmp_path / ".venv/old").touch()
    make = ["make", "-C", str(tmp_path), ".venv/demo", "PYTHON=./python3"]
    run = subprocess.run(make, capture_output=True, text=True, check=False)
    assert (run.returncode == 0) == (tmp_path / ".venv/demo").exists() == (minor >= 10)
    assert (tmp_path / ".venv/old").exists() == (minor < 10)
    assert ("SPOTS needs Python 3.10 or newer, and ./python3 is 3.9: " in run.stderr) == (
        minor < 10
    )
