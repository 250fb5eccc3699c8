"""The decoder returns all valid frames and no wrong frame, after any damage of the stream."""

import json
import random
import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.frames import encoded, stream, touch

from spots.link.decoder import Decoder
from spots.link.frames import Key, Note, Spectrum, Text, Touch
from spots_device.reading.frame import TEXT_MAX


def test_a_touch_frame_becomes_a_touch():
    (frame,) = Decoder().feed(touch(3, kind=0x21))
    assert frame == Touch(2, 3, 3000, 9, -5, 7, 42_000, 1500)
    assert frame.touching
    assert frame.trusted
    assert frame.contrast == -5 / 2**20
    assert frame.brightness == 7 / 2**20


@pytest.mark.parametrize("bit", [1, 2, 4, 6, 7])
def test_a_doubtful_reading_is_not_trusted(bit):
    assert not Touch(0, 0, 0, 1 | 1 << bit, 0, 0, 0, 0).trusted


def test_time_is_32_bits_wide():
    (frame,) = Decoder().feed(encoded(struct.pack("<BHIBiiiH", 1, 0, 0xFEDCBA98, 0, 0, 0, 0, 0)))
    assert frame.t_us == 0xFEDCBA98


def test_a_spectrum_a_key_and_a_text():
    decoder = Decoder()
    counts = (0, 65_535, 2, 3, 4, 5)
    words = *counts, *counts[::-1], -5, 1
    (spectrum,) = decoder.feed(encoded(struct.pack("<BHIBB6H6IiB", 2, 0, 9, 8, 10, *words)))
    assert spectrum == Spectrum(0, 0, 9, 8, 10, counts, None, counts[::-1], -5, 1)
    (key,) = decoder.feed(encoded(struct.pack("<BHIBHBB", 0x14, 1, 9, 7, 30, 2, 1)))
    assert key == Key(1, 1, 9, 7, 30, 2, True)
    (text,) = decoder.feed(encoded(struct.pack("<BHI", 3, 2, 0) + b'{"re": "get"}'))
    assert text == Text(0, 2, 0, {"re": "get"})


def test_an_unknown_kind_is_skipped_and_is_no_error():
    decoder = Decoder()
    assert decoder.feed(touch(0, kind=0x0E) + touch(1)) == Decoder().feed(touch(1))
    assert (decoder.stats.frames, decoder.stats.lost, decoder.stats.bad_crc) == (2, 0, 0)


@pytest.mark.parametrize(
    "payload",
    [
        b"\x01\x00\x00",
        struct.pack("<BHI", 1, 0, 0) + b"short",
        struct.pack("<BHI", 3, 0, 0) + b"no json",
        struct.pack("<BHI", 3, 0, 0) + b"[1]",
        struct.pack("<BHI", 3, 0, 0) + b"\xff",
    ],
)
def test_a_good_crc_over_nonsense_is_bad_all_the_same(payload):
    decoder = Decoder()
    assert decoder.feed(encoded(payload)) == []
    assert decoder.stats.bad_crc == 1


@given(st.lists(st.integers(1, 40), max_size=60))
def test_pieces_of_any_size_give_the_same_frames(sizes):
    data = b"".join(stream(20))
    decoder, frames, at = Decoder(), [], 0
    for size in [*sizes, len(data)]:
        frames += decoder.feed(data[at : at + size])
        at += size
    assert frames == Decoder().feed(data)
    assert len(frames) == 20


def delivered(pieces):
    decoder = Decoder()
    frames = decoder.feed(b"".join(pieces))
    return frames, decoder.stats


def test_every_flipped_bit_and_every_lost_or_doubled_byte_costs_at_most_its_frames():
    pieces = stream(5)
    good, _ = delivered(pieces)
    data = b"".join(pieces)
    tried = 0
    for at in range(len(data)):
        damaged = [data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1 :] for bit in range(8)]
        damaged += [data[:at] + data[at + 1 :], data[:at] + data[at : at + 1] + data[at:]]
        for stream_bytes in damaged:
            frames = Decoder().feed(stream_bytes)
            assert set(frames) <= set(good)
            assert len(frames) >= 3  # a lost delimiter joins two frames, which are then invalid
            tried += 1
    assert tried == 10 * len(data)


def test_every_truncation_gives_the_whole_frames():
    data = b"".join(stream(4))
    for size in range(len(data)):
        assert len(Decoder().feed(data[:size])) == data[:size].count(0)


@pytest.mark.board
def test_random_damage_never_delivers_a_wrong_frame():
    rng = random.Random(0)
    pieces = stream(50)
    good = set(Decoder().feed(b"".join(pieces)))
    for _ in range(2000):
        data = bytearray(b"".join(pieces))
        for _ in range(rng.randrange(1, 40)):
            data[rng.randrange(len(data))] = rng.randrange(256)
        assert set(Decoder().feed(bytes(data))) <= good


def test_missing_frames_are_counted_across_the_wrap():
    decoder = Decoder()
    for sequence in (65_533, 65_534, 65_536, 65_540):
        decoder.feed(touch(sequence))
    assert decoder.stats.lost == 1 + 3


def test_a_frame_that_comes_twice_is_no_loss():
    decoder = Decoder()
    decoder.feed(touch(5) + touch(5) + touch(6))
    assert decoder.stats.lost == 0


def test_noise_without_a_delimiter_takes_no_memory_and_ends_at_the_next_one():
    decoder = Decoder()
    for _ in range(1000):
        assert decoder.feed(b"\x55" * 1000) == []
    assert len(decoder._partial) <= 1000
    frames = decoder.feed(b"\x55\0" + touch(1))
    assert [frame.sequence for frame in frames] == [1]
    assert decoder.stats.bad_crc == 1


def test_empty_pieces_between_delimiters_are_nothing():
    decoder = Decoder()
    assert decoder.feed(b"\0\0\0") == []
    assert decoder.stats.bad_crc == 0


def test_the_longest_text_passes():
    content = {"re": "x" * 480}
    (text,) = Decoder().feed(encoded(struct.pack("<BHI", 3, 0, 0) + json.dumps(content).encode()))
    assert text.content == content


@pytest.mark.parametrize("size", [1, 300, 4096])
def test_what_is_longer_than_any_frame_is_none_in_whatever_pieces_it_comes(size):
    long = struct.pack("<BHI", 3, 0, 0) + json.dumps({"re": "x" * TEXT_MAX}).encode()
    data = encoded(long) + touch(1)
    decoder, frames = Decoder(), []
    for i in range(0, len(data), size):
        frames += decoder.feed(data[i : i + size])
    assert [frame.sequence for frame in frames] == [1]
    assert decoder.stats.bad_crc == 1


def test_a_note_is_no_frame_of_the_link():
    decoder = Decoder()
    note = encoded(struct.pack("<BHI", 15, 2, 3) + b'{"a": 1}')
    frames = decoder.feed(touch(0) + note + encoded(struct.pack("<BHI", 15, 0, 9)) + touch(1))
    assert frames[1:3] == [Note((2 << 32) + 3, {"a": 1}), Note(9, {})]
    assert (decoder.stats.frames, decoder.stats.lost, decoder.stats.bad_crc) == (2, 0, 0)


@pytest.mark.parametrize("size", [1, 100, 512, 5000])
def test_noise_that_is_longer_than_any_frame_is_the_beginning_of_none(size):
    decoder, noise = Decoder(), b"x" * 5000
    for i in range(0, len(noise), size):
        decoder.feed(noise[i : i + size])
    assert decoder.pending == b""
    assert decoder.stats.bad_crc == 1
    assert decoder.feed(b"\0" + touch(1))
    assert decoder.stats.bad_crc == 1
