"""Frames of the firmware: compared with other encoders, and the bytes in extend/protocol.md."""

import struct
import zlib

import pytest
from cobs import cobs
from hypothesis import given
from hypothesis import strategies as st
from support.smallint import SmallInt
from support.touch_framer import TouchFramer

from spots_device.reading import frame, kernel
from spots_device.reading.decode import DROPPED, GAP


class Clock:
    def __init__(self, now=0):
        self.now = now

    def ticks_us(self):
        return self.now

    @staticmethod
    def ticks_diff(end, start):
        return ((end - start + (1 << 29)) % (1 << 30)) - (1 << 29)


class Port:
    def __init__(self):
        self.sent = []
        self.takes = True

    def write(self, buffer, size):
        if self.takes:
            self.sent.append(bytes(buffer[:size]))
        return self.takes


@given(st.binary(max_size=600))
def test_crc_is_that_of_the_standard_library(data):
    payload = bytearray(data + bytes(4))
    kernel.add_crc(payload, len(data))
    assert payload == data + struct.pack("<I", zlib.crc32(data))


@given(st.binary(min_size=1, max_size=520))
def test_cobs_is_undone_by_the_reference_decoder(data):
    target = bytearray(len(data) + 8)
    size = kernel.cobs_encode(data, len(data), target)
    encoded = bytes(target[:size])
    assert encoded[-1] == 0
    assert 0 not in encoded[:-1]
    assert cobs.decode(encoded[:-1]) == data


@pytest.mark.parametrize("size", [25, 26, 27, 252, 253, 254, 255, 256, 507, 508, 509, 510])
def test_cobs_at_the_edges_of_its_blocks(size):
    for data in (b"\x01" * size, b"\x01" * (size - 1) + b"\0", b"\0" + b"\x01" * (size - 1)):
        target = bytearray(size + 8)
        encoded = bytes(target[: kernel.cobs_encode(data, size, target)])
        assert cobs.decode(encoded[:-1]) == data


def framer(now=0):
    port, clock = Port(), Clock(now)
    return TouchFramer(port, frame.Time32(clock)), port


def reading(flags=0, contrast=0, brightness=0, position_um=0, force_mN=0):
    return [flags, contrast, brightness, position_um, force_mN]


def test_a_touch_frame_is_these_28_bytes():
    made, port = framer()
    made.touch(2, reading(flags=9, contrast=-2, brightness=3, position_um=42_500, force_mN=3000))
    payload = struct.pack("<BHIBiiiH", 0x21, 0, 0, 9, -2, 3, 42_500, 3000)
    payload += struct.pack("<I", zlib.crc32(payload))
    assert len(payload) == 26
    assert port.sent == [cobs.encode(payload) + b"\0"]
    assert len(port.sent[0]) == 28


def test_a_spectrum_frame_fits_two_blocks():
    made, port = framer()
    counts, rest = (1, 65_535, 3, 4, 5, 6), (0, 64 * 65_535, 1, 2, 3, 4, -1_048_576, 3)
    made.spectrum(0, 8, 9, counts, rest)
    payload = cobs.decode(port.sent[0][:-1])
    assert struct.unpack("<BHIBB6H6IiB", payload[:-4]) == (2, 0, 0, 8, 9, *counts, *rest)
    assert len(port.sent[0]) == 56  # of 64, with a delimiter before it


def test_a_contact_frame_is_these_23_bytes():
    made, port = framer(0x12345)
    made.contact(1, 7, 2, -42_500, 310, 3000)
    payload = bytes.fromhex("15 0000 00000000 07 02 fc59ffff 3601 b80b")
    payload += struct.pack("<I", zlib.crc32(payload))
    assert port.sent == [cobs.encode(payload) + b"\0"]
    assert len(port.sent[0]) == 23


def test_a_dropped_frame_is_counted_numbered_and_flagged():
    made, port = framer()
    made.touch(0, reading(flags=0))
    port.takes = False
    assert not made.touch(0, reading(flags=0))
    port.takes = True
    made.touch(0, reading(flags=0))
    made.touch(0, reading(flags=0))
    # A delimiter ends the part of the dropped frame that may have arrived.
    assert [sent[0] == 0 for sent in port.sent] == [False, True, False]
    payloads = [cobs.decode(sent.strip(b"\0")) for sent in port.sent]
    assert [struct.unpack_from("<H", p, 1)[0] for p in payloads] == [0, 2, 3]
    assert [p[7] for p in payloads] == [0, 1 << 5, 0]
    assert made.dropped == 1


@pytest.mark.board
def test_the_sequence_wraps():
    made, port = framer()
    for _ in range(65_537):
        made.spectrum(0, 0, 0, [0] * 6, [0] * 8)
    assert [struct.unpack_from("<H", cobs.decode(s[:-1]), 1)[0] for s in port.sent[-2:]] == [
        65_535,
        0,
    ]


@pytest.mark.parametrize("size", range(40, 140))
def test_no_frame_is_a_multiple_of_a_usb_packet(size):
    made, port = framer()
    made.text(b"x" * size)
    assert len(port.sent[0]) % 64 != 0
    pieces = [piece for piece in port.sent[0].split(b"\0") if piece]
    assert cobs.decode(pieces[0])[7:-4] == b"x" * size


@given(st.lists(st.integers(-1000, 1 << 28), min_size=1, max_size=30))
def test_board_time_is_the_sum_of_its_steps_modulo_32_bits(steps):
    clock = Clock(12_345)
    time = frame.Time32(clock)
    total = 0
    for step in steps:
        clock.now = (clock.now + step) % (1 << 30)
        total += step
        time.set(SmallInt(clock.now))
        assert time.us() == total % (1 << 32)


def test_a_gap_is_told_by_the_next_frame_that_has_flags():
    made, port = framer()
    made._head[GAP] = DROPPED
    made.key(0, 7, 30, 0, True)
    made.text(b"{}")
    made.touch(0, reading(flags=0))
    made.touch(0, reading(flags=0))
    payloads = [cobs.decode(sent.strip(b"\0")) for sent in port.sent]
    assert [payload[0] for payload in payloads] == [4, 3, 1, 1]
    assert struct.unpack_from("<BHBB", payloads[0], 7) == (7, 30, 0, 1)
    assert [payload[7] for payload in payloads[2:]] == [1 << 5, 0]
