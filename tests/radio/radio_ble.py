"""MicroPython's `bluetooth.BLE`, with Bumble in place of NimBLE.

Where the two differ, this module does as NimBLE and MicroPython do: it asks the event handler for
the secrets of bonds, deletes the bond of a host that pairs again, and sends notifications whether
the host has subscribed or not.
"""

from __future__ import annotations

import asyncio
import errno
from collections.abc import Callable
from typing import Any

from bumble import core, hci, smp
from bumble.att import ATT_Error, Attribute, ErrorCode
from bumble.device import Connection
from bumble.gatt import Characteristic, CharacteristicValue, Descriptor, Service
from bumble.keys import KeyStore, PairingKeys
from bumble.pairing import PairingConfig, PairingDelegate

_CONNECTED, _DISCONNECTED, _WRITTEN, _MTU = 1, 2, 3, 21
_ENCRYPTED, _GET_SECRET, _SET_SECRET, _PASSKEY = 28, 29, 30, 31
ASKS = _GET_SECRET, _SET_SECRET  # events that the handler answers
_SHOW = 3
_OURS, _THEIRS, _SUBSCRIPTION = 1, 2, 3
_KEY_BYTES, _VALUE_BYTES = 24, 80  # about those of NimBLE's structures
_LTK, _IRK = slice(18, 34), slice(35, 51)  # in a value
_PROTECTED = 8  # in a value: whether a passkey protected the pairing
_READ_ENC, _WRITE_ENC = 0x0200, 0x1000
_WRITTEN_MAX = 20  # bytes of a value without a buffer of its own
_QUEUED_MAX = 12  # notifications that the stack holds


class Uuid:
    """As ``bluetooth.UUID``: 16 bits, or a text of 128 bits."""

    def __init__(self, value: int | str):
        self.value = core.UUID.from_16_bits(value) if isinstance(value, int) else core.UUID(value)


class Ble:
    """As ``bluetooth.BLE``; `address` is that of the board.

    The handler gets its events while `Air` runs, between two calls of the firmware.
    """

    def __init__(self, air, address: str = "F0:F1:F2:F3:F4:F5"):
        self._air = air
        self.device = air.device("board", address)
        self._handler: Callable[[int, tuple], Any] = lambda event, data: None
        self._options: dict[str, Any] = {}
        self._values: dict[int, bytes] = {}
        self._sizes: dict[int, int] = {}  # of buffers to which writes append
        self._attributes: dict[int, Attribute] = {}
        self._connections: dict[int, Connection] = {}
        self._advertised: dict[str, Any] | None = None
        self._passkey: Any = None
        self._queued = 0
        self.device.keystore = _Secrets(self)
        self.device.pairing_config_factory = self._pairing
        self.device.on("connection", self._connected)

    def irq(self, handler: Callable[[int, tuple], Any]) -> None:
        self._handler = handler

    def tell(self, event: int, *data: Any) -> None:
        """Call the handler of the firmware."""
        self._handler(event, data)

    async def ask(self, event: int, *data: Any) -> Any:
        """Call the handler of the firmware, and return its answer."""
        answer = self._handler(event, data)
        return await answer if isinstance(answer, asyncio.Future) else answer

    def active(self, on: bool) -> None:
        if on:
            self._air.wait(self.device.power_on())
        else:
            self.end()

    def config(self, **options: Any) -> None:
        self._options |= options

    def end(self) -> None:
        """Switch the stack off: the firmware has ended."""
        self._handler = lambda event, data: None
        self._air.remove(self.device)

    # GATT.

    def gatts_register_services(self, services: tuple) -> tuple:
        made = []
        for uuid, characteristics in services:
            rows = [self._characteristic(*one) for one in characteristics]
            self.device.add_service(Service(uuid.value, [row[0][0] for row in rows]))
            made.append(tuple(self._number(*one) for row in rows for one in row))
        return tuple(made)

    def _characteristic(
        self, uuid: Uuid, flags: int, descriptors: tuple = ()
    ) -> list[tuple[Attribute, list[int]]]:
        rows: list[tuple[Attribute, list[int]]] = []
        for one, its_flags in descriptors:
            its_flags &= 0xFF  # NimBLE guards no descriptor
            handle: list[int] = []
            rows.append(
                (
                    Descriptor(one.value, _permissions(its_flags), self._value(handle, its_flags)),
                    handle,
                )
            )
        handle = []
        properties = Characteristic.Properties(flags & 0xFF)
        under = [row[0] for row in rows]
        one = Characteristic(
            uuid.value, properties, _permissions(flags), self._value(handle, flags), under
        )
        return [(one, handle), *rows]

    def _value(self, handle: list[int], flags: int) -> CharacteristicValue:
        # `handle` gets the number of the attribute when this is registered.
        # Bumble looks only at the flags that ask for encryption.
        def read(by: Connection) -> bytes:
            if not _permissions(flags) & Attribute.Permissions.READABLE:
                raise ATT_Error(ErrorCode.READ_NOT_PERMITTED)
            return self._values[handle[0]]

        def write(by: Connection, data: bytes) -> None:
            if not _permissions(flags) & Attribute.Permissions.WRITEABLE:
                raise ATT_Error(ErrorCode.WRITE_NOT_PERMITTED)
            self._written(by, handle[0], data)

        return CharacteristicValue(read=read, write=write)

    def _number(self, attribute: Attribute, handle: list[int]) -> int:
        handle.append(attribute.handle)
        self._attributes[attribute.handle] = attribute
        self._values[attribute.handle] = b""
        return attribute.handle

    def _written(self, by: Connection, handle: int, data: bytes) -> None:
        if handle in self._sizes:  # what has no room is lost
            data = (self._values[handle] + data)[: self._sizes[handle]]
        else:
            data = data[:_WRITTEN_MAX]
        self._values[handle] = data
        self.tell(_WRITTEN, by.handle, handle)

    def gatts_write(self, handle: int, data: bytes) -> None:
        self._values[handle] = bytes(data)

    def gatts_read(self, handle: int) -> bytes:
        if handle not in self._values:
            raise OSError(errno.EINVAL)
        data = self._values[handle]
        if handle in self._sizes:
            self._values[handle] = b""
        return data

    def gatts_set_buffer(self, handle: int, size: int, append: bool) -> None:
        if append:
            self._sizes[handle] = size

    def gatts_notify(self, conn: int, handle: int, data: Any) -> None:
        by = self._connections.get(conn)
        if by is None:
            raise OSError(errno.ENOTCONN)
        packets = self.device.host.le_acl_packet_queue
        if self._queued + (packets.pending if packets else 0) >= _QUEUED_MAX:
            raise OSError(errno.ENOMEM)
        self._queued += 1
        self._air.begin(self._notify(by, handle, bytes(data)))

    async def _notify(self, by: Connection, handle: int, data: bytes) -> None:
        try:
            attribute = self._attributes[handle]
            await self.device.gatt_server.notify_subscriber(by, attribute, data, force=True)
        finally:
            self._queued -= 1

    # GAP.

    def gap_advertise(self, interval_us: int, adv_data: bytes, resp_data: bytes = b"") -> None:
        self._advertised = {
            "advertising_data": bytes(adv_data),
            "scan_response_data": bytes(resp_data),
            "own_address_type": hci.OwnAddressType.PUBLIC,
            "advertising_interval_min": interval_us / 1000,
            "advertising_interval_max": interval_us / 1000,
        }
        self._air.begin(self.device.start_advertising(**self._advertised))

    def gap_disconnect(self, conn: int) -> bool:
        by = self._connections.get(conn)
        if by is None:
            return False
        self._air.begin(by.disconnect())
        return True

    def gap_passkey(self, conn: int, action: int, passkey: int) -> None:
        if self._passkey and not self._passkey.done():
            self._passkey.set_result(passkey)

    def _connected(self, by: Connection) -> None:
        self._connections[by.handle] = by
        address = by.peer_address
        by.on("disconnection", lambda _: self._disconnected(by))
        by.on("connection_att_mtu_update", lambda: self.tell(_MTU, by.handle, by.att_mtu))
        by.on("connection_encryption_change", lambda: self._air.begin(self._encrypted(by)))
        by.on("pairing", lambda keys: self._air.begin(self._encrypted(by)))
        self.tell(_CONNECTED, by.handle, address.address_type, _wire(address))

    def _disconnected(self, by: Connection) -> None:
        self._connections.pop(by.handle, None)
        if self._passkey and not self._passkey.done():
            self._passkey.cancel()
        address = by.peer_address
        self.tell(_DISCONNECTED, by.handle, address.address_type, _wire(address))

    async def _encrypted(self, by: Connection) -> None:
        session = self.device.smp_manager.sessions.get(by.handle)
        if session:
            protected = session.pairing_method != smp.PairingMethod.JUST_WORKS
        else:
            value = await self.ask(_GET_SECRET, _OURS, 0, _key(by.peer_address))
            protected = value is not None and bool(value[_PROTECTED])
        self.tell(_ENCRYPTED, by.handle, by.is_encrypted, protected, True, 16)

    # Pairing.

    def _pairing(self, by: Connection) -> PairingConfig:
        return PairingConfig(
            sc=self._options.get("le_secure", False),
            mitm=self._options.get("mitm", False),
            bonding=self._options.get("bond", False),
            delegate=_Delegate(self, by, self._options.get("io", 3)),
        )

    async def forget_before_pairing(self, address: hci.Address) -> None:
        """Delete the bond with a host, as NimBLE does when this host pairs again."""
        key = _key(address)
        for _ in range(2):
            if await self.ask(_GET_SECRET, _THEIRS, 0, key) is None:
                return
            for kind in (_OURS, _THEIRS):
                await self.ask(_SET_SECRET, kind, key, None)
        raise AssertionError("NimBLE would delete this bond again and again, and hang")

    async def passkey(self, by: Connection) -> int:
        """Ask the firmware for a passkey, and wait for it."""
        self._passkey = asyncio.get_running_loop().create_future()
        self.tell(_PASSKEY, by.handle, _SHOW, 0)
        return await self._passkey


class _Delegate(PairingDelegate):
    def __init__(self, ble: Ble, by: Connection, io: int):
        super().__init__(PairingDelegate.IoCapability(io))
        self._ble, self._by = ble, by

    async def accept(self) -> bool:
        await self._ble.forget_before_pairing(self._by.peer_address)
        return True

    async def generate_passkey(self) -> int:
        return await self._ble.passkey(self._by)


class _Secrets(KeyStore):
    """The firmware's secrets as Bumble's store of keys."""

    def __init__(self, ble: Ble):
        self._ble = ble

    async def get(self, name: str) -> PairingKeys | None:
        value = await self._ble.ask(_GET_SECRET, _OURS, 0, _key(hci.Address(name)))
        if value is None:
            return None
        value = bytes(value)
        return PairingKeys(ltk=PairingKeys.Key(value[_LTK], bool(value[_PROTECTED])))

    async def update(self, name: str, keys: PairingKeys) -> None:
        key = _key(hci.Address(name))
        for kind, irk in ((_THEIRS, keys.irk), (_OURS, None)):
            value = bytearray(_VALUE_BYTES)
            if keys.ltk:
                value[_PROTECTED] = keys.ltk.authenticated
                value[_LTK] = keys.ltk.value
            if irk:
                value[_IRK] = irk.value
            await self._ble.ask(_SET_SECRET, kind, key, memoryview(value))

    async def get_all(self) -> list[tuple[str, PairingKeys]]:
        return []

    async def delete(self, name: str) -> None:
        raise NotImplementedError


def _permissions(flags: int) -> Attribute.Permissions:
    of = Attribute.Permissions
    made = of(0)
    if flags & Characteristic.Properties.READ:
        made |= of.READABLE
    if flags & (Characteristic.Properties.WRITE | Characteristic.Properties.WRITE_WITHOUT_RESPONSE):
        made |= of.WRITEABLE
    if flags & _READ_ENC:
        made |= of.READ_REQUIRES_ENCRYPTION
    if flags & _WRITE_ENC:
        made |= of.WRITE_REQUIRES_ENCRYPTION
    return made


def _wire(address: hci.Address) -> bytes:
    return bytes(address)[::-1]


def _key(address: hci.Address) -> bytes:
    kind = address.address_type & 1  # an identity has the kind of its address
    return (bytes((kind,)) + bytes(address)).ljust(_KEY_BYTES, b"\0")
