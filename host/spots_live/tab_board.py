"""Starts the firmware in MicroPython for WebAssembly; the page loads this file as ``board.py``.

`js.board` is the simulated hardware, see simulated.js: a call takes and returns numbers and
hexadecimal text, because a conversion byte by byte would take most of the time.
"""

import io
import json
import sys
from binascii import hexlify, unhexlify
from errno import EIO

import js

from spots_device.board.app import BoardApp
from spots_device.sensor.as7341 import AS7341

_hardware = js.board
_PERIOD = 1 << 30  # ticks wrap as on a microcontroller
_TEMPERATURE_mC = 25_000


class _Clock:
    ticks_us = staticmethod(lambda: _hardware.now())
    sleep_us = staticmethod(lambda us: _hardware.sleep(us))

    @staticmethod
    def ticks_add(ticks, delta):
        return (ticks + delta) & (_PERIOD - 1)

    @staticmethod
    def ticks_diff(end, start):
        return ((end - start + (_PERIOD >> 1)) & (_PERIOD - 1)) - (_PERIOD >> 1)


class _Bus:
    def read_into(self, address, register, buffer):
        found = _hardware.read(address, register, len(buffer))
        if isinstance(found, int):
            raise OSError(found)
        buffer[:] = unhexlify(found)

    def write_to(self, address, buffer):
        refused = _hardware.write(address, hexlify(buffer).decode())
        if refused:
            raise OSError(refused)
        return len(buffer)

    def write(self, buffer):
        if self.write_to(_CONFIG["ADDRESS"], buffer) != len(buffer):
            raise OSError(EIO)

    def recover(self):
        pass  # the simulated chip never holds SDA low


class _Serial:
    def write(self, buffer, size):
        _hardware.send(hexlify(buffer[:size]).decode())
        return True

    read = staticmethod(lambda: _hardware.receive())


class _Usb:
    def open(self, names):
        return {name: self._sender(name) for name in names}

    def _sender(self, name):
        def send(report):
            _hardware.report(name, hexlify(report).decode())
            return True

        return send


class _Config:
    pass


def _boot():
    config = _Config()
    for name, value in _CONFIG.items():
        setattr(config, name, value)
    sensor = AS7341(_Bus(), _Clock)
    sensor.gpio = lambda on: None
    sensor.thermometer = lambda: _TEMPERATURE_mC
    runtime = "micropython %d.%d.%d" % sys.implementation.version[:3]
    return BoardApp(config, runtime, _ID, sensor, _Clock, _Serial(), _Usb())


def run(until_us):
    """Run the loop up to a time of the simulated clock; after a reboot or a crash, boot again."""
    global _app
    while _hardware.time() < until_us:
        try:
            if _app.reboot:
                _app.run()  # ends at once, and cleanly
                _app = _boot()
            _app.step()
        except Exception as error:
            text = io.StringIO()
            sys.print_exception(error, text)
            _app.log("error", "crashed and restarts: " + text.getvalue()[-400:])
            _app = _boot()


def start(identity, config):
    """Boot the board with an id and the values of its board_config, as JSON."""
    global _ID, _CONFIG, _app
    _ID, _CONFIG = identity, json.loads(config)
    _app = _boot()
