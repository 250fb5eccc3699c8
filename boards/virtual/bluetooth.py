"""`bluetooth` of the virtual board: its stack runs in the simulator.

Calls and events are JSON texts. The handler gets its events when the firmware sleeps; on a board it
gets them between any two bytecodes.
"""

import json
from binascii import hexlify, unhexlify

import _protocol
import _simulator

_PART = 200  # bytes of a text in one request
_buffer = bytearray(_PART)


def _ask(method, *arguments):
    text = json.dumps([method, [_plain(one) for one in arguments]]).encode()
    for at in range(0, len(text), _PART):
        part = text[at : at + _PART]
        _simulator.call(_protocol.BLE, int(at + _PART >= len(text)), len(part), 0, part)
    answer = b""
    while True:
        _simulator.call(_protocol.BLE_ANSWER, 0, 0, _PART, _buffer)
        answer += bytes(_buffer).rstrip(b" ")
        if answer.endswith(b"\n"):
            return _back(json.loads(answer))


def _plain(one):
    # JSON has no bytes.
    if isinstance(one, (bytes, bytearray, memoryview)):
        return {"hex": hexlify(bytes(one)).decode()}
    if isinstance(one, UUID):
        return {"uuid": one.value}
    if isinstance(one, (tuple, list)):
        return [_plain(part) for part in one]
    return one


def _back(one):
    if isinstance(one, dict):
        if "errno" in one:
            raise OSError(one["errno"])
        return unhexlify(one["hex"])
    if isinstance(one, list):
        return tuple([_back(part) for part in one])
    return one


class UUID:
    def __init__(self, value):
        self.value = value


class BLE:
    def irq(self, handler):
        self._handler = handler

    def active(self, on):
        _ask("active", on)
        _simulator.radio = self._poll if on else None

    def config(self, **options):
        for name, value in options.items():
            _ask("config", name, value)

    def gatts_register_services(self, services):
        return _ask("gatts_register_services", services)

    def gatts_write(self, handle, data):
        _ask("gatts_write", handle, data)

    def gatts_read(self, handle):
        return _ask("gatts_read", handle)

    def gatts_set_buffer(self, handle, size, append=False):
        _ask("gatts_set_buffer", handle, size, append)

    def gatts_notify(self, conn, handle, data):
        _ask("gatts_notify", conn, handle, data)

    def gap_advertise(self, interval_us, adv_data=b"", *, resp_data=b""):
        _ask("gap_advertise", interval_us, adv_data, resp_data)

    def gap_disconnect(self, conn):
        return _ask("gap_disconnect", conn)

    def gap_passkey(self, conn, action, passkey):
        _ask("gap_passkey", conn, action, passkey)

    def _poll(self):
        for number, event, data in _ask("events"):
            answer = self._handler(event, data)
            if number is not None:
                _ask("answer", number, answer)
