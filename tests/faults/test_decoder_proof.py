"""The decoder returns no wrong frame after any damage of one byte, or after damages of some bytes.

A piece of the stream is the bytes between two delimiters. Damage inside a frame changes only its
piece. So a test stream consists of many damaged variants of one frame, and an undamaged frame at
its end, which must arrive.

As a program with seeds as arguments, this file tries a million damages for each seed.
"""

import sys

import numpy as np
import pytest
from support.fault_streams import damaged, frames

from spots.link.decoder import Decoder

COUNT = 50
MULTIPLE = 200_000


def made():
    """Return a list of encoded frames, and a list of the same frames decoded."""
    pieces = frames(COUNT)
    return pieces, [Decoder().feed(piece)[0] for piece in pieces]


@pytest.fixture(scope="module")
def stream():
    return made()


def intruders(damaged, meaning, last, last_meaning):
    """Return the wrong frames that a decoder finds in damaged variants of a frame.

    Parameters
    ----------
    damaged : bytes
        The damaged variants.
    meaning : Frame
        The undamaged frame, decoded; it does not count as wrong.
    last : bytes
        An undamaged frame after the variants, which must arrive.
    last_meaning : Frame
        This frame, decoded.
    """
    found = Decoder().feed(damaged + last)
    assert found[-1:] == [last_meaning]
    return [one for one in found[:-1] if one != meaning]


@pytest.mark.board
def test_every_change_of_every_byte(stream):
    pieces, meanings = stream
    tried = 0
    for i, (piece, meaning) in enumerate(zip(pieces, meanings)):
        last, last_meaning = pieces[i - 1], meanings[i - 1]
        for at in range(len(piece) - 1):
            head, tail = piece[:at], piece[at + 1 :]
            variants = [head + bytes((v,)) + tail for v in range(256) if v != piece[at]]
            assert not intruders(b"".join(variants), meaning, last, last_meaning)
            tried += len(variants)
    print(f"{tried} changed bytes tried")
    assert tried == 255 * (sum(map(len, pieces)) - COUNT)


@pytest.mark.board
def test_every_insertion_and_every_deletion(stream):
    pieces, meanings = stream
    tried = 0
    for i, (piece, meaning) in enumerate(zip(pieces, meanings)):
        last, last_meaning = pieces[i - 1], meanings[i - 1]
        for at in range(len(piece)):
            variants = [piece[:at] + bytes((v,)) + piece[at:] for v in range(256)]
            if at < len(piece) - 1:
                variants.append(piece[:at] + piece[at + 1 :])
            assert not intruders(b"".join(variants), meaning, last, last_meaning)
            tried += len(variants)
    print(f"{tried} insertions and deletions tried")


def test_every_lost_or_changed_delimiter_costs_the_two_frames_beside_it(stream):
    pieces, meanings = stream
    tried = 0
    for i in range(COUNT - 2):
        for changed in [b"", *(bytes((v,)) for v in range(1, 256))]:
            joined = pieces[i][:-1] + changed + pieces[i + 1]
            assert Decoder().feed(joined + pieces[i + 2]) == [meanings[i + 2]]
            tried += 1
    print(f"{tried} lost and changed delimiters tried")


def test_every_truncation(stream):
    pieces, meanings = stream
    data = b"".join(pieces)
    ends = np.cumsum([len(piece) for piece in pieces])
    decoder, whole = Decoder(), []
    for size in range(1, len(data) + 1):  # after each byte, the decoder has a truncated stream
        whole += decoder.feed(data[size - 1 : size])
        assert len(whole) == np.searchsorted(ends, size, side="right")
    assert whole == meanings
    print(f"{len(data)} truncations tried")
    for i in range(COUNT - 1):  # the decoder continues after a truncated frame
        variants = [pieces[i][:size] + b"\0" for size in range(len(pieces[i]) - 1)]
        assert not intruders(b"".join(variants), meanings[i], *_pair(stream, i + 1))
        for size in range(1, len(pieces[i])):
            cut = pieces[i][:size] + pieces[i + 1]
            assert set(map(repr, Decoder().feed(cut))) <= {repr(meanings[i + 1])}


def _pair(stream, i):
    return stream[0][i], stream[1][i]


def many_damages(stream, seed, multiple=MULTIPLE):
    """Try `multiple` damages of several bytes; return the received frames that were never sent."""
    rng = np.random.default_rng(seed)
    pieces, meanings = stream
    each = multiple // COUNT
    wrong, refused = [], 0
    for i, (piece, meaning) in enumerate(zip(pieces, meanings)):
        data = damaged(piece, each, rng)
        wrong += intruders(data, meaning, *_pair(stream, i - 1))
        refused += data.count(0)
    print(f"{each * COUNT} damages of 2 to 8 bytes tried, {len(wrong)} wrong frames delivered")
    assert refused >= multiple
    return wrong


@pytest.mark.board
def test_many_damages_of_several_bytes(stream):
    assert many_damages(stream, 0) == []


def test_the_proof_fails_for_a_decoder_that_ignores_the_crc(stream, monkeypatch):
    from spots.link import decoder as module

    monkeypatch.setattr(module, "checked", lambda piece: _unchecked(piece))
    rng = np.random.default_rng(0)
    piece, meaning = _pair(stream, 0)
    assert intruders(damaged(piece, 2000, rng), meaning, *_pair(stream, 1))


def _unchecked(piece):
    from cobs import cobs

    try:
        return cobs.decode(piece)[:-4].ljust(7, b"\0")
    except cobs.DecodeError:
        return None


if __name__ == "__main__":
    wrong = [one for seed in sys.argv[1:] for one in many_damages(made(), int(seed), 1_000_000)]
    sys.exit(bool(wrong))
