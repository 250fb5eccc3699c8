"""The air between Bluetooth controllers, and the event loop in which all of them run."""

from __future__ import annotations

import asyncio
from collections.abc import Coroutine
from typing import TypeVar

from bumble import hci
from bumble.controller import Controller
from bumble.core import PhysicalTransport
from bumble.device import Device
from bumble.host import Host
from bumble.link import LocalLink

from radio_ble import ASKS, Ble, Uuid

_T = TypeVar("_T")
_STEP_S = 0.001
_TURNS = 24  # of the event loop: more than one message causes


class _Link(LocalLink):
    def send_acl_data(
        self,
        sender_controller: Controller,
        destination_address: hci.Address,
        transport: PhysicalTransport,
        data: bytes,
    ) -> None:
        # Bumble names the sender by its random address, also where a connection has a public one.
        connection = sender_controller.le_connections.get(destination_address)
        receiver = self.find_le_controller(destination_address)
        if connection and receiver:
            loop = asyncio.get_running_loop()
            loop.call_soon(receiver.on_link_acl_data, connection.self_address, transport, data)


class _Loop(asyncio.SelectorEventLoop):
    """An event loop that never waits; its time is simulated."""

    now_s = 0.0

    def time(self) -> float:
        return self.now_s


class Air:
    """Bluetooth devices that hear each other, in simulated time. A message takes no time.

    While `holds` is true, a board's notifications stay in its queue, as in a disturbed air.
    """

    def __init__(self):
        self.holds = False
        self.uuid = Uuid
        self._loop = _Loop()
        self._link = _Link()

    @property
    def now_s(self) -> float:
        """Time of the devices in s."""
        return self._loop.now_s

    def device(self, name: str, address: str) -> Device:
        """Return a new device with a controller of its own, at a public address."""

        async def make() -> Device:
            host = Host()
            public = hci.Address(f"{address}/P")
            host.controller = Controller(name, link=self._link, public_address=public)
            return Device(name=name, address=public, host=host)

        return self.wait(make())

    def remove(self, device: Device) -> None:
        """Switch a device off; those that are connected to it lose the connection."""
        for connection in list(device.connections.values()):
            self.begin(connection.disconnect())
        self.settle()
        controller = device.host.controller
        if controller in self._link.controllers:
            self._link.remove_controller(controller)

    def wait(self, task: Coroutine[object, object, _T], timeout_s: float = 5.0) -> _T:
        """Run the devices until a task is done; TimeoutError if it is not after 5 s."""
        running = self._loop.create_task(task)
        end_s = self._loop.now_s + timeout_s
        while not running.done():
            if self._loop.now_s > end_s:
                running.cancel()
                self.settle()
                raise TimeoutError
            self.settle(self._loop.now_s + _STEP_S)
        return running.result()

    def stack(self) -> Ble:
        """Return a new stack, as ``bluetooth.BLE`` is."""
        return Ble(self)

    def asks(self, event: int) -> bool:
        """Return whether the stack waits for the answer of the event handler."""
        return event in ASKS

    def future(self) -> asyncio.Future:
        """Return a future of the event loop."""
        return self._loop.create_future()

    async def clear(self) -> None:
        """Wait until the air is not disturbed."""
        while self.holds:
            await asyncio.sleep(_STEP_S)

    def begin(self, task: Coroutine[object, object, object]) -> None:
        """Start a task, which `settle` runs."""
        self._loop.create_task(task)

    def settle(self, now_s: float = 0.0) -> None:
        """Run the devices until nothing is left to do; the time never goes back."""
        self._loop.now_s = max(self._loop.now_s, now_s)
        for _ in range(_TURNS):
            self._loop.call_soon(self._loop.stop)
            self._loop.run_forever()

    def close(self) -> None:
        """End all tasks."""
        for task in asyncio.all_tasks(self._loop):
            task.cancel()
        self.settle()
        self._loop.close()
