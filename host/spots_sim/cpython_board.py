"""The firmware in this Python, on a simulated bus, for machines without a MicroPython.

It runs one pass of the firmware's loop at a time. What it cannot do: it has no prompt, so it cannot
be flashed; it has no watchdog; and memory and integers have no limits here.
"""

from __future__ import annotations

import contextlib
import importlib
import importlib.util
import itertools
import os
import pkgutil
import platform
import sys
import tempfile
import threading
import traceback
from functools import partial
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Protocol

import spots_device
from spots.deploy.staging import KERNEL_VIPER, device_of

from .bus import I2CBus
from .faults import BoardFaults, FaultyBus
from .protocol import protocol
from .usb import UsbHost

_ADDRESS = 0x39
_RECOVERY_CLOCKS = 9
_TICKS = protocol.PERIOD_US
_AFTER_CRASH_US = 1_000_000
_CRASH_CHARACTERS = 300  # the end of a traceback; more would not fit a frame

_numbers = itertools.count()
_loading = threading.Lock()  # of `sys.modules`, where a stand-in lies meanwhile


class BoardPort(Protocol):
    """The board's end of its serial port. Neither call blocks."""

    def receive(self) -> bytes:
        """Return what the host has written since the last call."""

    def send(self, data: bytes) -> int:
        """Return how many of the bytes there was room for."""


class PowerLostError(BaseException):
    """Ends what the firmware does, wherever it is. Not an `Exception`, which it may catch.

    Attributes
    ----------
    off_us : float
        How long the board is without power.
    """

    def __init__(self, off_us: float):
        super().__init__(off_us)
        self.off_us = off_us


class CPythonBoard:
    """A virtual board: a folder as file system, and the firmware's modules of its own.

    Parameters
    ----------
    board_id : str
        Hexadecimal.
    bus : bus.I2CBus or faults.FaultyBus
    usb : usb.UsbHost
    port : BoardPort
    faults : faults.BoardFaults, optional
    folder : Path, optional
        For settings and calibration; a new one, removed at the end, if not given.
    """

    def __init__(
        self,
        board_id: str,
        bus: I2CBus | FaultyBus,
        usb: UsbHost,
        port: BoardPort,
        faults: BoardFaults | None = None,
        folder: Path | None = None,
    ):
        self._own = tempfile.TemporaryDirectory(prefix="spots-") if folder is None else None
        self._folder = Path(self._own.name) if self._own else folder
        self._config = SimpleNamespace(**device_of("virtual").device)
        self._id, self._usb = board_id, usb
        self._port = port
        self._requests = _Requests(bus, faults)
        self._package = ""
        try:
            self._boot()
        except BaseException:
            self.close()
            raise

    @property
    def bus(self):
        """The I2C bus; another one may be put in its place."""
        return self._requests.bus

    @bus.setter
    def bus(self, bus) -> None:
        self._requests.bus = bus

    def step(self) -> None:
        """Run one pass of the firmware's loop, or what a reset or a power cut does instead."""
        try:
            if self._app.reboot:
                self._app.run()  # ends at once, and cleanly
                self._boot()
            else:
                self._app.step()
        except PowerLostError as lost:
            self._port.receive()  # what it had not read is lost
            self.bus.clock.pause_us(lost.off_us)
            self.bus.chip.power_on(self.bus.clock.now_us())
            self._boot()
        except Exception:
            text = traceback.format_exc()[-_CRASH_CHARACTERS:]
            self._app.log("error", "crashed and restarts: " + text)
            with contextlib.suppress(PowerLostError):
                self._requests.sleep_us(_AFTER_CRASH_US)
            self._boot()

    def close(self) -> None:
        """Remove its file system; closing twice is closing once."""
        self._unload()
        if self._own:
            self._own.cleanup()

    def _boot(self) -> None:
        self._unload()
        self._package = _load(self._folder)
        app, as7341 = (sys.modules[f"{self._package}.{name}"] for name in ("app", "as7341"))
        clock = self._requests
        sensor = as7341.AS7341(_Sensor(clock), clock)
        sensor.gpio = clock.light
        self._app = app.BoardApp(
            self._config,
            f"cpython {platform.python_version()}",
            self._id,
            sensor,
            clock,
            _Serial(self._port),
            _UsbDevice(clock, self._usb),
        )

    def _unload(self) -> None:
        for name in [name for name in sys.modules if name.partition(".")[0] == self._package]:
            del sys.modules[name]


def _load(folder: Path) -> str:
    """Import the firmware once more, under a name of its own, with a folder as file system.

    So a reset forgets everything, and boards share nothing.
    """
    name = f"_spots_board_{next(_numbers)}"
    spec = importlib.util.spec_from_file_location(
        name, spots_device.__file__, submodule_search_locations=list(spots_device.__path__)
    )
    package = importlib.util.module_from_spec(spec)
    micropython = ModuleType("micropython")
    micropython.const = lambda value: value
    with _loading:
        there = sys.modules.get("micropython")
        sys.modules |= {name: package, "micropython": micropython}
        try:
            spec.loader.exec_module(package)
            for module in pkgutil.iter_modules(package.__path__):
                if not module.ispkg and f"{module.name}.py" != KERNEL_VIPER:
                    importlib.import_module(f"{name}.{module.name}")
        finally:
            del sys.modules["micropython"]
            if there:
                sys.modules["micropython"] = there
    settings = sys.modules[f"{name}.settings"]
    settings.open = lambda path, mode="r": open(folder / path, mode, encoding="utf-8")
    settings.os = SimpleNamespace(
        remove=lambda path: os.remove(folder / path),
        rename=lambda old, new: os.rename(folder / old, folder / new),
        stat=lambda path: os.stat(folder / path),
    )
    # The garbage here is that of the whole program: to collect it would cost samples.
    sys.modules[f"{name}.app"].gc = SimpleNamespace(collect=lambda: None)
    return name


class _Requests:
    """The bus as the board asks for it, and the board's clock."""

    def __init__(self, bus: I2CBus | FaultyBus, faults: BoardFaults | None):
        self.bus = bus
        self._faults = faults
        self._rate = faults.rate if faults else 1.0

    def ask(self, transfer, *arguments):
        """Carry out a transfer, unless the power fails before it."""
        off_us = self._faults.step(self.bus) if self._faults else None
        if off_us is not None:
            raise PowerLostError(off_us)
        return transfer(*arguments)

    def light(self, on: bool) -> None:
        self.ask(self.bus.light, on)

    def ticks_us(self) -> int:
        return int(self.bus.clock.now_us() * self._rate) % _TICKS

    def ticks_add(self, ticks: int, delta: int) -> int:
        return (ticks + delta) % _TICKS

    def ticks_diff(self, end: int, start: int) -> int:
        return (end - start + _TICKS // 2) % _TICKS - _TICKS // 2

    def sleep_us(self, us: int) -> None:
        self.ask(self.bus.clock.pause_us, us / self._rate)


class _Sensor:
    """The sensor's registers, as `spots_device.runtime` has them on a board."""

    def __init__(self, requests: _Requests):
        self._requests = requests

    def read_into(self, register: int, buffer) -> None:
        r = self._requests
        buffer[:] = r.ask(r.bus.write_read, _ADDRESS, bytes((register,)), len(buffer))

    def write(self, buffer) -> None:
        self._requests.ask(self._requests.bus.write, _ADDRESS, bytes(buffer))

    def recover(self) -> None:
        """Clock out a chip that holds SDA in the middle of a byte, then STOP (UM10204, 3.1.16)."""
        for _ in range(_RECOVERY_CLOCKS):
            if self._lines(1, 1):
                break
            self._lines(0, 1)
        for scl, sda in ((0, 1), (0, 0), (1, 0), (1, 1)):
            self._lines(scl, sda)

    def _lines(self, scl: int, sda: int) -> int:
        return self._requests.ask(self._requests.bus.lines, scl, sda)


class _Serial:
    def __init__(self, port: BoardPort):
        self._port = port
        self._received = iter(b"")

    def write(self, buffer, size: int) -> bool:
        return self._port.send(bytes(buffer[:size])) == size

    def read(self) -> int:
        byte = next(self._received, -1)
        if byte < 0:
            self._received = iter(self._port.receive())
            byte = next(self._received, -1)
        return byte


class _UsbDevice:
    def __init__(self, requests: _Requests, host: UsbHost):
        self._ask, self._host = requests.ask, host

    def open(self, names) -> dict:
        return {name: partial(self._send, index) for index, name in enumerate(names)}

    def _send(self, interface: int, report) -> bool:
        try:
            self._ask(self._host.offer, interface, bytes(report))
        except OSError as error:
            if error.errno != protocol.EAGAIN:
                raise
            return False
        return True


class InProcessBoard(CPythonBoard):
    """A board whose serial port ends in this program: a `BoardPort` at one end.

    Takes what `CPythonBoard` does, but the port.
    """

    free_bytes = None
    _ROOM = 1 << 16  # bytes a direction

    def __init__(self, board_id: str, bus, usb: UsbHost, faults=None, folder=None):
        self._to_board, self._to_host = bytearray(), bytearray()
        port = SimpleNamespace(
            receive=lambda: _take(self._to_board),
            send=lambda data: _put(self._to_host, data, self._ROOM),
        )
        super().__init__(board_id, bus, usb, port, faults, folder)

    def received(self) -> bytes:
        """Return what the board has sent since the last call."""
        return _take(self._to_host)

    def send(self, data: bytes) -> int:
        """Return how many of the bytes there was room for, where the board finds them."""
        return _put(self._to_board, data, self._ROOM)


def _take(buffer: bytearray) -> bytes:
    data = bytes(buffer)
    buffer.clear()
    return data


def _put(buffer: bytearray, data: bytes, room: int) -> int:
    size = min(len(data), room - len(buffer))
    buffer += data[:size]
    return size
