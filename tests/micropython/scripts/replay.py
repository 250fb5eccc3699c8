"""Replays recorded samples through the firmware, and prints checksums of the frames that it sends.

Reads samples.bin: for each sample, six counts with the LED on and six with the LED off, as
little-endian numbers of 16 bits. Reads from given.json: ``calibration``, its lines; ``settings``,
for each part of the recording the kinds of frames and the settings; ``samples``, their number;
``every``, the samples between two lines. A line has the number of frames so far and the CRC-32 of
their bytes. The sensor is a substitute: a sample ends every 10 ms.
"""

import json
from array import array
from binascii import crc32

import canned

_EXPOSURE_US = 10_000
_SIZE = 24  # bytes of a sample
_OFF = 12  # place of the counts with the LED off
_FULL = 65_535


class Pacing:
    missed = due = 0


class Port:
    def __init__(self):
        self.frames = self.crc = 0

    def write(self, buffer, size):
        self.crc = crc32(memoryview(buffer)[:size], self.crc)
        self.frames += 1
        return True

    def read(self):
        return -1


class Sensor:
    """Substitute for `as7341.AS7341`, whose samples are recorded ones."""

    def __init__(self, clock):
        self.pacing = Pacing()
        self.counts = array("i", bytes(24))
        self.complete = self.asked = self.waits = self.retries = 0
        self.steady = self.saturated = self.led_on = False
        self.led = "ldr"
        self.thermometer = None
        self._clock = clock

    def start(self, plan, gain, exposure_us, led_mA, mains_hz):
        self.plan = tuple(plan)
        self.gain = gain
        self.exposure_us = exposure_us
        self.led_mA = led_mA
        self.full_scale = _FULL
        self.switch_led(True)

    def poll(self):
        return False

    def stop(self):
        self.led_on = False

    def switch_led(self, on):
        self.led_on = on
        self.steady = False
        self._changed = True

    def check(self):
        pass

    def drifted(self):
        return False

    def take(self, data, at):
        """Use the sample that begins at byte `at` of `data`."""
        clock = self._clock
        clock.now = self.complete = clock.ticks_add(clock.now, _EXPOSURE_US)
        if not self.led_on:
            at += _OFF
        for i in range(6):
            self.counts[i] = data[at + 2 * i] | data[at + 2 * i + 1] << 8
        self.saturated = max(self.counts) >= _FULL
        self.steady = not self._changed  # the LED was not switched during the sample
        self._changed = False


def main():
    with open("given.json") as file:
        given = json.load(file)
    clock, port = canned.Clock(), Port()
    sensor = Sensor(clock)
    board = canned.Board(canned.BoardConfig, "canned", "00", lambda *_: sensor, clock, port, None)
    board.step()
    app = board.strips[0]
    app.use_calibration(given["calibration"])
    app.strip.stream(["touch"])
    every = given["every"]
    parts = given["settings"]
    taken = 0
    with open("samples.bin", "rb") as file:
        for words in parts:
            kinds = [word for word in words if "=" not in word]
            app.settings.change([word for word in words if "=" in word])
            app.apply_calibration()
            app.strip.stream(kinds)
            left = given["samples"] // len(parts)
            while left:
                data = file.read(_SIZE * min(left, 500))
                for at in range(0, len(data), _SIZE):
                    sensor.take(data, at)
                    app.strip.take()
                    app.outputs.pump()
                    left -= 1
                    taken += 1
                    if taken % every == 0:
                        print(port.frames, port.crc)


main()
