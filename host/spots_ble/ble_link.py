"""The port ``ble:NAME``: the serial port of a board's GATT service, read with bleak."""

from __future__ import annotations

import asyncio
import threading
from argparse import Namespace
from collections.abc import Coroutine
from concurrent.futures import CancelledError
from concurrent.futures import TimeoutError as Late
from contextlib import suppress
from typing import Any, TypeVar

from spots.errors import ClosedError, PortError, PortLostError, missing
from spots.link.board import Board
from spots.link.link import Link
from spots_device.radio.services import TO_BOARD, TO_HOST, UART

try:
    from bleak import BleakClient, BleakScanner
    from bleak.backends.device import BLEDevice
    from bleak.backends.scanner import AdvertisementData
    from bleak.exc import BleakBluetoothNotAvailableError, BleakError
except ImportError:
    raise missing("boards by radio need", "bleak", "ble") from None

_T = TypeVar("_T")
_FIND_S = 8.0  # a board advertises 33 times a second, but a host listens only some of the time
_CONNECT_S = 20.0
_ANSWER_S = 5.0
_NO_MEMORY = 0x11  # "Insufficient Resources", Bluetooth Core 5.4, Vol 3 Part F 3.4.1.1
_AGAIN_S = 0.1


def open_port(target: str, options: Namespace | None = None) -> Board:
    """Open a board by radio; see `spots.link.ports`.

    `target` is the name of the board, such as ``SPOTS 3f2a``, or its address; empty for the only
    board in reach. SpotsError if there is none, or this computer is not bonded with it.
    """
    return Board(BleLink(target))


class BleLink(Link):
    """Reads and writes the serial port of a board by radio, in a thread of its own.

    `target` is a name, an address, or empty for the only board in reach. `scanner` and `client` are
    backends of bleak, in place of those of the operating system.
    """

    def __init__(self, target: str, scanner: Any = None, client: Any = None):
        self.name = f"ble:{target}"
        self._target, self._scanner, self._backend = target, scanner, client
        self._changed = threading.Condition()
        self._received = bytearray()
        self._lost = False
        self._client: BleakClient | None = None
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        try:
            self._connect()
        except BaseException:
            self.close()
            raise

    def reopen(self) -> None:
        """Connect again; PortError if the board is not in reach."""
        self.close_port()
        self._connect()

    def close_port(self) -> None:
        if self._client is not None:
            client, self._client = self._client, None
            with suppress(BleakError, PortError, OSError):
                self._wait(client.disconnect(), _ANSWER_S)

    def close(self) -> None:
        if self._loop.is_closed():
            return
        self.close_port()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes that have arrived; wait up to `timeout_s` seconds for the first one.

        PortLostError if the connection ended, ClosedError if the program has closed it.
        """
        with self._changed:
            self._changed.wait_for(lambda: self._received or self._lost, timeout_s)
            if self._received:
                data = bytes(self._received)
                self._received.clear()
                return data
        self._check()
        return b""

    def write(self, data: bytes) -> None:
        """Send bytes; PortLostError if the connection ended."""
        self._check()
        client = self._client
        assert client is not None

        async def send() -> None:
            one = client.services.get_characteristic(TO_BOARD)
            if one is None:
                raise PortError(f"the board {self.name} has no serial port: set radio=both")
            size = one.max_write_without_response_size
            for at in range(0, len(data), size):
                part = data[at : at + size]
                while not await _is_taken(client.write_gatt_char(one, part, response=True)):
                    await asyncio.sleep(_AGAIN_S)  # the stack of the board is full of frames

        try:
            self._wait(send(), _ANSWER_S)
        except BleakError as error:
            if not client.is_connected:
                raise self._gone() from None
            raise PortError(
                f"the board {self.name} is not bonded with this computer: connect it by USB, run "
                "'spots radio pair', and pair with it in the Bluetooth settings of this computer"
            ) from error

    def _check(self) -> None:
        if self._loop.is_closed():
            raise ClosedError(f"the port {self.name} is closed: open the board again")
        if self._lost or self._client is None:
            raise self._gone()

    def _gone(self) -> PortLostError:
        return PortLostError(
            f"the board on {self.name} is out of reach, or its radio is off: bring it nearer, or "
            "switch it on"
        )

    def _wait(self, task: Coroutine[Any, Any, _T], timeout_s: float) -> _T:
        waiting = asyncio.run_coroutine_threadsafe(task, self._loop)
        try:
            return waiting.result(timeout_s)
        except (Late, CancelledError):
            waiting.cancel()
            raise PortError(
                f"the board {self.name} does not answer by radio: bring it nearer"
            ) from None

    def _connect(self) -> None:
        self._lost = False
        self._received.clear()
        try:
            device = self._wait(self._find(), _FIND_S + _ANSWER_S)
            self.name = f"ble:{device.name or device.address}"
            self._client = self._wait(self._join(device), _CONNECT_S)
        except BleakBluetoothNotAvailableError:
            raise PortError(
                "this computer has no Bluetooth that is on: switch it on, or plug an adapter in"
            ) from None
        except BleakError as error:
            raise PortError(f"the board {self.name} cannot be reached by radio: {error}") from None

    async def _find(self) -> BLEDevice:
        """Return the board that is meant."""
        found: dict[str, BLEDevice] = {}
        there = asyncio.Event()

        def seen(device: BLEDevice, told: AdvertisementData) -> None:
            name = told.local_name or device.name or ""
            if self._target:
                if self._target.lower() not in (name.lower(), device.address.lower()):
                    return
                there.set()
            elif UART not in told.service_uuids and not name.startswith("SPOTS "):
                return
            found[device.address] = device

        async with BleakScanner(seen, backend=self._scanner):
            with suppress(asyncio.TimeoutError):
                await asyncio.wait_for(there.wait(), _FIND_S)
        if not found:
            what = f"no board {self._target}" if self._target else "no board"
            raise PortError(f"{what} is in reach by radio: switch the board on, and set radio=both")
        if len(found) > 1:
            names = ", ".join(f"ble:{one.name or one.address}" for one in found.values())
            raise PortError(
                f"more than one board is in reach: give one of these as the port: {names}"
            )
        return next(iter(found.values()))

    async def _join(self, device: BLEDevice) -> BleakClient:
        client = BleakClient(device, self._disconnected, backend=self._backend)
        await client.connect()
        await client.start_notify(TO_HOST, self._take)
        return client

    def _take(self, _: Any, data: bytearray) -> None:
        with self._changed:
            self._received += data
            self._changed.notify_all()

    def _disconnected(self, client: BleakClient) -> None:
        with self._changed:
            if client is self._client:
                self._lost = True
            self._changed.notify_all()


async def _is_taken(write: Coroutine[Any, Any, None]) -> bool:
    try:
        await write
    except BleakError as error:
        if error.args[:1] != (_NO_MEMORY,):
            raise
        return False
    return True
