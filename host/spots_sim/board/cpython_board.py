"""Runs the firmware in CPython on a simulated bus, for computers without MicroPython.

Each call of `CPythonBoard.step` runs one pass of the firmware's loop. Unlike a real board, this
board has no watchdog, and no prompt, so it cannot be flashed. Memory and integers are unlimited.
"""

from __future__ import annotations

import contextlib
import errno
import os
import platform
import runpy
import sys
import traceback
from functools import partial
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Protocol

from spots.common import atomic
from spots.deploy.staging import BOARDS, device_of
from spots_device.board.start import AFTER_CRASH_MS, CRASH_CHARACTERS
from spots_device.runtime.common import ADDRESS, free_bus, rp2_mC

from ..chip.bus import I2CBus
from . import copies, thermometer
from .bluetooth import Bluetooth
from .cpu import Cpu
from .faults import BoardFaults, FaultyBus
from .protocol import protocol
from .usb import UsbHost

_TICKS = protocol.PERIOD_US
_slow_down = runpy.run_path(str(BOARDS / "_virtual" / "_cpu.py"))["slow_down"]
_MODULES = "board.app", "sensor.as7341", "radio.start"


class BoardPort(Protocol):
    """A board's end of a serial port. The methods do not block."""

    def receive(self) -> bytes:
        """Return all bytes that the host has written since the last call."""

    def send(self, data: bytes) -> int:
        """Send bytes; return how many of them the port accepted."""


class PowerLostError(BaseException):
    """Interrupts the firmware for `off_us` at a power failure.

    It is derived from `BaseException`, because the firmware may catch any `Exception`.
    """

    def __init__(self, off_us: float):
        super().__init__(off_us)
        self.off_us = off_us


class CPythonBoard:
    """A virtual board whose firmware runs in this process.

    Each board has its own file system and its own copy of the firmware's modules. `board_id` is
    hexadecimal. Without `folder`, the file system is a temporary folder, which `close` removes.
    `second` is the bus of a second strip. `bluetooth` is the radio of the board.
    """

    def __init__(
        self,
        board_id: str,
        bus: I2CBus | FaultyBus,
        usb: UsbHost,
        port: BoardPort,
        faults: BoardFaults | None = None,
        folder: Path | None = None,
        cpu: Cpu | None = None,
        second: I2CBus | FaultyBus | None = None,
        bluetooth: Bluetooth | None = None,
    ):
        self._own = contextlib.ExitStack()
        self._folder = folder or self._own.enter_context(atomic.temporary())
        self.second = second
        self._config = SimpleNamespace(**device_of("virtual", 2 if second else 1).device)
        self._id, self._usb = board_id, usb
        self._port = port
        self._cpu, self._bluetooth = cpu, bluetooth
        self._requests = _Requests(bus, faults)
        self._package = ""
        try:
            self._boot()
        except BaseException:
            self.close()
            raise

    @property
    def bus(self):
        """The I2C bus; assign another bus to replace it."""
        return self._requests.bus

    @bus.setter
    def bus(self, bus) -> None:
        self._requests.bus = bus

    def step(self) -> None:
        """Run one pass of the firmware's loop; after a reset, crash or power loss, boot again."""
        if self._bluetooth:
            self._bluetooth.settle(1e-6 * self.bus.clock.now_us())
        try:
            if self._app.reboot:
                self._app.run()  # ends immediately, and cleanly
                self._boot()
            else:
                self._app.step()
        except PowerLostError as lost:
            self._port.receive()  # a board without power loses bytes that it has not read
            self.bus.clock.pause_us(lost.off_us)
            for bus in filter(None, (self.bus, self.second)):
                bus.chip.power_on(bus.clock.now_us())
            self._boot()
        except Exception:
            text = traceback.format_exc()[-CRASH_CHARACTERS:]
            self._app.log("error", "crashed and restarts: " + text)
            with contextlib.suppress(PowerLostError):
                self._requests.sleep_us(1000 * AFTER_CRASH_MS)
            self._boot()

    def close(self) -> None:
        """Remove the temporary file system; a second call has no effect."""
        self._unload()
        self._own.close()

    def _boot(self) -> None:
        self._unload()
        self._package = _load(self._folder)
        if self._cpu:
            _slow_down(self._package, self._cpu.times_us(), self._requests.spend_us)
        modules = {name: sys.modules[f"{self._package}.{name}"] for name in _MODULES}
        clock = self._requests

        def open_sensor(config, strip_clock):
            requests = clock
            if config.I2C_ID:
                requests = _SecondBus(self, clock)
            sensor = modules["sensor.as7341"].AS7341(_Sensor(requests), strip_clock)
            sensor.gpio = requests.light
            sensor.thermometer = lambda: rp2_mC(requests.heat)
            return sensor

        self._app = modules["board.app"].Board(
            self._config,
            f"cpython {platform.python_version()}",
            self._id,
            open_sensor,
            clock,
            _Serial(self._port),
            _UsbDevice(clock, self._usb),
            self._bluetooth and partial(self._attach, modules["radio.start"].attach),
        )

    def _attach(self, attach, *parts):
        return attach(*parts, self._bluetooth.module())

    def _unload(self) -> None:
        for name in [name for name in sys.modules if name.partition(".")[0] == self._package]:
            del sys.modules[name]


def _load(folder: Path) -> str:
    """Import a new copy of the firmware whose file system is `folder`; return its package's name.

    Each boot needs a new copy, so that a reset loses all state and boards share no state.
    """
    name = copies.load()
    use_folder(sys.modules[f"{name}.board.store"], folder)
    # `gc.collect` would search the memory of the whole program, so samples would be lost.
    for module in [sys.modules[key] for key in sys.modules if key.startswith(f"{name}.")]:
        if hasattr(module, "gc"):
            module.gc = SimpleNamespace(collect=lambda: None)
    return name


def use_folder(store: ModuleType, folder: Path) -> None:
    """Make a copy of the firmware's module `store` use a folder as its file system."""
    replaced: dict[str, object] = {
        "open": lambda path, mode: open(folder / path, mode),
        "os": SimpleNamespace(
            remove=lambda path: os.remove(folder / path),
            listdir=lambda: os.listdir(folder),
            stat=lambda path: os.stat(folder / path),
        ),
    }
    vars(store).update(replaced)


class _Requests:
    """Handles the requests of the firmware to the simulator: clock, transfers, waits, LED pin.

    When a power failure begins, the next request that is not for the clock raises PowerLostError.
    """

    def __init__(self, bus: I2CBus | FaultyBus, faults: BoardFaults | None):
        self.bus = bus
        self._faults = faults
        self._rate = faults.rate if faults else 1.0

    def ask(self, transfer, *arguments):
        """Apply faults; return ``transfer(*arguments)``, or raise PowerLostError if power fails."""
        if self._faults and (off_us := self._faults.step(self.bus)) is not None:
            raise PowerLostError(off_us)
        return transfer(*arguments)

    def light(self, on: bool) -> None:
        self.ask(self.bus.light, on)

    def heat(self) -> int:
        return self.ask(thermometer.read_u16, self.bus)

    def ticks_us(self) -> int:
        return int(self.bus.clock.now_us() * self._rate) % _TICKS

    def ticks_add(self, ticks: int, delta: int) -> int:
        return (ticks + delta) % _TICKS

    def ticks_diff(self, end: int, start: int) -> int:
        return (end - start + _TICKS // 2) % _TICKS - _TICKS // 2

    def sleep_us(self, us: int) -> None:
        self.ask(self.bus.clock.pause_us, us / self._rate)

    def spend_us(self, us: int) -> None:
        self.bus.clock.spend_us(us / self._rate)


class _SecondBus:
    """Handles requests for the board's second bus, as `_Requests` does for the first bus."""

    def __init__(self, board: CPythonBoard, requests: _Requests):
        self._board, self.ask = board, requests.ask

    @property
    def bus(self):
        return self._board.second

    def light(self, on: bool) -> None:
        self.ask(self.bus.light, on)

    def heat(self) -> int:
        return self.ask(thermometer.read_u16, self.bus)


class _Sensor:
    """Accesses the sensor's registers over I2C, for the driver `spots_device.sensor.as7341`."""

    def __init__(self, requests: _Requests | _SecondBus):
        self._requests = requests
        self._wires = [1, 1]  # levels of SCL and SDA: 1 released, 0 pulled low

    def read_into(self, address: int, register: int, buffer) -> None:
        r = self._requests
        try:
            buffer[:] = r.ask(r.bus.write_read, address, bytes((register,)), len(buffer))
        except OSError as error:
            _raise_unless_refused(error)

    def write(self, buffer) -> None:
        if self.write_to(ADDRESS, buffer) != len(buffer):
            raise OSError(errno.EIO, "the chip refused a byte")

    def write_to(self, address: int, buffer) -> int:
        try:
            self._requests.ask(self._requests.bus.write, address, bytes(buffer))
            return len(buffer)
        except OSError as error:
            _raise_unless_refused(error)
            return 0

    def recover(self) -> None:
        """Free the bus without waits, because simulated wires need no minimum pulse width."""
        free_bus(0, 1, self._level, self._put)

    def _level(self, sda: int) -> int:
        return self._requests.ask(self._requests.bus.lines, *self._wires)

    def _put(self, wire: int, level: int) -> None:
        self._wires[wire] = level
        self._level(wire)


def _raise_unless_refused(error: OSError) -> None:
    # `machine.I2C` of an RP2040 raises no OSError if the chip refuses a data byte.
    if error.errno != protocol.REFUSED:
        raise error


class _Serial:
    def __init__(self, port: BoardPort):
        self._port = port
        self._received = iter(b"")

    def write(self, buffer, size: int) -> bool:
        return self._port.send(bytes(buffer[:size])) == size

    def read(self) -> int:
        byte = next(self._received, -1)
        if byte < 0 and (data := self._port.receive()):
            self._received = iter(data)
            byte = next(self._received)
        return byte


class _UsbDevice:
    def __init__(self, requests: _Requests, host: UsbHost):
        self._ask, self._host = requests.ask, host

    @property
    def connected(self) -> bool:
        return self._host.plugged

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
    """A `CPythonBoard` whose serial port is a pair of buffers in this process.

    Its parameters are those of `CPythonBoard` except `port`.
    """

    free_bytes = None
    _ROOM = 1 << 16  # size of the buffer for each direction, in bytes

    def __init__(
        self,
        board_id: str,
        bus,
        usb: UsbHost,
        faults=None,
        folder=None,
        cpu=None,
        second=None,
        bluetooth=None,
    ):
        self._to_board, self._to_host = bytearray(), bytearray()
        port = SimpleNamespace(
            receive=lambda: _take(self._to_board),
            send=lambda data: _put(self._to_host, data, self._ROOM),
        )
        super().__init__(board_id, bus, usb, port, faults, folder, cpu, second, bluetooth)

    def received(self) -> bytes:
        """Return all bytes that the board has sent since the last call."""
        return _take(self._to_host)

    def send(self, data: bytes) -> int:
        """Send bytes to the board; return how many of them the buffer accepted."""
        return _put(self._to_board, data, self._ROOM)


def _take(buffer: bytearray) -> bytes:
    if not buffer:  # at most calls
        return b""
    data = bytes(buffer)
    buffer.clear()
    return data


def _put(buffer: bytearray, data: bytes, room: int) -> int:
    size = min(len(data), room - len(buffer))
    buffer += data[:size]
    return size
