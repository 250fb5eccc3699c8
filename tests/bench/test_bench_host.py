"""Results of the host benchmark: the same readings as frames and as JSON."""

from __future__ import annotations

import pytest
from support.touch_framer import TouchFramer

from bench import arrays, host
from bench.report import _host, _text
from spots.link.decoder import Decoder
from spots.recording import arrays as of_recordings


class Sink(bytearray):
    def write(self, buffer, size):
        self += buffer[:size]
        return True


# flags, contrast, brightness, position_um, force_mN
READING = 1, 3 << 20, -(5 << 20), 42_500, 3_000


class Time:
    head = [0, 0, 1, 2, 0, 0]


@pytest.fixture
def stream():
    sink = Sink()
    framer = TouchFramer(sink, Time)
    for _ in range(32):
        framer.touch(0, READING)
    return bytes(sink)


def test_readings_are_counted_and_weighed(results):
    figures = results["host"]
    assert figures["spots"]["bytes_per_reading"] == 28
    assert figures["json"]["bytes_per_reading"] > 4 * 28
    for name in ("spots", "json"):
        assert figures[name]["readings_per_s"] > 0
    assert figures["rate_ratio"] == pytest.approx(
        figures["spots"]["readings_per_s"] / figures["json"]["readings_per_s"], rel=0.01
    )


def test_lines_hold_the_fields_of_the_frames(stream):
    figures = host.measure(stream)
    touches = Decoder().feed(stream)
    assert len(touches) == 32
    line = host.line(touches[5])
    assert line.startswith(b'{"sensor":0,"sequence":5,"t_us":131073,"flags":1,')
    assert b'"position_um":42500,"force_mN":3000}\n' in line
    assert figures["json"]["bytes_per_reading"] == pytest.approx(len(line), abs=1)


def test_a_decoder_that_drops_readings_gets_no_rate(stream, monkeypatch):
    class Lossy(Decoder):
        def feed(self, data):
            return super().feed(data)[1:]

    monkeypatch.setattr(host, "_decode", lambda pieces: sum(len(Lossy().feed(p)) for p in pieces))
    with pytest.raises(AssertionError, match="readings decoded of"):
        host.measure(stream)


def test_arrays_have_many_times_the_rate_of_json(results):
    figures = results["host"]["arrays"]
    assert figures["rate_ratio"] >= 6  # about 9; both rates vary by a fifth
    ratio = figures["readings_per_s"] / figures["json_readings_per_s"]
    assert figures["rate_ratio"] == pytest.approx(ratio, rel=0.01)
    shown = " ".join(_text(_host(results["host"])).split())
    assert f"{figures['readings_per_s']:,}" in shown
    assert f"arrays of a recording {figures['rate_ratio']:.0f} times" in shown


def test_arrays_without_some_readings_get_no_rate(stream, monkeypatch):
    monkeypatch.setattr(arrays, "_READINGS", 1000)
    assert arrays.measure(stream)["readings_per_s"] > 0
    add = of_recordings._Table.array
    monkeypatch.setattr(of_recordings._Table, "array", lambda *rows: add(*rows)[1:])
    with pytest.raises(AssertionError, match="readings decoded of"):
        arrays.measure(stream)
