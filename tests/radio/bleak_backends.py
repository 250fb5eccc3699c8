"""Backends of bleak whose adapter is a simulated host, and a thread in which the board runs."""

import asyncio
import queue
import threading
import time
from concurrent.futures import Future

from bleak.backends.characteristic import BleakGATTCharacteristic
from bleak.backends.client import BaseBleakClient
from bleak.backends.scanner import AdvertisementData, BaseBleakScanner
from bleak.backends.service import BleakGATTService, BleakGATTServiceCollection
from bleak.exc import BleakError
from bumble import gatt, hci
from bumble.core import AdvertisingData, BaseBumbleError
from bumble.device import Peer

_PROPERTIES = {
    gatt.Characteristic.Properties.READ: "read",
    gatt.Characteristic.Properties.WRITE: "write",
    gatt.Characteristic.Properties.WRITE_WITHOUT_RESPONSE: "write-without-response",
    gatt.Characteristic.Properties.NOTIFY: "notify",
}


class Adapter:
    """Runs a rig in real time, in a thread; `host` is the computer whose adapter bleak uses."""

    def __init__(self, rig, host):
        self.host, self._rig = host, rig
        self._tasks = queue.SimpleQueue()
        self._stopped = False
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self):
        ahead_s = self._rig.link.now_s() - time.monotonic()
        while not self._stopped:
            while not self._tasks.empty():
                self._rig.air.begin(self._do(*self._tasks.get()))
            self._rig.step()
            time.sleep(max(0.0, self._rig.link.now_s() - ahead_s - time.monotonic()))

    async def _do(self, task, done):
        try:
            done.set_result(await task)
        except BaseException as error:
            done.set_exception(error)

    async def do(self, task):
        """Run a coroutine of the host; errors are those of bleak."""
        done = Future()
        self._tasks.put((task, done))
        try:
            return await asyncio.wrap_future(done)
        except (BaseBumbleError, asyncio.CancelledError) as error:
            raise BleakError(str(error)) from None

    def drop(self):
        """End all connections, as if the computer went out of reach for a moment."""

        async def end():
            for one in list(self.host.device.connections.values()):
                await one.disconnect()

        self._tasks.put((end(), Future()))

    def stop(self):
        self._stopped = True
        self._thread.join()

    def scanner(self):
        """Return the class of scanners that listen with this adapter."""
        adapter = self

        class Scanner(BaseBleakScanner):
            def __init__(self, callback, uuids, mode, **_):
                super().__init__(callback, uuids)

            async def start(self):
                loop = asyncio.get_running_loop()
                adapter.host.device.on(
                    "advertisement", lambda one: loop.call_soon_threadsafe(self._heard, one)
                )
                await adapter.do(adapter.host.device.start_scanning(filter_duplicates=False))

            def _heard(self, one):
                name = one.data.get(AdvertisingData.Type.COMPLETE_LOCAL_NAME)
                uuids = one.data.get(
                    AdvertisingData.Type.COMPLETE_LIST_OF_128_BIT_SERVICE_CLASS_UUIDS
                )
                told = AdvertisementData(
                    name,
                    {},
                    {},
                    [one_.to_hex_str("-").lower() for one_ in uuids or []],
                    None,
                    -40,
                    (),
                )
                address = str(one.address).removesuffix("/P")
                device = self.create_or_update_device(address, address, name, None, told)
                self.call_detection_callbacks(device, told)

            async def stop(self):
                adapter.host.device.remove_all_listeners("advertisement")
                await adapter.do(adapter.host.device.stop_scanning())

        return Scanner

    def client(self):
        """Return the class of clients that connect with this adapter."""
        adapter = self

        class Client(BaseBleakClient):
            _connection = None

            def __init__(self, address, **options):
                known = "timeout", "disconnected_callback", "services"
                super().__init__(address, **{n: v for n, v in options.items() if n in known})

            @property
            def mtu_size(self):
                return self._connection.att_mtu

            @property
            def is_connected(self):
                return self._connection is not None

            async def connect(self, pair, **_):
                loop = asyncio.get_running_loop()
                device = adapter.host.device

                async def connect():
                    one = await device.connect(
                        f"{self.address}/P", own_address_type=hci.OwnAddressType.PUBLIC
                    )
                    one.on("disconnection", lambda _: loop.call_soon_threadsafe(self._gone))
                    peer = Peer(one)
                    await peer.request_mtu(247)
                    if await device.keystore.get(str(one.peer_address)):
                        await one.encrypt()
                    await peer.discover_services()
                    for service in peer.services:
                        await service.discover_characteristics()
                    return one, peer

                self._connection, self._peer = await adapter.do(connect())
                self.services = BleakGATTServiceCollection()
                for service in self._peer.services:
                    made = BleakGATTService(service, service.handle, _long(service.uuid))
                    self.services.add_service(made)
                    for one in service.characteristics:
                        names = [name for bit, name in _PROPERTIES.items() if one.properties & bit]
                        size = self._connection.att_mtu - 3
                        self.services.add_characteristic(
                            BleakGATTCharacteristic(
                                one,
                                one.handle,
                                _long(one.uuid),
                                names,
                                lambda size=size: size,
                                made,
                            )
                        )

            def _gone(self):
                self._connection = None
                if self._disconnected_callback:
                    self._disconnected_callback()

            async def disconnect(self):
                if self._connection:
                    await adapter.do(self._connection.disconnect())

            async def pair(self, *_, **__): ...
            async def unpair(self): ...
            async def read_gatt_char(self, one, **_): ...
            async def read_gatt_descriptor(self, *_, **__): ...
            async def write_gatt_descriptor(self, *_, **__): ...
            async def stop_notify(self, one): ...

            async def write_gatt_char(self, one, data, response):
                await adapter.do(
                    self._peer.write_value(one.obj, bytes(data), with_response=response)
                )

            async def start_notify(self, one, callback, **_):
                loop = asyncio.get_running_loop()
                await adapter.do(
                    self._peer.subscribe(
                        one.obj,
                        lambda data: loop.call_soon_threadsafe(callback, bytearray(data)),
                    )
                )

        return Client


def _long(uuid):
    if len(uuid.uuid_bytes) == 16:
        return uuid.to_hex_str("-").lower()
    return f"0000{uuid.to_hex_str().lower()}-0000-1000-8000-00805f9b34fb"
