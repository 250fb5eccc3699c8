"""The radio of a virtual board: MicroPython's module `bluetooth`."""

from __future__ import annotations

import json
from asyncio import Future
from types import SimpleNamespace
from typing import Any, Protocol

# Methods of `bluetooth.BLE` that a board in a process of its own may call.
_METHODS = frozenset(
    (
        "gatts_register_services",
        "gatts_write",
        "gatts_read",
        "gatts_set_buffer",
        "gatts_notify",
        "gap_advertise",
        "gap_disconnect",
        "gap_passkey",
    )
)


class Air(Protocol):
    """What a radio needs: a Bluetooth stack, and the devices around it, in simulated time.

    `uuid` is what ``bluetooth.UUID`` is.
    """

    uuid: Any

    def stack(self) -> Any:
        """Return a new stack with the methods of ``bluetooth.BLE``, and `end` to switch it off."""

    def settle(self, now_s: float) -> None:
        """Run stack and devices until nothing is left to do at this time."""

    def future(self) -> Future:
        """Return a future for which the stack can wait."""

    def asks(self, event: int) -> bool:
        """Return whether the stack waits for the answer of the event handler."""
        ...


class Bluetooth:
    """The radio of one board.

    Firmware in this process uses `module`. Firmware in another process sends its calls as texts,
    see ``boards/virtual/bluetooth.py``, and asks for the events.
    """

    def __init__(self, air: Air):
        self.air = air
        self.ble: Any = None  # of the firmware that runs
        self._text, self._answer = b"", b""
        self._events: list[list[Any]] = []
        self._asked: dict[int, Any] = {}

    def start(self) -> Any:
        """Return a new stack; the one of the firmware that ran before is gone."""
        if self.ble:
            self.ble.end()
        self.ble = self.air.stack()
        return self.ble

    def module(self) -> SimpleNamespace:
        """Return the module `bluetooth`."""
        return SimpleNamespace(BLE=self.start, UUID=self.air.uuid)

    def settle(self, now_s: float) -> None:
        """Let the stack tell the firmware what has happened."""
        self.air.settle(now_s)

    def call(self, part: bytes, is_last: bool) -> None:
        """Take a part of a call; after the last one, carry the call out."""
        self._text += part
        if not is_last:
            return
        method, arguments = json.loads(self._text)
        self._text = b""
        try:
            found = self._called(method, [self._unpacked(one) for one in arguments])
        except OSError as error:
            found = {"errno": error.errno}
        self._answer = json.dumps(_packed(found)).encode() + b"\n"

    def answer(self, size: int) -> bytes:
        """Return the next part of the answer, `size` bytes with spaces after it."""
        part, self._answer = self._answer[:size], self._answer[size:]
        return part.ljust(size)

    def _called(self, method: str, arguments: list[Any]) -> Any:
        if method == "active":
            [on] = arguments
            if not on:
                assert self.ble
                self.ble.end()
                return None
            self._events.clear()
            ble = self.start()
            ble.irq(self._queue)
            ble.active(True)
            return None
        assert self.ble
        if method == "config":
            name, value = arguments
            return self.ble.config(**{name: value})
        if method == "events":
            events, self._events = self._events, []
            return events
        if method == "answer":
            number, value = arguments
            asked = self._asked.pop(number)
            if not asked.done():  # the connection for which the stack asked may have ended
                asked.set_result(value)
            return None
        assert method in _METHODS
        return getattr(self.ble, method)(*arguments)

    def _unpacked(self, one: Any) -> Any:
        if isinstance(one, dict):
            return bytes.fromhex(one["hex"]) if "hex" in one else self.air.uuid(one["uuid"])
        if isinstance(one, list):
            return tuple(self._unpacked(part) for part in one)
        return one

    def _queue(self, event: int, data: tuple) -> Any:
        # A firmware in another process answers later: the stack waits for a future.
        number = None
        if self.air.asks(event):
            number = max(self._asked, default=0) + 1
            self._asked[number] = self.air.future()
        self._events.append([number, event, list(data)])
        return None if number is None else self._asked[number]


def _packed(one: Any) -> Any:
    if isinstance(one, (bytes, bytearray, memoryview)):
        return {"hex": bytes(one).hex()}
    if isinstance(one, (tuple, list)):
        return [_packed(part) for part in one]
    return one
