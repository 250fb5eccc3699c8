"""Helpers of the fuzz targets: the firmware on a substitute sensor, and random fingers."""

from __future__ import annotations

import importlib.util
import random
import tempfile
from array import array
from pathlib import Path
from types import SimpleNamespace

from support.smallint import small

from spots.link.decoder import Decoder
from spots.link.frames import Touch
from spots_device.board.settings import checksum
from spots_device.fingers.state import TICKS
from spots_device.reading.decode import MISFIT, TOO_DARK, TOUCHING
from spots_device.sensor.as7341 import AS7341
from spots_sim.board.cpython_board import use_folder

# Largest number of command lines for a board: more lines test nothing new, and take time.
LINES_MAX = 40
_WRAP = 1 << 30
_SETTLE_STEPS = 100  # a search over all gains, or a dark frame, needs fewer loop passes
_COUNTS = (900, 1200, 2000, 2500, 3000, 1500)
_LENGTH_UM = 85_000

_STORE = tempfile.TemporaryDirectory(prefix="spots-fuzz-")


def own(name):
    """Return a separate copy of a module of the firmware, which collects no garbage."""
    spec = importlib.util.find_spec(f"spots_device.{name}")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    module.gc = SimpleNamespace(collect=lambda: None)  # real collections take most of the time
    return module


def _own_app():
    """Return a separate copy of the firmware's module `app`.

    It stores files in a folder of its own. Neither it nor the modules that it uses collect garbage.
    """
    module, strip_app = own("board.app"), own("board.strip_app")
    module.StripApp = strip_app.StripApp
    store = own("board.store")
    use_folder(store, Path(_STORE.name))
    module.Store = store.Store
    command = own("board.command")
    module.Commands, strip_app.Upload = command.Commands, command.Upload
    return module


_app = _own_app()


class _Clock:
    def __init__(self):
        self.now_us = 0

    def ticks_us(self):
        return self.now_us % _WRAP

    def ticks_add(self, ticks, us):
        return (ticks + us) % _WRAP

    def ticks_diff(self, a, b):
        return (a - b + _WRAP // 2) % _WRAP - _WRAP // 2

    def sleep_us(self, us):
        self.now_us += us


class _Serial:
    def __init__(self):
        self.heard = bytearray()
        self.said = bytearray()

    def read(self):
        return self.heard.pop(0) if self.heard else -1

    def write(self, data, size):
        self.said += bytes(data[:size])
        return True


class _Sensor:
    """Substitute for `as7341.AS7341`; its counts grow with gain and exposure up to full scale."""

    def __init__(self, clock):
        self._clock = clock
        self.pacing = SimpleNamespace(missed=0, due=0)
        self.counts = array("i", bytes(4 * 6))
        self._path = SimpleNamespace(fifo=0)
        self.retries = self.complete = self.asked = self.waits = 0
        self.led = "ldr"
        self.gpio = lambda on: None
        self.thermometer = None
        self.steady, self.saturated = True, False

    def start(self, plan, gain, exposure_us, led_mA, mains_hz):
        self.plan, self.gain = tuple(plan), gain
        self.exposure_us, self.led_mA = exposure_us, led_mA
        self.full_scale = min(65_535, exposure_us)
        self.led_on = led_mA > 0

    def stop(self):
        self.led_on = False

    def switch_led(self, on):
        self.led_on = on and self.led_mA > 0

    def poll(self):
        self.asked = self._clock.ticks_us()
        self._clock.now_us += self.exposure_us
        self.complete = self.pacing.due = self._clock.ticks_us()
        light = (2**self.gain * self.exposure_us * (1 + self.led_mA)) if self.led_on else 0
        for i in range(6):
            level = _COUNTS[i] * light // (512 * 10_000 * 20) + 3
            self.counts[i] = min(level, self.full_scale)
        self.saturated = max(self.counts) >= self.full_scale
        return True

    def check(self):
        pass

    def report(self, reply):
        AS7341.report(self, reply)

    def saturation(self):
        return "digital" if self.saturated else None


class Board:
    """The firmware's application after a start, with a simulated clock."""

    def __init__(self):
        for path in Path(_STORE.name).iterdir():
            path.unlink()
        clock, self._serial = _Clock(), _Serial()
        board = SimpleNamespace(NAME="virtual", LED_MAX_MA=100)
        self._board = _app.Board(
            board, "cpython", "00ff", lambda *_: _Sensor(clock), clock, self._serial
        )
        self.app = self._board.strips[0]
        self._decoder = Decoder()
        self.settle()
        self.said()

    def hear(self, data):
        """Send bytes to the board, and run the board until it has read all bytes."""
        self._serial.heard += data
        self._board.step()
        while self._serial.heard:
            self._board.step()

    def summed(self, line):
        """Return a line in which the checksum of the uploaded lines replaces ``CHECKSUM``."""
        upload = self.app.uploads["layout" if line.startswith(b"layout") else "cal"]
        return line.replace(b"CHECKSUM", checksum(upload._lines or []).encode())

    def said(self):
        """Return the frames that the board has sent since the last call; all must be valid."""
        frames = self._decoder.feed(bytes(self._serial.said))
        self._serial.said.clear()
        assert not self._decoder.stats.bad_crc
        assert not self._decoder.stats.lost
        return frames

    def settle(self):
        """Run the board until it has replied to its last command."""
        for _ in range(_SETTLE_STEPS):
            self._board.step()
            if not self.app.replies._claimed:
                return

    def state(self):
        """Return all settings, streams, calibration lines and layout lines, for comparison."""
        app = self.app
        return (
            dict(app.settings.values),
            app.strip.stream_touch,
            app.strip.stream_spectrum,
            list(app.calibration.lines),
            list(app.outputs.layout_lines),
        )


class Fingers:
    """Receiver of a keypad's events, which also plays fingers; `down` contains the pressed keys."""

    def __init__(self):
        self.down = set()

    def key(self, page, usage, modifiers, pressed):
        pass

    def usage(self, page, usage, modifiers, pressed):
        key = page, usage
        assert pressed != (key in self.down), "a key must be pressed and released in turn"
        (self.down.add if pressed else self.down.remove)(key)

    def has_room(self):
        return True

    def stuck(self):
        pass

    def play(self, pad, seed):
        """Press, slide, tap and lift on the keypad `pad` at random; lift all fingers at the end."""
        rng = random.Random(seed)
        t = TICKS - 2000
        for _ in range(40):
            x_um, force_mN = rng.randrange(_LENGTH_UM), rng.randrange(9000)
            speed_um = rng.choice((0, 0, 300, -1500))
            flags = rng.choice((TOUCHING, TOUCHING, TOUCHING, TOUCHING | MISFIT))
            for _ in range(rng.choice((2, 4, 30, 90))):
                x_um = min(max(x_um + speed_um, 0), _LENGTH_UM)
                t = (t + 10) % TICKS
                pad.take(flags, x_um, force_mN, 8 << 20, t)
                pad.tick(t)
            for _ in range(rng.choice((0, 2, 8, 60))):
                t = (t + 10) % TICKS
                pad.take(TOO_DARK, 0, 0, 0, t)
                pad.tick(t)
        pad.release()


def shrink(calibration):
    """Convert the tables of a calibration to integers that raise an error beyond 31 bits."""
    calibration.tables = small(calibration.tables)


def play_controller(controller, settings):
    """Give a controller the readings of two seconds; check that its states are in range.

    `controller` is the class, `settings` its settings.
    """
    made = controller(settings, _LENGTH_UM)
    rng = random.Random(0)
    for i in range(200):
        flags = TOUCHING if i % 40 < 25 else TOO_DARK
        reading = Touch(0, i, 10_000 * i, flags, 0, 0, rng.randrange(_LENGTH_UM), 40 * i)
        made.take(reading, 0.01 * i)
        state = made.state
        assert -32_767 <= state.x <= 32_767
        assert -32_767 <= state.y <= 32_767
        assert 0 <= state.z <= 32_767
        assert 0 <= state.buttons < 1 << 16
