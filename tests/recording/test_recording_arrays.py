"""Arrays of a recording equal its frames exactly, also in damaged files."""

import dataclasses
import math
import random
import re
import struct
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.fault_streams import damaged
from support.fault_streams import frames as made
from support.frames import encoded, stream, touch
from support.reels import clock, record
from support.refusals import refusal
from support.same_arrays import check, recording_of

import spots
from spots.errors import FileError
from spots.link.clockmap import ClockMap
from spots.link.decoder import ENCODED_MAX, checked, note
from spots.recording import arrays
from spots.recording.columns import SIZE_MAX, payloads
from spots_device.reading import frame

_SIZES = [arrays._BLOCK_BYTES, 1000, 90]


@pytest.fixture
def path(tmp_path):
    return tmp_path / "run.spots"


def text(content):
    return encoded(struct.pack("<BHI", 3, 7, 9) + content)


def key(sequence, t_us):
    return encoded(struct.pack("<BHIBHBB", 4, sequence, t_us & 0xFFFFFFFF, 7, 30, 0, 3))


@pytest.mark.board
@pytest.mark.parametrize("size", _SIZES)
def test_arrays_of_real_firmware(seen, size):
    assert check(seen.path, size) >= len(seen.frames)  # the recording also has replies
    assert check(seen.path, size) >= len(seen.frames)
    got = spots.read_arrays(seen.path)
    assert min(map(len, got.tables)) > 0


@pytest.mark.board
def test_columns_are_those_that_are_documented(seen):
    got = spots.read_arrays(seen.path)
    first = seen.frames[0]
    assert got.touches["position_um"].dtype == "<i4"
    assert (got.touches["time_s"][0], got.touches["t_us"][0]) == (first.time_s, first.t_us)
    described = " ".join(arrays.Arrays.__doc__.replace("``", "").replace(",", " ").split())
    for table in got.tables:
        assert f"{table.itemsize} bytes a row" in described
        for name in table.dtype.names:
            kind = table.dtype[name].base
            kind = "bool" if kind.kind == "b" else f"{kind.kind}{kind.itemsize}"
            assert re.search(rf"\b{name} (six )?{kind}\b", described), name


@pytest.mark.board
def test_every_kind_of_damage(path):
    rng = np.random.default_rng(0)
    pieces = made(60)
    data = b""
    for i, piece in enumerate(pieces):
        variants = [piece[:at] + bytes((at * 7 + i & 0xFF,)) + piece[at + 1 :] for at in range(28)]
        variants += [piece[:at] + piece[at + 1 :] for at in range(len(piece))]
        variants += [piece[:at] + bytes((i,)) + piece[at:] for at in range(len(piece))]
        variants += [piece[:at] + b"\0" for at in range(len(piece))]
        data += note(1000 * i) + b"".join(variants) + damaged(piece, 500, rng) + piece
    count = check(recording_of(path, data))
    assert count >= 60
    assert spots.read_arrays(path).stats.bad_crc > 30_000


@pytest.mark.board
def test_every_truncation(path):
    data = recording_of(path, b"".join(made(8)) + note(5)).read_bytes()
    for size in range(len(data)):
        path.write_bytes(data[:size])
        check(path)


@pytest.mark.parametrize("size", [*range(1, 30), 253, 254, 255, 256, 257, 500, 600, 700])
def test_pieces_of_every_size(path, size):
    rng = random.Random(size)
    some = [bytes(rng.choices(range(3), k=size)), bytes([7] * size), bytes(size)]
    kinds = [bytes((kind,)) + rest for kind in (1, 2, 3, 4, 5, 9, 15) for rest in some]
    data = b"".join(map(encoded, kinds)) + b"".join(stream(3))
    noise = b"\xff" * size + b"\0" + b"\x01" * size + b"\0"
    check(recording_of(path, data + noise + data))


@pytest.mark.parametrize("size", _SIZES)
@pytest.mark.parametrize("more", [-1, 0, 1, 2, 600, 5000])
def test_noise_without_an_end(path, size, more):
    noise = b"x" * (ENCODED_MAX + more)
    for end in (b"", b"\0", b"\0" + touch(9), touch(9) + touch(10)):
        assert check(recording_of(path, touch(1) + noise + end), size) >= 1


@pytest.mark.board
@pytest.mark.parametrize("size", [arrays._BLOCK_BYTES, 100])
def test_rotated_files_with_a_cut_one_among_them(path, size):
    pieces = [key(i, 1_000_000_000 * i) for i in range(200)]
    seen, _ = record(path, pieces, rotate_bytes=2500, step_s=1000.0)
    files = spots.Recording(path).paths
    assert check(path, size) == len(seen)
    assert len(files) >= 3
    assert [check(file, size) for file in files[1:]]
    whole = files[1].read_bytes()
    for cut in (1, 2, 30):
        files[1].write_bytes(whole[:-cut])
        assert check(path, size) >= len(seen) - 3
    files[1].unlink()
    assert check(path, size) == 0


@pytest.mark.parametrize("size", _SIZES)
def test_losses_where_the_board_restarts(path, size):
    restarts = [note(10 * i, {"restarts": i}) for i in range(5)]
    pieces = [touch(5), touch(9), key(12, 5), restarts[1], touch(0), touch(3), restarts[1]]
    pieces += [text(b"{}"), touch(60_000), restarts[3], touch(2), touch(1), restarts[2], touch(7)]
    check(recording_of(path, b"".join(pieces)), size)
    assert spots.read_arrays(path).stats.lost > 3
    check(recording_of(path, b"".join(pieces), restarts=2), size)


def known(**changes):
    return clock().state() | changes


@pytest.mark.parametrize("size", _SIZES)
def test_times_with_other_clocks_and_hours_of_quiet(path, size):
    pieces = []
    for i, after_s in enumerate((1, 2, 2000, 9000, 9001, 80_000, 80_001, 500_000)):
        changed = {"clock": known(slope=1e-5 * i, last_us=int(1e6 * after_s), low_s=900.5 + i)}
        pieces += [note(int(1e6 * after_s)), key(i, int(1e6 * after_s)), touch(i)]
        pieces += [note(int(1e6 * after_s) + 5, changed if i % 2 else None)] * 2
    assert check(recording_of(path, b"".join(pieces)), size) == 16


@pytest.mark.parametrize("bad", [{"low_s": "x"}, {"slope": 9}, None])
def test_a_clock_that_is_none_is_the_same_refusal(path, bad):
    content = {"clock": known(**bad) if bad else 7}
    assert check(recording_of(path, touch(1) + note(3, content) + touch(2))) == 0
    with refusal(FileError):
        spots.read_arrays(path)


def test_times_without_a_round_trip_are_unknown():
    t_us, arrived_s = np.array([5, 6]), np.array([1.0, 2.0])
    assert np.isnan(ClockMap().host_s_each(t_us, arrived_s)).all()


def test_times_are_those_of_one_after_the_other():
    rng = np.random.default_rng(1)
    for steps_us in (10_000, 1 << 31, 1 << 40):
        t_us = np.cumsum(rng.integers(0, steps_us, 300))
        arrived_s = 999 + 1e-6 * t_us
        one_by_one, at_once = clock(), clock()
        wrapped = t_us % (1 << 32)
        want = [one_by_one.host_s(*one) for one in zip(wrapped.tolist(), arrived_s.tolist())]
        assert at_once.host_s_each(wrapped, arrived_s).tolist() == want
        assert at_once.state() == one_by_one.state()


def test_a_piece_is_good_where_the_decoder_finds_it_so():
    rng = np.random.default_rng(2)
    for size in (12, 27, SIZE_MAX):
        body = rng.integers(0, 3, (300, size - 5), np.uint8)
        rows = [bytearray(encoded(bytes(one))[:-1]) for one in body]
        for i, row in enumerate(rows[::2]):
            row[i % size] = 1 + row[i % size] % 255
        pieces = [bytes(row) for row in rows]
        assert {len(piece) for piece in pieces} == {size}
        want = [checked(piece) for piece in pieces]
        columns, good = payloads(
            np.frombuffer(b"".join(pieces), np.uint8), size * np.arange(300), size
        )
        assert good.tolist() == [one is not None for one in want]
        assert 100 < good.sum() < 300
        assert [bytes(one) for one in columns.T] == [one for one in want if one is not None]


_small = st.integers(0, 70_000)
_contents = st.one_of(
    st.none(),
    st.builds(lambda n: {"restarts": n}, st.one_of(st.integers(-1, 4), st.booleans(), st.text())),
    st.builds(lambda us, s: {"clock": known(last_us=us, low_s=s)}, _small, st.floats(0, 1e4)),
    st.just({"end": True}),
)
_good = st.one_of(
    st.builds(touch, _small, st.integers(-5, 90_000), st.sampled_from((1, 0x21, 2, 5))),
    st.builds(key, st.integers(0, 65_535), st.integers(0, 1 << 33)),
    st.sampled_from(made(40)),
    st.builds(note, st.integers(0, (1 << 48) - 1), _contents),
    st.builds(text, st.sampled_from([b"", b"{", b"[]", b'{"a":1}', b'{"b":"' + b"c" * 400])),
    st.builds(
        lambda kind, body: encoded(bytes((kind,)) + body),
        st.integers(0, 255),
        st.binary(max_size=30),
    ),
)


@st.composite
def streams(draw):
    data = bytearray(b"".join(draw(st.lists(_good, max_size=40))))
    for _ in range(draw(st.integers(0, 6))):
        at = draw(st.integers(0, len(data)))
        cut = draw(st.sampled_from((0, 0, 1, 2, 30)))
        put = draw(st.one_of(st.binary(max_size=4), st.sampled_from((b"y" * 620, b"\0\0", b""))))
        data[at : at + cut] = put
    return bytes(data)


@pytest.mark.board
@settings(max_examples=60, deadline=None)
@given(st.lists(streams(), min_size=1, max_size=3), st.integers(50, 5000))
def test_any_stream_in_any_number_of_files(tmp_path_factory, parts, size):
    path = tmp_path_factory.mktemp("any") / "run.spots"
    for part, data in enumerate(parts):
        name = path if part == 0 else path.with_name(f"run-{part:03d}.spots")
        recording_of(name, data, part, restarts=part)
    check(path, size)


@pytest.mark.board
def test_blocks_take_no_more_memory_for_a_longer_recording(path):
    def peak_bytes(copies):
        recording_of(path, b"".join(stream(20_000)) * copies)
        tracemalloc.start()
        try:
            found = sum(len(block.touches) for block in spots.RecordingBlocks(path))
            assert found == 20_000 * copies
            return tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()

    assert peak_bytes(16) < 1.2 * peak_bytes(2)


def test_a_byte_at_a_time(path):
    data = touch(1) + note(3) + key(2, 5) + b"\0x\0" + text(b'{"re":1}') + touch(4)
    assert check(recording_of(path, data), block_bytes=1) == 4


@pytest.mark.board
def test_a_recording_is_read_twice_the_same(seen):
    blocks = spots.RecordingBlocks(seen.path)
    first, again = list(blocks), list(blocks)
    assert dataclasses.asdict(first[-1].stats) == dataclasses.asdict(again[-1].stats)
    assert sum(len(block.touches) for block in first) == sum(len(b.touches) for b in again)


def test_a_recording_of_protocol_2_is_read_as_before(path):
    # In what no other test does: spectra of protocol 2, and both kinds in one block.
    run = Path(__file__).parents[1] / "data" / "run.spots"
    assert spots.Recording(run).header.info["protocol"] == 2
    assert check(run) == 601
    with spots.open_recording(run, math.inf) as board:
        assert len(list(board.touches())) == 300
    old = encoded(struct.pack("<BHIBB6H", 2, 5, 9, 8, 9, *range(6)))
    assert check(recording_of(path, b"".join([*made(9), old] * 3)), 300) == 30
    assert (~spots.read_arrays(path).spectra["taken_off_q6"].any(axis=1)).sum() == 3


def test_a_kind_has_its_table():
    assert set(arrays._TABLES) == {frame.TOUCH, frame.SPECTRUM, frame.KEY, frame.CONTACT}
