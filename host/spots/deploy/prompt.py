"""A board's raw prompt (raw REPL): runs programs on the board, and reads and writes its files."""

import ast
import contextlib
import hashlib
import io
import struct
from collections.abc import Iterable, Iterator
from pathlib import PurePosixPath

import serial

from ..errors import PortError, missing
from ..link.board_errors import AGAIN, in_words
from ..link.serial_link import SerialLink

_TIMEOUT_S = 10.0  # of each write to the port and each read from it
# Timeouts of the attempts to enter the prompt, in s. A board that is starting misses the first.
_ENTER_S = (2.0, 4.0, 8.0)
# Raised when the board's reply to `_FACTS` is damaged and cannot be parsed.
_GARBLED = (SyntaxError, ValueError, TypeError)
_CHUNK = 512  # bytes of a file in one transfer: a file may be larger than the board's memory
_PATHS = 50  # number of paths in one program: a longer list may not fit into the board's memory

# Programs for the board.
_SIZES = """
import os
for path in {!r}:
    try:
        status = os.stat(path)
    except OSError:
        continue
    if not status[0] & 0x4000:
        print(repr(path), ":", status[6], ",")
"""

_MAKE_FOLDER = """
import os
try:
    os.mkdir({0!r})
except OSError:
    os.stat({0!r})
"""

_RENAME_PART = """
import os
try:
    os.remove({0!r})
except OSError:
    pass
os.rename({0!r} + ".part", {0!r})
"""

_FACTS = """
import os, sys
_i = sys.implementation
try:
    _s = os.statvfs("/")
except (AttributeError, OSError):
    _s = None
_mpy = getattr(_i, "_mpy", 0)
print({"runtime": _i.name, "version": tuple(_i.version[:3]), "mpy": (_mpy & 255, _mpy >> 10 & 15),
    "block": _s and _s[1], "free": _s and _s[1] * _s[3]})
"""

_RESET = """
try:
    import microcontroller as machine
except ImportError:
    import machine
machine.reset()
"""


class Prompt:
    """The raw prompt (raw REPL) of a board. Opening the prompt interrupts a running program.

    `facts` are ``runtime`` (a name), ``version`` (tuple of 3 int), ``mpy`` (format version and
    architecture as in `build.MpyHeader`), and of the file system ``block`` (size of a block) and
    ``free``, in bytes, None if unknown. SpotsError if mpremote is missing, the port cannot be
    opened, or no prompt answers. All methods except `reset` and `close` raise it, too, if a program
    on the board fails, the file system is full, or the board is disconnected.
    """

    def __init__(self, port: str):
        try:
            from mpremote.transport import TransportError, TransportExecError
            from mpremote.transport_serial import SerialTransport
        except ImportError:
            raise missing("flashing needs", "mpremote", "flash") from None
        self.port = port
        self._refused = TransportExecError
        # At a disconnect, mpremote raises one of these errors, depending on its present operation.
        self._failures = (TransportError, serial.SerialException, OSError, struct.error)
        SerialLink(port).close()  # its error explains why a port cannot be opened
        self._transport = None
        try:
            self.facts = self._enter(SerialTransport)
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> "Prompt":
        return self

    def __exit__(self, *exception) -> None:
        if self._transport is not None:
            self.reset()  # the prompt has interrupted the application

    def run(self, program: str) -> str:
        """Run a program on the board and return its output."""
        with self._explained():
            return self._transport.exec(program).decode()

    def files(self, paths: Iterable[str]) -> dict[str, int]:
        """Return the size in bytes of each file in `paths` that exists, by its path."""
        asked, found = list(paths), {}
        for i in range(0, len(asked), _PATHS):
            printed = self.run(_SIZES.format(asked[i : i + _PATHS]))
            found |= ast.literal_eval("{" + printed + "}")
        return found

    def read(self, path: str, size: int) -> bytes:
        """Return the first bytes of a file, at most `size`."""
        data = b""
        self.run(f"_file = open({path!r}, 'rb')")
        while wanted := min(_CHUNK, size - len(data)):
            chunk = ast.literal_eval(self.run(f"print(_file.read({wanted}))"))
            if not chunk:
                break
            data += chunk
        return data

    def sha256(self, path: str) -> str:
        """Return the SHA-256 of a file on the board, in hexadecimal."""
        with self._explained():
            return self._transport.fs_hashfile(path, "sha256", _CHUNK).hex()

    def remove(self, path: str) -> None:
        """Remove a file from the board."""
        with self._explained():
            self._transport.fs_rmfile(path)

    def rename(self, path: str, new: str) -> None:
        """Rename a file in its folder; no file may have the new path."""
        self.run(f"import os\nos.rename({path!r}, {new!r})")

    def remove_folder(self, path: str) -> None:
        """Remove a folder from the board if the folder is empty."""
        self.run(f"import os\ntry:\n os.rmdir({path!r})\nexcept OSError:\n pass")

    def write(self, path: str, data: bytes) -> None:
        """Write a file under a temporary name, check its SHA-256, and rename it.

        Missing folders are created. PortError if the content is damaged during the transfer.
        """
        for folder in map(str, [*PurePosixPath(path).parents][-2::-1]):
            self.run(_MAKE_FOLDER.format(folder))
        with self._explained():
            self._transport.fs_writefile(path + ".part", data, _CHUNK)
        if self.sha256(path + ".part") != hashlib.sha256(data).hexdigest():
            raise PortError(f"{path} was damaged in transfer to {self.port}: try another cable")
        self.run(_RENAME_PART.format(path))

    def reset(self) -> None:
        """Restart the board, as its reset button does, and close the port."""
        # Some ports disappear before the last byte is sent.
        with contextlib.suppress(*self._failures):
            self._transport.exec_raw_no_follow(_RESET)
        self.close()

    def close(self) -> None:
        """Close the board's serial port."""
        if self._transport is not None:
            with contextlib.suppress(*self._failures):  # already disconnected
                self._transport.close()
            self._transport = None

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except self._failures as error:
            # For an error of the file system, mpremote raises an OSError instead of the refusal.
            refusal = error if isinstance(error, self._refused) else error.__context__
            replug = f": replug the board, and {AGAIN}"
            what = "was disconnected" + replug
            if isinstance(refusal, self._refused):
                output = refusal.error_output  # the board's traceback
                lines = (
                    (output if isinstance(output, str) else output.decode()).strip().splitlines()
                )
                reason = lines[-1] if lines else "no reason given"
                words = in_words(reason)
                what = f"reports an error: {words}" + ("" if AGAIN in words else replug)
            raise PortError(f"the board on {self.port} {what}") from None

    def _enter(self, transport_type: type) -> dict:
        """Open MicroPython's raw REPL, run `_FACTS` there, and return the dict that it prints."""
        with contextlib.redirect_stdout(io.StringIO()):  # mpremote prints its errors
            for within_s in _ENTER_S:
                with contextlib.suppress(*self._failures, *_GARBLED):
                    self._transport = self._transport or transport_type(self.port)
                    serial_port = self._transport.serial
                    serial_port.write_timeout = _TIMEOUT_S
                    serial_port.timeout = 1.0
                    self._transport.enter_raw_repl(soft_reset=False, timeout_overall=within_s)
                    serial_port.timeout = _TIMEOUT_S
                    # A reply may belong to an earlier attempt: only the facts prove that the prompt
                    # is ready.
                    facts = {**ast.literal_eval(self._transport.exec(_FACTS).decode())}
                    if facts["free"] is not None:  # littlefs reports less than 0 if it is full
                        facts["free"] = max(0, facts["free"])
                    return facts
        raise PortError(
            f"no MicroPython prompt on {self.port}: install MicroPython on the board, or replug it"
        )
