"""Memory of the commands that read recordings: it does not grow with the length."""

import itertools
import json
import os
import struct
import subprocess
import sys

import pytest
from support.frames import encoded, touch
from support.reels import record

pytestmark = pytest.mark.board

SHORT, TIMES = 3000, 3
PAIRS = 3  # pairs of a reading and a spectrum between two texts
# Measured: 1,500 to 2,200 KiB, by what the allocator keeps; a list of all rows of CSV takes 17,800.
GROWS_AT_MOST_KIB = 4 * 1024
SUMMARY_GROWS_AT_MOST_KIB = 1000  # the long recording has 1350 KiB more
# An array is freed to the system at once. Otherwise, where freed arrays were decides how much more
# memory later ones take: a growth of 480 KiB was found to be from 470 to 1,076 KiB.
ALLOCATOR = {"MMAP_THRESHOLD_": "32768", "TRIM_THRESHOLD_": "0", "TOP_PAD_": "0"}
ENVIRONMENT = {f"MALLOC_{name}": value for name, value in ALLOCATOR.items()}
# Both recordings are read in one process, which measures its own peak: for a child process,
# getrusage would include the parent's memory before exec. The first command has imported all
# modules that the second one needs.
RUN = """
import sys
from spots.cli import main
for path in sys.argv[1:3]:
    assert main([sys.argv[3], path, *sys.argv[4:]]) == 0
    status = open("/proc/self/status").read()
    print("PEAK", status.split("VmHWM:")[1].split()[0])
"""


def pieces(count):
    """Yield `count` blocks of bytes: pairs of a TOUCH and a SPECTRUM frame, and a TEXT frame."""
    numbers = itertools.count()
    for i in range(count):
        frames = []
        for _ in range(PAIRS):
            frames.append(touch(next(numbers), 1000 + i))
            body = struct.pack("<BB6H", 0, 5, *range(i % 100, i % 100 + 6))
            head = struct.pack("<BHI", 2, next(numbers) % 65536, 1000 + i)
            frames.append(encoded(head + body))
        text = json.dumps({"re": "get", "x": "y" * (i % 40)}).encode()
        frames.append(encoded(struct.pack("<BHI", 3, next(numbers) % 65536, 1000 + i) + text))
        yield b"".join(frames)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    folder = tmp_path_factory.mktemp("memory")
    for name, count in (("short", SHORT), ("long", SHORT * TIMES)):
        record(folder / f"{name}.spots", pieces(count))
    return folder


def growth_kib(folder, command, *options):
    """Return the additional memory in KiB of a command for a long instead of a short recording."""
    paths = folder / "short.spots", folder / "long.spots"
    done = subprocess.run(
        [sys.executable, "-c", RUN, *paths, command, *options],
        capture_output=True,
        text=True,
        check=True,
        env=os.environ | ENVIRONMENT,
    )
    short, long = (int(line.split()[1]) for line in done.stdout.splitlines() if "PEAK" in line)
    print(command, *options, short, long)
    return long - short


@pytest.mark.parametrize("kind", ["csv", "npz", "mcap"])
def test_an_export_takes_no_memory_for_its_length(recordings, kind):
    assert growth_kib(recordings, "export", "--to", kind) < GROWS_AT_MOST_KIB


def test_a_summary_takes_no_memory_for_its_length(recordings):
    assert growth_kib(recordings, "info") < SUMMARY_GROWS_AT_MOST_KIB
