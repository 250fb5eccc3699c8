"""The memory of a command on a recording does not grow with the recording."""

import json
import struct
import subprocess
import sys

import pytest

from reels import record
from test_frames import encoded, touch

SHORT, TIMES = 6000, 6
GROWS_AT_MOST_KIB = 6 * 1024
SUMMARY_GROWS_AT_MOST_KIB = 2 * 1024  # the short one, too, fills a block
# Peak of the process itself: of a child, getrusage would count the parent's pages before exec.
RUN = """
import sys
from spots.cli import main
assert main(sys.argv[1:]) == 0
status = open("/proc/self/status").read()
print("PEAK", status.split("VmHWM:")[1].split()[0])
"""


def pieces(count):
    """Yield reads of a reading, a spectrum and a text each."""
    for i in range(count):
        frames = [touch(3 * i, 1000 + i)]
        body = struct.pack("<BB6H", 0, 5, *range(i % 100, i % 100 + 6))
        frames.append(encoded(struct.pack("<BHI", 2, (3 * i + 1) % 65536, 1000 + i) + body))
        text = json.dumps({"re": "get", "x": "y" * (i % 40)}).encode()
        frames.append(encoded(struct.pack("<BHI", 3, (3 * i + 2) % 65536, 1000 + i) + text))
        yield b"".join(frames)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("memory")
    for name, count in (("short", SHORT), ("long", SHORT * TIMES)):
        record(folder / f"{name}.spots", pieces(count))
    return folder


def peak_kib(*arguments):
    done = subprocess.run(
        [sys.executable, "-c", RUN, *map(str, arguments)],
        capture_output=True,
        text=True,
        check=True,
    )
    return int(done.stdout.rpartition("PEAK ")[2])


@pytest.mark.parametrize("kind", ["csv", "npz", "mcap"])
def test_an_export_takes_no_memory_for_its_length(recordings, kind):
    peaks = [
        peak_kib("export", recordings / f"{name}.spots", "--to", kind) for name in ("short", "long")
    ]
    print(kind, peaks)
    assert peaks[1] - peaks[0] < GROWS_AT_MOST_KIB


def test_a_summary_takes_no_memory_for_its_length(recordings):
    short, long = (peak_kib("info", recordings / f"{name}.spots") for name in ("short", "long"))
    print(short, long)
    assert long - short < SUMMARY_GROWS_AT_MOST_KIB
