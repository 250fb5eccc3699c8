"""The air between Bluetooth controllers, and the event loop in which all of them run."""

from __future__ import annotations

import asyncio
import math
from collections import deque
from collections.abc import Coroutine
from random import Random
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


class RadioController(Controller):
    """Sends data when `air` lets it, and tells its stack only then that there is room for more."""

    total_num_le_acl_data_packets = 8  # few, as in a chip
    le_acl_data_packet_length = 251  # with the longer packets of Bluetooth 4.2

    def __init__(self, air: Air, name: str, **options):
        super().__init__(name, **options)
        self._air = air
        self._waiting: deque[hci.HCI_AclDataPacket] = deque()

    def on_hci_acl_data_packet(self, packet: hci.HCI_AclDataPacket) -> None:
        self._waiting.append(packet)
        if len(self._waiting) == 1:
            asyncio.get_running_loop().create_task(self._send())

    async def _send(self) -> None:
        while self._waiting:
            await self._air.event()
            missed = 0
            for _ in range(len(self._waiting)):
                missed = missed + 1 if self._air.is_disturbed() else 0
                if (
                    missed == 2
                ):  # two in a row end the event: Bluetooth Core 5.4, Vol 6 Part B 4.5.6
                    break
                if not missed:
                    super().on_hci_acl_data_packet(self._waiting[0])
                    self._waiting.popleft()


class _Loop(asyncio.SelectorEventLoop):
    """An event loop that never waits; its time is simulated."""

    now_s = 0.0

    def time(self) -> float:
        return self.now_s


class Air:
    """Bluetooth devices that hear each other, in simulated time.

    Data go in connection events, `interval_s` apart, in both directions; with 0, they take no time.
    The part `repeated` of the packets is not received, and sent again before those behind it.
    While `holds` is true, no packet goes.
    """

    def __init__(self, interval_s: float = 0.0, repeated: float = 0.0):
        self.holds = False
        self.interval_s, self.repeated = interval_s, repeated
        self.uuid = Uuid
        self._random = Random(0)
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
            host.controller = RadioController(self, name, link=self._link, public_address=public)
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

    async def event(self) -> None:
        """Wait for the next connection event."""
        while self.holds:
            await asyncio.sleep(_STEP_S)
        if self.interval_s:
            events = math.floor(self.now_s / self.interval_s) + 1
            await asyncio.sleep(events * self.interval_s - self.now_s)

    def is_disturbed(self) -> bool:
        """Return whether the next packet is not received, and must be sent again."""
        return self.repeated > 0 and self._random.random() < self.repeated

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
