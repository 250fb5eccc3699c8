"""Fixtures that run the scripts of this folder in MicroPython.

There are two builds of MicroPython, with words of 64 and of 32 bits, and CPython for comparison.
Each gets the firmware's package and the same scripts. As on a board, MicroPython gets them as
bytecode, which mpy-cross compiles one time for all tests. The 64-bit build also runs the sample
path as machine code. The 32-bit build is WebAssembly, for which MicroPython cannot compile machine
code.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from bench import canned
from support.viper import need_viper

import spots_device
from spots.deploy.build import mpy_cross_command
from spots.deploy.constants import inline
from spots.deploy.staging import VIPER, use_viper
from spots_device.fingers import state
from spots_device.reading import decode
from spots_sim.board.vm import micropython_command

HERE = Path(__file__).parent
WASM = HERE.parent / "wasm"
WASM_PACKAGE = WASM / "node_modules" / "@micropython" / "micropython-webassembly-pyscript"
# About the heap of a program on an RP2040; twice as much where words are twice as long. The unix
# port cannot exceed this size; the heap of WebAssembly starts with it and grows.
HEAP_32_BYTES = 192 * 1024
# What a script has beside the firmware: a flash, or all that a port and a host have received.
OWN_BYTES = {"power_cuts": 14 * HEAP_32_BYTES, "sample_path": 100_000}
HEAP_64_BYTES = 2 * HEAP_32_BYTES


def copy_sources(folder: Path, viper: bool, inlined: bool) -> None:
    """Copy the scripts and the firmware's package into a folder.

    Parameters
    ----------
    folder : Path
        The folder, which is made.
    viper : bool
        Whether the package contains the sample path as machine code.
    inlined : bool
        Whether constants are replaced by their values, as on a board. Machine code needs this.
        Scripts import constants of the modules `decode` and `state`, so they get them again.
    """
    clean = shutil.ignore_patterns("__pycache__")
    shutil.copytree(HERE / "scripts", folder, ignore=clean)
    package = folder / "spots_device"
    left_out = clean if viper else shutil.ignore_patterns("__pycache__", f"*{VIPER}.py")
    shutil.copytree(Path(spots_device.__file__).parent, package, ignore=left_out)
    shutil.copy(canned.__file__, folder)
    if viper:
        use_viper(package)
    if inlined:
        inline(package)
        for module in (decode, state):
            path = package.joinpath(*module.__name__.split(".")[1:]).with_suffix(".py")
            names = {name: value for name, value in vars(module).items() if name.isupper()}
            lines = [f"{name} = {value}\n" for name, value in names.items()]
            path.write_text(path.read_text(encoding="utf-8") + "".join(lines), encoding="utf-8")


def compile_module(source: Path, target: Path) -> None:
    """Compile a module with mpy-cross; machine code is that of x86-64, also its constants."""
    bits = 63 if "@micropython.viper" in source.read_text(encoding="utf-8") else 31
    word = ["-march=x64", f"-msmall-int-bits={bits}"]
    command = [*mpy_cross_command(), *word, "-o", str(target), str(source)]
    subprocess.run(command, check=True)


@pytest.fixture(scope="session")
def compiled(once):
    """Return a function that returns a folder with sources and bytecode, see `copy_sources`."""

    def make(folder, *form):
        copy_sources(folder / "source", *form)
        for source in (folder / "source").rglob("*.py"):
            target = folder / "code" / source.relative_to(folder / "source").with_suffix(".mpy")
            target.parent.mkdir(parents=True, exist_ok=True)
            compile_module(source, target)

    def compiled(viper=False, inlined=False):
        form = viper, inlined
        return once(f"micropython-{viper}-{inlined}", lambda folder: make(folder, *form))

    return compiled


class Machine:
    """An interpreter that runs a script in a folder of its own.

    Parameters
    ----------
    folder : Path
        The interpreter's working directory, which is made.
    compiled : callable
        The fixture of this name.
    """

    viper = False
    timeout_s = 60

    def __init__(self, folder: Path, compiled):
        folder.mkdir()
        self.folder = folder
        self._compiled = compiled
        self._slipped = None

    def slip(self, module: str, code: str) -> None:
        """Append code to a module of this interpreter's copy of the firmware, such as a defect."""
        kept = self._compiled(self.viper, self.viper)
        self._slipped = self.folder.with_name("slipped")
        shutil.copytree(kept / "code", self._slipped)
        source = self.folder.with_name("slipped.py")
        original = kept / "source" / "spots_device" / f"{module}.py"
        source.write_text(original.read_text(encoding="utf-8") + code, encoding="utf-8")
        compile_module(source, self._slipped / "spots_device" / f"{module}.mpy")

    def code(self, script: str) -> Path:
        """Return the folder with the scripts and the firmware, as this interpreter imports them."""
        inlined = self.viper or self.inlines(script)
        return self._slipped or self._compiled(self.viper, inlined) / "code"

    def inlines(self, script: str) -> bool:
        """Return whether `script` runs with the firmware's constants replaced by their values."""
        return False

    def run(self, script: str, given: dict | list | None = None) -> list[str]:
        """Return the lines that a script prints.

        Parameters
        ----------
        script : str
            Module in the folder ``scripts``.
        given : dict or list, optional
            Content of the file given.json, which the script reads: a dict, or one item in each
            line.

        Raises
        ------
        RuntimeError
            If the script ends with an exception; the text contains the traceback.
        """
        lines = map(json.dumps, given if isinstance(given, list) else [given])
        (self.folder / "given.json").write_text("\n".join(lines), encoding="utf-8")
        return self.execute(script)

    def execute(self, script: str) -> list[str]:
        """Run a script in a process of its own; result and errors as in `run`."""
        process = subprocess.Popen(
            self.command(script),
            cwd=self.folder,
            env=os.environ | self.environment(script),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        try:
            said, complained = process.communicate(timeout=self.timeout_s)
        except BaseException:
            # The command starts the interpreter as a child process, so the whole group is killed.
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            raise
        if process.returncode:
            raise RuntimeError(said[-2000:] + complained[-2000:])
        return said.splitlines()

    def command(self, script: str) -> list[str]:
        raise NotImplementedError

    def environment(self, script: str) -> dict[str, str]:
        return {}


class CPython(Machine):
    """CPython, the reference for the other interpreters; caches the output of each run."""

    def __init__(self, folder: Path):
        copy_sources(folder, False, False)
        shutil.copy(HERE / "cpython" / "micropython.py", folder)
        self.folder = folder
        self._printed: dict[tuple[str, str], list[str]] = {}

    def run(self, script: str, given: dict | list | None = None) -> list[str]:
        key = script, json.dumps(given)
        if key not in self._printed:
            self._printed[key] = super().run(script, given)
            for saved in self.folder.glob("*-[ab].txt"):
                saved.unlink()  # the next script starts on a board on which nothing is stored
        return self._printed[key]

    def command(self, script: str) -> list[str]:
        return [sys.executable, f"{script}.py"]


class Unix64(Machine):
    def inlines(self, script: str) -> bool:
        return script == "sample_path"

    def command(self, script: str) -> list[str]:
        size = HEAP_64_BYTES + OWN_BYTES.get(script, 0)
        return [*micropython_command(), "-X", f"heapsize={size}", "-m", script]

    def environment(self, script: str) -> dict[str, str]:
        return {"MICROPYPATH": f"{self.code(script)}:.frozen"}


class Viper64(Unix64):
    viper = True

    def __init__(self, folder: Path, compiled):
        need_viper()
        super().__init__(folder, compiled)


class Wasm32(Machine):
    """MicroPython for WebAssembly, see `node`."""

    def __init__(self, folder: Path, compiled, node: subprocess.Popen):
        super().__init__(folder, compiled)
        self._node = node

    def execute(self, script: str) -> list[str]:
        request = script, str(self.code(script)), str(self.folder)
        print(json.dumps(request), file=self._node.stdin, flush=True)
        timer = threading.Timer(self.timeout_s, self._node.kill)
        timer.start()
        answer = self._node.stdout.readline()
        timer.cancel()
        assert answer, "node has ended, or was killed after a timeout"
        said, complained = json.loads(answer)
        if complained is not None:
            raise RuntimeError(complained[-2000:])
        return said


@pytest.fixture(scope="session")
def node():
    """A process of node that runs MicroPython for WebAssembly; compiling it takes most time."""
    places = [str(Path(sys.executable).parent), os.environ.get("PATH", "")]
    command = shutil.which("node", path=os.pathsep.join(places))
    if command is None or not WASM_PACKAGE.is_dir():
        pytest.fail("node or MicroPython for WebAssembly is missing; 'make test' gets both")
    run = [command, str(WASM / "run.mjs"), str(HEAP_32_BYTES)]
    with subprocess.Popen(run, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        yield process


@pytest.fixture(params=[Unix64, Wasm32, Viper64], ids=["unix64", "wasm32", "viper64"])
def machine(request, tmp_path, compiled):
    """A `Machine` with MicroPython: each test runs with 64-bit and with 32-bit words."""
    more = [request.getfixturevalue("node")] if request.param is Wasm32 else []
    return request.param(tmp_path / "micropython", compiled, *more)


@pytest.fixture
def unix64(tmp_path, compiled):
    """A `Machine` with MicroPython of 64 bits, which has the file systems of real boards."""
    return Unix64(tmp_path / "micropython", compiled)


@pytest.fixture
def viper64(tmp_path, compiled):
    """A `Machine` with MicroPython of 64 bits, and the sample path as machine code."""
    return Viper64(tmp_path / "micropython", compiled)


@pytest.fixture
def machine_bits(machine):
    """Word size of `machine` in bits: 32 or 64."""
    return 32 if isinstance(machine, Wasm32) else 64


@pytest.fixture(scope="session")
def cpython(tmp_path_factory):
    """A `Machine` with CPython."""
    return CPython(tmp_path_factory.mktemp("cpython") / "scripts")
