"""Imports between packages: allowed by the table in ARCHITECTURE.md, whose rows are the rooms."""

from __future__ import annotations

import ast
import re
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
HOST = ROOT / "host"
ROW = re.compile(r"^\| `?([\w/]+?)/?`? \| .* \| (.*) \|$", re.MULTILINE)
FIRMWARE = ROOT / "firmware"
PATHS = [(HOST, p) for p in HOST.rglob("*.py")]
PATHS += [(FIRMWARE, p) for p in (FIRMWARE / "spots_device").rglob("*.py")]
NAMES = {".".join(p.relative_to(top).with_suffix("").parts): p for top, p in PATHS}
MODULES = {name.removesuffix(".__init__"): path for name, path in NAMES.items()}
FUNCTION = (ast.FunctionDef, ast.AsyncFunctionDef)
OURS = "spots_device", *(path.name for path in HOST.iterdir() if path.is_dir())
SOURCES = ".py", ".js", ".html", ".css"
OPTIONAL = "aiohttp", "mcap"  # packages that only some functions need
LINES_MAX = 400
# A table may be longer: the keys of files, with their limits.
TABLES = {"spots_sim/strip/files.py"}


def rules():
    table = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8")
    found: dict[str, set[str]] = {}
    for room, may in ROW.findall(table):
        if room != "room":
            above = set(found) if "all rooms above" in may else set()
            named = set(re.findall(r"[\w/]+", may)) - {"all", "rooms", "above"}
            # The name of a package stands for all of its rooms.
            within = {one for one in found if one.split("/")[0] in named}
            # Every room of a package may use what its package itself defines, such as a version.
            own = {room.split("/")[0]} & {*OURS}
            found[room] = above | named | within | own
    return found


def room(module):
    top, *inner = module.split(".")
    if top != "spots":
        inside = inner and (MODULES[top].parent / inner[0]).is_dir()
        return f"{top}/{inner[0]}" if inside else top
    if not inner or inner == ["__main__"]:
        return "top"
    if not (HOST / "spots" / inner[0]).is_dir():
        return "common"
    return "/".join(inner[:2]) if (HOST / "spots" / "/".join(inner[:2])).is_dir() else inner[0]


def imports(module):
    """Yield (name of an imported module, whether the import is in a function) for a module."""
    path = MODULES[module]
    package = module.split(".") if path.stem == "__init__" else module.split(".")[:-1]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    for target in named_modules(tree, package, face(module)):
        yield target, True
    for node, lazy in statements(tree):
        if isinstance(node, ast.Import):
            targets = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else []
            base = ".".join([*base, *filter(None, [node.module])])
            names = [f"{base}.{alias.name}" for alias in node.names]
            targets = [name if name in MODULES else base for name in names]
        else:
            continue
        for target in targets:
            yield target, lazy


def named_modules(tree, package, is_face):
    """Yield the modules that a module with `import_module` names in its strings.

    A relative name begins with a dot, except in the top of a package.
    """
    loads = "import_module", "__import__"
    if any(getattr(node, "id", getattr(node, "attr", "")) in loads for node in ast.walk(tree)):
        for text in {node.value.partition(":")[0] for node in strings(tree)}:
            is_relative = is_face or text.startswith(".")
            name = ".".join([*package, text.lstrip(".")]) if is_relative else text
            if name in MODULES and name not in OURS:
                yield name


def statements(node, lazy=False):
    """Yield (statement, whether it is in a function) for all statements below a node."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.expr):  # imports nothing
            continue
        yield child, lazy
        yield from statements(child, lazy or isinstance(child, FUNCTION))


@cache
def all_imports():
    """List of (module, imported module, whether the import is in a function)."""
    return [(module, target, lazy) for module in MODULES for target, lazy in imports(module)]


def arrows():
    return [arrow for arrow in all_imports() if arrow[1].split(".")[0] in OURS]


@pytest.mark.board
def test_no_room_imports_what_it_may_not():
    allowed = rules()
    assert {room(module) for module in MODULES} <= set(allowed)
    forbidden = [
        f"{module} -> {target}"
        for module, target, _ in arrows()
        if room(module) != room(target) and room(target) not in allowed[room(module)]
    ]
    assert forbidden == []


def test_the_fit_of_a_calibration_needs_no_board_no_terminal_and_no_clock():
    modules = [module for module in MODULES if room(module) == "calibrate/fit"]
    outside = "serial", "rich", "sys", "os", "pathlib", "time", "datetime", "threading"
    found = [(m, target) for m in modules for target, _ in imports(m) if target in outside]
    assert (found, len(modules) > 10) == ([], True)


def test_every_process_that_runs_python_ignores_the_current_folder():
    """Fails for a new process that would run a `random.py` of the user, on any computer."""
    python = [*HOST.rglob("*.py"), *(ROOT / "docs/make").glob("*.py"), *ROOT.glob("tools/*.py")]
    starts = {
        path.name: line.strip()
        for path in python
        for line in path.read_text(encoding="utf-8").splitlines()
        if "sys.executable" in line and '"-I"' not in line
    }
    assert starts == {"python.py": 'return [sys.executable, "-c", _NOT_HERE + code, *words]'}


@pytest.mark.parametrize("part", ["module", "room"])
def test_no_circle_of(part):
    """Fails if parts import each other, also through others, so that none can be read first."""
    graph: dict[str, set[str]] = {}
    for ends in [arrow[:2] for arrow in arrows() if arrow[1] in MODULES]:
        # The top of the package has its public names, and starts the command line.
        if part == "room" and "top" in map(room, ends):
            continue
        source, target = map(room, ends) if part == "room" else ends
        if source != target:
            graph.setdefault(source, set()).add(target)
    TopologicalSorter(graph).prepare()


def test_a_copy_of_a_module_in_javascript_stands_beside_it():
    """Fails for a copy in another room, where nobody sees it who changes the module."""
    found = {}
    for path in HOST.rglob("*.js"):
        head = path.read_text(encoding="utf-8").partition("\n\n")[0]
        if re.search(rf"\b{path.stem}\.py\b", head):
            found[path.relative_to(HOST).as_posix()] = path.with_suffix(".py").exists()
    assert found == {
        f"spots_sim/chip/{name}.js": True for name in ("as7341", "bus", "converter", "fifo")
    }


def test_functions_import_only_modules_that_need_an_optional_package_or_are_dispatched():
    needing = {m for m, target, lazy in all_imports() if target.startswith(OPTIONAL) and not lazy}
    dispatching = {
        module
        for module in MODULES
        if room(module) == "cli" or module in {f"{package}.cli" for package in OURS}
    }
    dispatching.add("spots_net.outlet")  # each outlet needs another package
    unexpected = [
        f"{module} -> {target}"
        for module, target, lazy in arrows()
        if lazy and module not in dispatching and target not in needing and not face(module)
        if not module.startswith("spots_device.")  # there, a late import saves memory
    ]
    assert unexpected == []


def face(module):
    """Return whether a module is the top of a package, which loads names at their first use."""
    return MODULES[module].stem == "__init__" and "." not in module


@pytest.mark.parametrize("package", ["spots", "spots_web", "spots_net", "spots_linkage"])
def test_a_package_that_is_used_alone_names_no_package_beside_it(package):
    files = [path for path in (HOST / package).rglob("*") if path.suffix in SOURCES]
    others = "|".join(name for name in OURS if name not in (package, "spots", "spots_device"))
    named = re.compile(rf"\b({others})\b")
    assert [path for path in files if named.search(path.read_text(encoding="utf-8"))] == []


def test_the_host_package_names_no_kind_of_port_of_the_packages_beside_it():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    text = text.partition('[project.entry-points."spots.ports"]')[2].partition("[project.")[0]
    ports = re.findall(r'^"?(\w+)[\w.-]*"? = "(\w+)\.[\w.]+:\w+"$', text, re.MULTILINE)
    guests = {scheme for scheme, package in ports if package in {*OURS} - {"spots"}}
    assert guests == {"ble", "virtual", "zenoh"}
    named = re.compile(rf"\b({'|'.join(guests)})\b")
    found = {
        (path.relative_to(HOST / "spots").as_posix(), node.value)
        for path in (HOST / "spots").rglob("*.py")
        for node in strings(ast.parse(path.read_text(encoding="utf-8")))
        if named.search(node.value)
    }
    assert found == {
        # Calibration offers practice on it; without its package, the error names the extra.
        ("link/ports.py", "virtual"),
        # Not the port: a device of the operating system.
        ("outputs/uinput.py", "cannot create a virtual device with "),
    }


def strings(tree):
    """Yield the string constants of a module, without docstrings."""
    docstrings = {id(node.value) for node in ast.walk(tree) if isinstance(node, ast.Expr)}
    for node in ast.walk(tree):
        text = isinstance(node, ast.Constant) and isinstance(node.value, str)
        if text and id(node) not in docstrings:
            yield node


def test_tests_share_code_only_through_the_package_support():
    files = [p for p in (ROOT / "tests").rglob("*.py") if "node_modules" not in p.parts]
    names = [path.stem for path in files if path.stem.startswith("test_")]
    tests = {*names}
    assert len(tests) == len(names), "pytest collects no two modules of one name"
    importing = re.compile(r"^\s*(?:from|import) (?:\w+\.)*(\w+)", re.MULTILINE)
    found = {p.name: tests & {*importing.findall(p.read_text(encoding="utf-8"))} for p in files}
    assert {name: imported for name, imported in found.items() if imported} == {}
    assert len(tests) > 100  # the test finds them


def test_packages_plug_in_by_four_groups_of_entry_points():
    text = (ROOT / "pyproject.toml").read_text(encoding="utf-8")
    groups = re.findall(r'^\[project\.entry-points\."(.+)"\]$', text, re.MULTILINE)
    assert groups == ["spots.ports", "spots.abilities", "spots.commands", "spots.panels"]
    section = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8").partition("## Entry points")[2]
    assert re.findall(r"^- `(spots\.\w+)`", section.partition("\n## ")[0], re.MULTILINE) == groups


@pytest.mark.board
def test_no_import_lists_more_than_fifteen_names():
    folders = "boards", "docs", "examples", "firmware", "host", "tests"
    lengths = {
        (path.relative_to(ROOT).as_posix(), node.lineno): len(node.names)
        for folder in folders
        for path in (ROOT / folder).rglob("*.py")
        if "node_modules" not in path.parts
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom)
    }
    assert {place: names for place, names in lengths.items() if names > 15} == {}
    assert max(lengths.values()) > 10  # the test finds lists


ARRAYS = "s", "state", "late", "head", "tables"  # shared by modules of the firmware


def unnamed(module):
    """Yield the places where a module of the firmware uses a number as an index of an array."""
    for node in ast.walk(ast.parse(module)):
        machine = isinstance(node, ast.FunctionDef) and "micropython.viper" in map(
            ast.unparse, node.decorator_list
        )
        for part in ast.walk(node) if machine else (node,):
            index = getattr(getattr(part, "slice", None), "value", None)
            if isinstance(part, ast.Subscript) and isinstance(index, int):
                array = getattr(part.value, "id", "") or getattr(part.value, "attr", "")
                if machine or array in ARRAYS:
                    yield ast.unparse(part)


def test_the_firmware_names_the_elements_of_its_arrays():
    modules = [path for top, path in PATHS if top == FIRMWARE]
    found = [(path.name, one) for path in modules for one in unnamed(path.read_text("utf-8"))]
    assert found == []
    machine = "@micropython.viper\ndef f(t: ptr8):\n    return t[3]\n"
    assert list(unnamed(machine)) == ["t[3]"]
    assert list(unnamed("a = x.state[4] + s[c.X_UM] + words[0]")) == ["x.state[4]"]


def test_each_element_of_the_state_of_a_tracker_has_a_line_and_a_place():
    path = FIRMWARE / "spots_device" / "fingers" / "state.py"
    _, _, after = path.read_text(encoding="utf-8").partition("# State of a tracker: ")
    elements = re.findall(r"^([A-Z_]+) = (\d+)  # \S", after.partition("SIZE = ")[0], re.MULTILINE)
    size = int(after.partition("SIZE = ")[2].split()[0])
    assert [int(place) for _, place in elements] == list(range(size))


def test_no_file_of_a_host_package_is_too_long_to_read_from_top_to_bottom():
    size = {
        path.relative_to(HOST).as_posix(): len(path.read_text(encoding="utf-8").splitlines())
        for top, path in PATHS
        if top == HOST
    }
    assert not {
        name: lines for name, lines in size.items() if name not in TABLES and lines > LINES_MAX
    }
    assert all(size[name] > LINES_MAX for name in TABLES), "no longer an exception"
