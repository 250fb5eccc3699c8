"""Fixtures that run the scripts of this folder in MicroPython.

There are two builds of MicroPython, with words of 64 and of 32 bits, and CPython for comparison.
Each gets the firmware's package and the same scripts, unchanged, in its own folder. The 64-bit
build also runs the sample path as machine code. The 32-bit build is WebAssembly, for which
MicroPython cannot compile machine code.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from bench import canned
from viper import need_viper

import spots_device
from spots.deploy.constants import inline
from spots.deploy.names import shorten
from spots.deploy.staging import use_viper
from spots_sim.vm import micropython_command

HERE = Path(__file__).parent
WASM = HERE.parent / "wasm"
WASM_PACKAGE = WASM / "node_modules" / "@micropython" / "micropython-webassembly-pyscript"
TIMEOUT_S = 60
# About the heap of a program on an RP2040; twice as much where words are twice as long. The unix
# port cannot exceed this size; the heap of WebAssembly starts with it and grows.
HEAP_32_BYTES = 192 * 1024
HEAP_64_BYTES = 2 * HEAP_32_BYTES


class Machine:
    """An interpreter that runs a script in its own folder."""

    def __init__(self, folder: Path):
        self.folder = folder
        clean = shutil.ignore_patterns("__pycache__")
        shutil.copytree(HERE / "scripts", folder, ignore=clean, dirs_exist_ok=True)
        shutil.copytree(Path(spots_device.__file__).parent, folder / "spots_device", ignore=clean)
        shutil.copy(canned.__file__, folder)

    def slip(self, module: str, code: str) -> None:
        """Append code to a module of this interpreter's copy of the firmware, such as a defect."""
        path = self.folder / "spots_device" / f"{module}.py"
        path.write_text(path.read_text(encoding="utf-8") + code, encoding="utf-8")

    def run(self, script: str, given: dict | None = None) -> list[str]:
        """Return the lines that a script prints.

        Parameters
        ----------
        script : str
            Module in the folder ``scripts``.
        given : dict, optional
            Content of the file given.json, which the script reads.

        Raises
        ------
        RuntimeError
            If the script ends with an exception; the text contains the traceback.
        """
        (self.folder / "given.json").write_text(json.dumps(given), encoding="utf-8")
        process = subprocess.Popen(
            self.command(script),
            cwd=self.folder,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        try:
            said, complained = process.communicate(timeout=TIMEOUT_S)
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


class CPython(Machine):
    """CPython, the reference for the other interpreters; caches the output of each run."""

    def __init__(self, folder: Path):
        super().__init__(folder)
        shutil.copy(HERE / "cpython" / "micropython.py", folder)
        self._printed: dict[tuple[str, str], list[str]] = {}

    def run(self, script: str, given: dict | None = None) -> list[str]:
        key = script, json.dumps(given)
        if key not in self._printed:
            self._printed[key] = super().run(script, given)
        return self._printed[key]

    def command(self, script: str) -> list[str]:
        return [sys.executable, "-B", f"{script}.py"]


class Unix64(Machine):
    def command(self, script: str) -> list[str]:
        # Constants are replaced by their values, as on a board. The other scripts import these
        # constants, so their modules are not changed.
        if script == "sample_path":
            inline(self.folder / "spots_device")
            shorten(self.folder / "spots_device")
        return [*micropython_command(), "-X", f"heapsize={HEAP_64_BYTES}", f"{script}.py"]


class Viper64(Unix64):
    def __init__(self, folder: Path):
        need_viper()
        super().__init__(folder)
        use_viper(folder / "spots_device")


class Wasm32(Machine):
    def command(self, script: str) -> list[str]:
        places = [str(Path(sys.executable).parent), os.environ.get("PATH", "")]
        node = shutil.which("node", path=os.pathsep.join(places))
        if node is None or not WASM_PACKAGE.is_dir():
            pytest.fail("node or MicroPython for WebAssembly is missing; 'make test' gets both")
        return [node, str(WASM / "run.mjs"), str(self.folder), script, str(HEAP_32_BYTES)]


@pytest.fixture(params=[Unix64, Wasm32, Viper64], ids=["unix64", "wasm32", "viper64"])
def machine(request, tmp_path):
    """A `Machine` with MicroPython: each test runs with 64-bit and with 32-bit words."""
    return request.param(tmp_path / "micropython")


@pytest.fixture
def viper64(tmp_path):
    """A `Machine` with MicroPython of 64 bits, and the sample path as machine code."""
    return Viper64(tmp_path / "micropython")


@pytest.fixture
def machine_bits(machine):
    """Word size of `machine` in bits: 32 or 64."""
    return 32 if isinstance(machine, Wasm32) else 64


@pytest.fixture(scope="session")
def cpython(tmp_path_factory):
    """A `Machine` with CPython."""
    return CPython(tmp_path_factory.mktemp("cpython"))
