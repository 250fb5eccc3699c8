"""The two paths of the samples have one interface, and the sensor works with either of them."""

import pytest
from bench import canned

from spots_device.sensor.fifo import Fifo
from spots_device.sensor.registers import Registers


class Sensor:
    burst = bytearray(300)


def test_both_paths_have_the_same_interface():
    fifo, registers = (
        {name for name in dir(path) if not name.startswith("_")}
        for path in (Fifo(Sensor(), None), Registers(Sensor()))
    )
    assert fifo == registers - {"fetch", "stamp"}


@pytest.mark.parametrize("path", ["fifo", "registers"])
def test_the_sensor_samples_with_either_path(path, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    board, bus, clock, serial = canned.app()
    app = board.strips[0]
    sensor = app.strip.sensor
    if path == "registers":
        sensor._first = Registers(sensor)
    app.restart()
    bus.counts((1, 2, 3, 4, 5, 6))
    frames, end = serial.frames, clock.now + 300_000
    while clock.now < end:
        board.step()
    assert serial.frames - frames > 20
    assert list(sensor.counts) == [1, 2, 3, 4, 5, 6]
    assert sensor._path.fifo == (path == "fifo")
