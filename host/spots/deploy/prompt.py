"""A board at its raw prompt: programs run there, files listed, hashed, written and removed."""

from __future__ import annotations

import ast
import contextlib
import hashlib
import io
import struct
from collections.abc import Iterable

import serial

from ..errors import SpotsError, missing
from ..link.serial_link import SerialLink
from ..link.udev import with_rule

_TIMEOUT_S = 10.0
# Timeouts of the attempts to enter the prompt: a board that is starting misses the first.
_ENTER_S = (2.0, 4.0, 8.0)
_GARBLED = (SyntaxError, ValueError, TypeError)  # from parsing a reply that is not the facts
_CHUNK = 512
_PATHS = 50  # in one program; a longer list takes memory that a board may not have
_DISK_FULL = ("Errno 28]", "ENOSPC", "OSError: 28")

# Runs on the board, in chunks: a file may be larger than its free memory.
_TOOLS = """
import os, sys, hashlib, binascii
def _hash(path):
    digest, chunk = hashlib.sha256(), bytearray(512)
    with open(path, "rb") as file:
        while True:
            size = file.readinto(chunk)
            if not size:
                break
            digest.update(memoryview(chunk)[:size])
    return binascii.hexlify(digest.digest()).decode()
def _sizes(paths):
    found = {}
    for path in paths:
        try:
            status = os.stat(path)
        except OSError:
            continue
        if not status[0] & 0x4000:
            found[path] = status[6]
    return found
def _read(path, size):
    with open(path, "rb") as file:
        while size > 0:
            chunk = file.read(min(size, 256))
            if not chunk:
                break
            size -= len(chunk)
            print(binascii.hexlify(chunk).decode())
def _make(folder):
    try:
        os.mkdir(folder)
    except OSError:
        os.stat(folder)
def _replace(path):
    try:
        os.remove(path)
    except OSError:
        pass
    os.rename(path + ".part", path)
"""

_FACTS = """
import os, sys
_i = sys.implementation
try:
    _s = os.statvfs("/")
except (AttributeError, OSError):
    _s = None
print((_i.name, tuple(_i.version[:3]), getattr(_i, "_mpy", 0), sys.platform,
    _s and _s[1], _s and _s[1] * _s[3]))
"""

_RESET = """
try:
    import microcontroller as machine
except ImportError:
    import machine
machine.reset()
"""


class Prompt:
    """The raw prompt of a board; a running program is interrupted.

    Parameters
    ----------
    port : str
        A serial port.

    Attributes
    ----------
    facts : dict
        ``runtime``, ``version``, ``mpy`` (format version, architecture), ``platform``,
        ``block`` and ``free`` (bytes).

    Raises
    ------
    SpotsError
        If mpremote is missing, the port cannot be opened, or no prompt answers.
    """

    def __init__(self, port: str):
        try:
            from mpremote.transport import TransportError, TransportExecError
            from mpremote.transport_serial import SerialTransport
        except ImportError:
            raise missing("flashing needs", "mpremote", "flash") from None
        self.port = port
        self._refused = TransportExecError
        # What mpremote raises when the cable is pulled depends on where it was.
        self._failures = (TransportError, serial.SerialException, OSError, struct.error)
        try:
            SerialLink(port).close()  # says in a sentence why a port cannot be opened
        except SpotsError as error:
            raise SpotsError(with_rule(str(error), port)) from None
        self._transport = None
        try:
            self._transport = SerialTransport(port)
            self.facts = self._enter()
        except (*self._failures, *_GARBLED):
            self.close()
            raise SpotsError(
                f"no MicroPython prompt on {port}: install MicroPython on the board, or replug it"
            ) from None
        except BaseException:
            self.close()
            raise
        self._has_tools = False

    def __enter__(self) -> Prompt:
        return self

    def __exit__(self, *exception) -> None:
        if self._transport is not None:
            self.reset()  # entering interrupted the application

    def run(self, program: str) -> str:
        """Run a program and return what it printed.

        Raises
        ------
        SpotsError
            If it raises, if the file system is full, or if the board was disconnected.
        """
        try:
            return self._transport.exec(program).decode()
        except self._refused as error:
            text = error.error_output
            lines = (text if isinstance(text, str) else text.decode()).strip().splitlines()
            last = lines[-1] if lines else "it does not say why"
            if any(sign in last for sign in _DISK_FULL):
                raise SpotsError(
                    f"the file system of the board on {self.port} is full: remove files of yours "
                    "from it and flash again"
                ) from None
            raise SpotsError(f"the board on {self.port} refuses: {last}") from None
        except self._failures:
            raise SpotsError(
                f"the board on {self.port} was disconnected: replug it and flash again"
            ) from None

    def has(self, module: str) -> bool:
        """Whether a module can be imported on the board."""
        return self._tool(
            f"try:\n import {module}\n print(True)\nexcept ImportError:\n print(False)"
        )

    def files(self, paths: Iterable[str]) -> dict[str, int]:
        """Return the sizes of the files that exist among these, by path."""
        asked, found = list(paths), {}
        for i in range(0, len(asked), _PATHS):
            found |= self._tool(f"print(_sizes({asked[i : i + _PATHS]!r}))")
        return found

    def read(self, path: str, size: int) -> bytes:
        """Return the first bytes of a file, at most `size` of them.

        Parameters
        ----------
        path : str
            On the board.
        size : int
            Largest number of bytes.

        Returns
        -------
        bytes

        Raises
        ------
        SpotsError
            If the board refuses, or is disconnected.
        """
        self._load_tools()
        return bytes.fromhex(self.run(f"_read({path!r}, {size})"))

    def sha256(self, path: str) -> str:
        """Return the hash of a file on the board, in hexadecimal."""
        return self._tool(f"print(repr(_hash({path!r})))")

    def remove(self, path: str) -> None:
        """Remove a file."""
        self.run(f"import os\nos.remove({path!r})")

    def remove_folder(self, path: str) -> None:
        """Remove a folder if it is empty."""
        self.run(f"import os\ntry:\n os.rmdir({path!r})\nexcept OSError:\n pass")

    def write(self, path: str, data: bytes) -> None:
        """Write a file under a temporary name, and rename it once its hash is verified.

        Parameters
        ----------
        path : str
            On the board; folders on the way are created.
        data : bytes
            The whole content.

        Raises
        ------
        SpotsError
            If the content arrives damaged, the file system is full, or the board is disconnected.
        """
        folder = path.rpartition("/")[0]
        parts = folder.split("/") if folder else []
        for i in range(len(parts)):
            self._tool(f"_make({'/'.join(parts[: i + 1])!r})\nprint(None)")
        self.run(f"_file = open({path + '.part'!r}, 'wb')")
        for start in range(0, len(data), _CHUNK):
            self.run(f"_file.write({data[start : start + _CHUNK]!r})")
        self.run("_file.close()")
        if self.sha256(path + ".part") != hashlib.sha256(data).hexdigest():
            raise SpotsError(f"{path} arrived damaged on {self.port}: try another cable")
        self._tool(f"_replace({path!r})\nprint(None)")

    def reset(self) -> None:
        """Restart the board, as its reset button does, and close the port."""
        try:
            self._transport.exec_raw_no_follow(_RESET)
        except self._failures:
            pass  # some ports disappear before the last byte is written
        self.close()

    def close(self) -> None:
        """Close the port."""
        if self._transport is not None:
            try:
                self._transport.close()
            except self._failures:
                pass  # it was disconnected
            self._transport = None

    def _enter(self) -> dict:
        """Enter the raw prompt and return the facts that the board prints there."""
        serial_port = self._transport.serial
        serial_port.write_timeout = _TIMEOUT_S
        with contextlib.redirect_stdout(io.StringIO()):  # mpremote prints its complaints
            for within_s in _ENTER_S:
                try:
                    serial_port.timeout = 1.0
                    self._transport.enter_raw_repl(soft_reset=False, timeout_overall=within_s)
                    serial_port.timeout = _TIMEOUT_S
                    # This may be the late answer to an earlier attempt: only the facts prove it.
                    return _facts(self._transport.exec(_FACTS))
                except (*self._failures, *_GARBLED):
                    if within_s == _ENTER_S[-1]:
                        raise

    def _tool(self, program: str):
        self._load_tools()
        return ast.literal_eval(self.run(program))

    def _load_tools(self) -> None:
        if not self._has_tools:
            self.run(_TOOLS)
            self._has_tools = True


def _facts(printed: bytes) -> dict:
    name, version, mpy, platform, block, free = ast.literal_eval(printed.decode())
    return {
        "runtime": name,
        "version": version,
        "mpy": (mpy & 0xFF, mpy >> 10 & 15),
        "platform": platform,
        "block": block,
        "free": free,
    }
