"""Measures, in MicroPython, time and memory of a sample with integers and with floats.

The package ``spots_device_viper`` is ``spots_device`` with its kernel as machine code. The script
reads ``inputs.json`` and prints one JSON object. Each round measures all variants with the same
counts, one after the other. So if the computer becomes slower, this affects all variants equally.
"""

import binascii
import gc
import json
import time

import canned
from floats import FloatPath
from spots_device.board.app import Board
from spots_device.reading.kernel import process

try:
    from spots_device_viper.board.app import Board as ViperBoard
    from spots_device_viper.reading.kernel import process as viper_process
except SyntaxError:  # this MicroPython cannot compile to machine code
    ViperBoard = None

_DARK_SAMPLES = 64
_WARM_UP = 100


class Port:
    """A serial port that counts bytes and frames, and copies nothing."""

    def __init__(self):
        self.bytes = 0
        self.frames = 0

    def write(self, buffer, size):
        self.bytes += size
        self.frames += 1
        return True

    def read(self):
        return -1


class Spots:
    """Runs the firmware: the whole loop, the part after the counts, or the arithmetic alone."""

    def __init__(self, calibration, make, process):
        self.port = Port()
        self.board, self.bus, self.clock, _ = canned.app(calibration, self.port, make=make)
        strip = self.board.strips[0].strip
        strip.stream_spectrum = False
        self._process = process
        # Bound here: binding a method allocates memory, which must not count for a sample.
        self._step = self.board.step
        self._take = self.board.strips[0].strip.take

    def whole(self, samples):
        step = self._step
        port = self.port
        end = port.frames + samples
        while port.frames < end:
            step()

    def from_counts(self, samples):
        take = self._take
        for _ in range(samples):
            take()

    def from_sums(self, samples):
        """Run arithmetic and framing alone, without averaging, dark frames and time."""
        process = self._process
        work = self.board.strips[0].strip._work
        for _ in range(samples):
            process(work, 0)

    def dark(self):
        return [total / _DARK_SAMPLES for total in self.board.strips[0].strip.dark_frame()]


class Floats:
    """Runs one of the float variants: the whole sample, or the part after the counts."""

    def __init__(self, calibration, dark, send):
        self.port = Port()
        clock = canned.Clock()
        self.bus = canned.Bus(clock)
        path = FloatPath(calibration, dark, self.bus, clock, self.port)
        self._read = path.read
        self._send = getattr(path, send)

    def whole(self, samples):
        read = self._read
        send = self._send
        for _ in range(samples):
            send(read())

    def from_counts(self, samples):
        counts = self._read()
        send = self._send
        for _ in range(samples):
            send(counts)


def main():
    """Measure all variants with the inputs of ``inputs.json``, and print the results."""
    with open("inputs.json") as file:
        given = json.load(file)
    spots = Spots(given["calibration"], Board, process)
    paths = {
        "spots": spots,
        "float_json": Floats(given["calibration"], spots.dark(), "send_json"),
        "float_struct": Floats(given["calibration"], spots.dark(), "send_struct"),
    }
    if ViperBoard:
        paths["spots_viper"] = Spots(given["calibration"], ViperBoard, viper_process)
    found = {name: measure_space(path, given) for name, path in paths.items()}
    for name in paths:
        found[name]["vm_us"] = []
        found[name]["vm_us_from_counts"] = []
        found[name]["vm_us_from_sums"] = []
    for _ in range(given["rounds"]):
        for name, path in paths.items():
            found[name]["vm_us"].append(timed_us(path, path.whole, given))
            found[name]["vm_us_from_counts"].append(timed_us(path, path.from_counts, given))
            if name.startswith("spots"):
                found[name]["vm_us_from_sums"].append(timed_us(path, path.from_sums, given))
    stream, lines = record(given, spots.dark())
    print(json.dumps({"paths": found, "stream": stream, "lines": lines}))


def measure_space(path, given):
    """Return the heap bytes and the sent bytes of a sample, measured without garbage collection."""
    path.bus.counts(given["counts"][0])
    path.whole(_WARM_UP)
    gc.collect()
    gc.disable()
    heap = samples = 0
    port_before = path.port.bytes
    run = path.whole
    for counts in given["counts"]:
        path.bus.counts(counts)
        before = gc.mem_alloc()
        run(given["repeats"])
        heap += gc.mem_alloc() - before
        samples += given["repeats"]
    gc.enable()
    return {
        "heap_bytes_per_sample": heap / samples,
        "wire_bytes_per_sample": (path.port.bytes - port_before) / samples,
    }


def timed_us(path, run, given):
    """Return the time of one sample in us, without garbage collection."""
    gc.collect()
    gc.disable()
    total = samples = 0
    for counts in given["counts"]:
        path.bus.counts(counts)
        path.whole(1)
        began = time.ticks_us()
        run(given["repeats"])
        total += time.ticks_diff(time.ticks_us(), began)
        samples += given["repeats"]
    gc.enable()
    return total / samples


def record(given, dark):
    """Return the TOUCH frames of all sets of counts in hexadecimal, and a line of JSON for each."""
    board, bus, clock, port = canned.app(given["calibration"])
    board.strips[0].strip.stream_spectrum = False
    json_port = canned.Serial()
    path = FloatPath(given["calibration"], dark, bus, clock, json_port)
    stream = bytearray()
    lines = []
    for counts in given["counts"]:
        bus.counts(counts)
        end = port.frames + 1
        while port.frames < end:
            board.step()
        stream.extend(memoryview(port.last)[: port.size])
        path.send_json(counts)
        lines.append(bytes(json_port.last[: json_port.size]).decode())
    return binascii.hexlify(stream).decode(), lines


main()
