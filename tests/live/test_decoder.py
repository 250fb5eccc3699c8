"""The decoder of the page `live` against the Python one, frame by frame."""

from __future__ import annotations

import json
import math
import os
import random
import struct
import subprocess
from pathlib import Path

import pytest
from fuzz.kept import kept
from support.documents import ROOT
from support.fault_streams import encoded, frames

from spots.link.decoder import Decoder
from spots.link.frames import Contact, Key, Note, Spectrum, Text, Touch

pytestmark = pytest.mark.board
# More than a run of all tests can pay for: SPOTS_DAMAGED_STREAMS=1000.
STREAMS, FRAMES = int(os.environ.get("SPOTS_DAMAGED_STREAMS", "100")), 200  # half are damaged
SESSION = """
import fs from "node:fs";
import { Session } from "./host/spots_live/static/session.js";
const page = { put() {}, event() {} }, words = { words: { flags: [], causes: [] }, names: {} };
const session = new Session({ page, words, layouts: {} });
for (const byte of fs.readFileSync(0)) session.take([byte], 0);
console.log(JSON.stringify(session.decoder.stats));
"""
KINDS = {Touch: "touch", Spectrum: "spectrum", Key: "key", Contact: "contact", Text: "text"}


def damaged(frame: bytes, rng: random.Random) -> bytes:
    """Change, lose, repeat, insert or cut bytes of a frame, or join it with the next one."""
    data = bytearray(frame)
    for _ in range(rng.randrange(1, 4)):
        at = rng.randrange(len(data))
        way = rng.randrange(6)
        if way == 0:
            data[at] ^= 1 << rng.randrange(8)
        elif way == 1:
            data[at] = rng.choice((0, 0, 1, 255))
        elif way == 2:
            del data[at : at + rng.randrange(1, 9)]
        elif way == 3:
            data[at:at] = rng.randbytes(rng.randrange(1, 9))
        elif way == 4:
            data[at:at] = data[: rng.randrange(1, 30)]
        elif rng.random() < 0.05:
            data[at:at] = b"\1" * 2000
        data = data or bytearray(1)
    return bytes(data)


def plain(frame) -> dict:
    """Return a frame as the JavaScript decoder shows it."""
    values = {name: value for name, value in frame._asdict().items() if name != "time_s"}
    for name, value in values.items():
        if isinstance(value, float) and math.isnan(value):
            values[name] = None  # Python: unknown; JavaScript: as on the wire, or none
    return {"kind": KINDS[type(frame)], **json.loads(json.dumps(values))}


def alike(ours: dict, theirs: dict) -> bool:
    """Return whether two frames are equal, except for values that Python takes as unknown."""
    known = {name: value for name, value in ours.items() if value is not None}
    return known.items() <= theirs.items() if "content" not in ours else ours == theirs


def streams() -> list[list[bytes]]:
    """Return streams of damaged frames in pieces of random sizes, and the corpus of the fuzzer."""
    rng = random.Random("damage")
    found = []
    for seed in range(STREAMS):
        made = [damaged(f, rng) if rng.random() < 0.5 else f for f in frames(FRAMES, seed)]
        found.append(cut(b"".join(made), rng))
        if seed % 9 == 0:  # the computer slept: the number has turned meanwhile
            found[-1] += frames(FRAMES, seed, first=FRAMES + rng.randrange(400_000))
    return found + [cut(data, rng) for data in kept("decoder").values()]


def cut(data: bytes, rng: random.Random) -> list[bytes]:
    """Cut a stream into pieces."""
    edges = sorted({0, len(data), *(rng.randrange(len(data) + 1) for _ in range(len(data) // 99))})
    return [data[a:b] for a, b in zip(edges, edges[1:])]


def test_damaged_streams_give_the_frames_of_the_python_decoder(node):
    # Fails if a frame, its fields, or a number of the statistics differs.
    every = streams()
    text = "\n".join(json.dumps([piece.hex() for piece in pieces]) for pieces in every)
    script = Path(__file__).with_name("decode.mjs")
    run = subprocess.run([node, script], input=text, capture_output=True, text=True, check=True)
    there = list(map(json.loads, run.stdout.splitlines()))
    assert len(there) == len(every)
    bad = lost = 0
    for pieces, (shown, stats) in zip(every, there):
        decoder = Decoder()
        wanted = [f for piece in pieces for f in decoder.feed(piece) if not isinstance(f, Note)]
        assert len(shown) == len(wanted)
        assert [(a, b) for a, b in zip(map(plain, wanted), shown) if not alike(a, b)] == []
        ours = decoder.stats
        assert stats == {"frames": ours.frames, "lost": ours.lost, "bad": ours.bad_crc}
        bad += ours.bad_crc
        lost = max(lost, ours.lost)
    assert bad > STREAMS * FRAMES / 4
    assert lost > 1 << 16


def test_a_restart_of_the_board_is_no_loss(node):
    # Fails if the session of the page does not see the restart: the board's numbers go on from 0.
    reply = encoded(struct.pack("<BHI", 3, 0, 5000) + b'{"re":"hello"}')
    stream = [*frames(99, first=40_000), reply, *frames(99, first=1)]
    run = subprocess.run(
        [node, "--input-type=module", "-e", SESSION],
        input=b"".join(stream),
        capture_output=True,
        cwd=ROOT,
    )
    assert json.loads(run.stdout)["lost"] == 0, run.stderr
