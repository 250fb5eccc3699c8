"""docs/extend/protocol.md and decoder.md: the bytes are frames, and both programs decode them."""

import re

import pytest
from cobs import cobs
from support.documents import ROOT, blocks

from spots import Contact, Decoder, Key, Spectrum, Text, Touch

PAGE = (ROOT / "docs/extend/protocol.md").read_text(encoding="utf-8")
PROGRAMS = dict(blocks("docs/extend/decoder.md"))
FRAMES = [bytes.fromhex(one) for one in re.findall(r"^frame +([0-9a-f ]+)$", PAGE, re.MULTILINE)]
PAYLOADS = re.findall(r"^payload +([0-9a-f |]+)$", PAGE, re.MULTILINE)


def test_each_kind_of_frame_has_an_example_that_decodes():
    found = list(Decoder().feed(b"".join(FRAMES)))
    assert [type(one) for one in found] == [Touch, Spectrum, Text, Key, Contact]
    touch, spectrum, text, key, contact = found
    assert (touch.sequence, touch.t_us, touch.flags) == (258, 2_000_000, 9)
    assert (touch.position_um, touch.force_mN, touch.trusted) == (42_000, 1500, True)
    assert spectrum.counts == (1200, 2300, 1800, 900, 640, 410)
    assert [one / 64 for one in spectrum.taken_off_q6] == [1.25, 1.5, 1.75, 1, 1, 0.75]
    assert (spectrum.temperature_mC, spectrum.context) == (24_500, 0)
    assert text.content == {"re": "sync"}
    assert (key.page, key.usage, key.pressed) == (7, 30, True)
    assert (contact.id, contact.state, contact.sigma_um) == (3, 2, 18)


@pytest.mark.parametrize("at", range(5))
def test_the_payload_beside_a_frame_is_its_payload(at):
    shown = bytes.fromhex(PAYLOADS[at].replace("|", ""))
    assert cobs.decode(FRAMES[at][:-1])[:-4] == shown


def test_the_decoder_in_python_reads_the_example_and_survives_damage(capsys):
    names = {}
    exec(PROGRAMS["python"], names)
    assert capsys.readouterr().out == "42000 um 1500 mN\n"
    frame = FRAMES[0]
    for at in range(len(frame) - 1):
        damaged = frame[:at] + bytes([frame[at] ^ 0x10]) + frame[at + 1 :]
        assert list(names["touches"](damaged)) == []
        assert list(names["touches"](frame[:at] + b"\0\0" + frame)) == [
            next(names["touches"](frame))
        ]


def test_the_page_shows_the_decoder_in_javascript_that_the_live_page_uses():
    # tests/live/test_decoder.py compares this file with the decoder in Python.
    assert PROGRAMS["js"] == (ROOT / "host/spots_live/static/decoder.js").read_text("utf-8")
