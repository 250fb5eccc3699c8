"""Bluetooth hosts for tests: computers and phones that pair with a virtual board."""

import asyncio

from bumble import gatt, hci
from bumble.core import UUID, BaseBumbleError
from bumble.device import Device, Peer
from bumble.keys import MemoryKeyStore
from bumble.pairing import PairingConfig, PairingDelegate

from spots.link.decoder import Decoder
from spots.link.frames import Text
from spots_device.radio.services import TO_BOARD, TO_HOST

# What a host is told that may not do something.
REFUSED = BaseBumbleError, TimeoutError, ConnectionError
BOARD = "F0:F1:F2:F3:F4:F5/P"


class _Delegate(PairingDelegate):
    def __init__(self, host, io):
        super().__init__(io)
        self._host = host

    async def get_number(self):
        return self._host.passkey


class Host:
    """A host; `passkey` is what its user types. `reports` has report id and report."""

    def __init__(
        self, air, run, address="C0:C1:C2:C3:C4:C5", io=None, sc=True, mitm=True, keys=None
    ):
        self._air, self._run = air, run
        self.passkey = 0
        self.reports, self.data = [], bytearray()
        self.device: Device = air.device("host", address)
        self.device.keystore = keys or MemoryKeyStore()
        io = PairingDelegate.IoCapability.KEYBOARD_INPUT_ONLY if io is None else io
        self.device.pairing_config_factory = lambda _: PairingConfig(
            sc=sc, mitm=mitm, bonding=True, delegate=_Delegate(self, io)
        )
        air.wait(self.device.power_on())
        self.connection = None

    def wait(self, coroutine, seconds=5.0):
        """Run host and board until a coroutine is done; return its result, or raise its error."""
        done = []

        async def watch():
            try:
                done.append((await coroutine, None))
            except BaseException as error:
                done.append((None, error))

        self._air.begin(watch())
        end_s = self._air.now_s + seconds
        while self._air.now_s < end_s:
            self._run()
            if done:
                result, error = done[0]
                if isinstance(error, asyncio.CancelledError):
                    raise ConnectionResetError("the board has disconnected")
                if error:
                    raise error
                return result
        raise TimeoutError

    def connect(self, mtu=247):
        self.connection = self.wait(
            self.device.connect(BOARD, own_address_type=hci.OwnAddressType.PUBLIC)
        )
        self.peer = Peer(self.connection)
        self.connection.on("disconnection", lambda _: setattr(self, "connection", None))
        if mtu:
            self.wait(self.peer.request_mtu(mtu))

    def pair(self, passkey):
        self.passkey = passkey
        self.wait(self.connection.pair())
        for _ in range(10):
            self._run()  # the board stores the bond

    def come_back(self):
        """Connect, and encrypt by the bond."""
        self.connect()
        self.encrypt()

    def encrypt(self):
        self.wait(self.connection.encrypt())

    def characteristic(self, uuid):
        return self.peer.get_characteristics_by_uuid(UUID(uuid) if isinstance(uuid, str) else uuid)[
            0
        ]

    def use(self):
        """Find the services, and subscribe to keyboard and serial port as far as they are there."""
        self.find()
        self.subscribe()

    def find(self):
        async def find():
            await self.peer.discover_services()
            for service in self.peer.services:
                await service.discover_characteristics()

        self.wait(find())

    def subscribe(self, encrypted=True):
        """Subscribe to all input reports and to the serial port."""

        async def subscribe():
            for one in self.peer.get_characteristics_by_uuid(gatt.GATT_REPORT_CHARACTERISTIC):
                if one.properties & gatt.Characteristic.Properties.NOTIFY:
                    await self.peer.discover_descriptors(one)
                    number = 0
                    if encrypted:
                        reference = one.get_descriptor(gatt.GATT_REPORT_REFERENCE_DESCRIPTOR)
                        number = (await self.peer.read_value(reference))[0]
                    await self.peer.subscribe(
                        one, lambda data, number=number: self.reports.append((number, bytes(data)))
                    )
            for one in self.peer.get_characteristics_by_uuid(UUID(TO_HOST)):
                await self.peer.subscribe(one, self.data.extend)

        self.wait(subscribe())

    def set(self, number, value):
        """Write a byte to the `number`-th report that takes one: LEDs, or multipliers."""
        written = gatt.Characteristic.Properties.WRITE
        reports = self.peer.get_characteristics_by_uuid(gatt.GATT_REPORT_CHARACTERISTIC)
        one = [one for one in reports if one.properties & written][number]
        self.wait(self.peer.write_value(one, bytes((value,)), with_response=True))

    def send(self, line):
        self.write(TO_BOARD, line.encode() + b"\n")

    def write(self, uuid, data, with_response=True):
        one = self.characteristic(uuid)
        self.wait(self.peer.write_value(one, data, with_response=with_response))

    def read(self, uuid):
        return bytes(self.wait(self.peer.read_value(self.characteristic(uuid))))

    def replies(self):
        """Return the JSON objects that the serial port has received, and forget all bytes."""
        frames = whole_frames(bytes(self.data))
        self.data.clear()
        return [frame.content for frame in frames if isinstance(frame, Text)]

    def disconnect(self):
        self.wait(self.connection.disconnect())


def whole_frames(data):
    """Return the frames in bytes of a board, from the first delimiter on."""
    return Decoder().feed(b"\0" + data)


def pressed(reports):
    """Return the usages of the keys that a host saw pressed."""
    return [bytes(report)[2] for _, report in reports if report[2]]


def is_up(reports):
    """Return whether the newest report has no key."""
    return not reports or not any(reports[-1][1])
