"""Presses of a calibration session: only a steady press is used, others get a reason why not."""

import dataclasses
import io
from pathlib import Path

import msgspec
import pytest
from rich.console import Console
from support.refusals import refusal
from support.sensors import replaced

from spots.calibrate.fit.points import Wanted
from spots.calibrate.session.bench import Bench
from spots.calibrate.session.guide import Guide
from spots.calibrate.session.judge import BadPressError, Judge
from spots.calibrate.session.spectra import SpectrumReader
from spots.errors import CalibrationError
from spots_sim.person.person import follow
from spots_sim.person.stage import Stage
from spots_sim.person.stage_presser import StagePresser
from spots_sim.strip.scenario import Press

DARK_FIRST = [0, 1, 1, 1, 1, 1]
PRESS = Press(40.0, 3000.0, 4.0)


@pytest.fixture
def stage(sensor):
    with Stage(sensor, seed=4) as made:
        yield made


@pytest.fixture
def bench(stage):
    """A `Bench` on a simulated board; ``bench.said()`` returns its output."""
    said = io.StringIO()
    guide = Guide(Console(file=said, width=200))
    made = Bench(stage.reader, StagePresser(stage), guide, stage.length_um, Path("a.toml"))
    made.said = said.getvalue
    return made


@pytest.mark.board
def test_a_board_that_averages_is_read_sample_by_sample_and_averages_again(stage):
    stage.held.press = PRESS
    stage.board.command("stream spectrum")
    expected = stage.reader.read(200).variance.sum()
    stage.held.press = None
    stage.board.command("set average=8")
    reader = SpectrumReader(stage.board)
    stage.held.press = PRESS
    assert reader.read(200).variance.sum() == pytest.approx(expected, rel=0.3)
    reader.restore()
    assert stage.board.command("get")["average"] == 8


def test_channels_that_are_lit_have_their_noise_beside_a_dark_one(stage):
    samples = stage.reader.samples
    stage.held.press = PRESS

    def dim(count):
        rows, clipped = samples(count)
        return rows * DARK_FIRST, clipped

    stage.reader.samples = dim
    variance = stage.reader.read(100).variance
    assert variance[0] == 0
    assert (variance[1:] > 0.05).all()


def test_a_choice_of_channels_takes_dark_ones_as_they_are(stage, bench):
    read = stage.reader.read

    def dim(count):
        reading = read(count)
        return dataclasses.replace(reading, counts=reading.counts * DARK_FIRST)

    stage.reader.read = dim
    wanted = Wanted(kind="choose", place_um=60_000.0, force_mN=6000.0)
    assert bench.take(wanted).reading.dark
    assert "try again" not in bench.said()
    with refusal(CalibrationError):
        bench.take(msgspec.structs.replace(wanted, kind="position"))


def test_a_joint_whose_press_is_refused_need_not_be_released(bench, monkeypatch):
    bench.release = lambda: pytest.fail("the joint was asked to release the strip")
    tries = []

    def saturated_twice(judge, reading):
        tries.append(reading)
        if len(tries) < 3:
            raise BadPressError("a channel is saturated")

    wanted = Wanted(kind="joint", place_um=40_000.0, force_mN=3000.0, angle_deg=4.0)
    monkeypatch.setattr(Judge, "lit", saturated_twice)
    bench.take(wanted)
    assert bench.said().count("try again") == 2


class Slipping(StagePresser):
    """Lifts half a second after the press begins, and presses again two seconds later."""

    patience_s = 25.0

    def press(self, wanted):
        press = Press(wanted.place_um / 1000, wanted.force_mN, 4.0)
        follow(self._stage.held, [(0.3, 0.8, press), (2.8, float("inf"), press)])

    def release(self):
        follow(self._stage.held, [])


@pytest.mark.board
@pytest.mark.parametrize("kind", ["choose", "hand", "mark"])
def test_contact_that_sticks_is_not_taken_for_the_press_that_slipped(sensor, kind):
    sticky = replaced(sensor, contact={"sticking_percent": 1.0, "sticking_s": 3.0})
    with Stage(sticky, seed=4) as stage:
        guide = Guide(Console(file=io.StringIO()))
        bench = Bench(stage.reader, Slipping(stage), guide, stage.length_um, Path("a.toml"))
        wanted = Wanted(kind=kind, place_um=10_000.0, force_mN=6000.0)
        assert bench.take(wanted).reading.counts.min() > 100


class Hesitant(StagePresser):
    """Presses a second after the request."""

    def press(self, wanted):
        press = Press(wanted.place_um / 1000, wanted.force_mN, 4.0)
        follow(self._stage.held, [(1.0, float("inf"), press)])

    def release(self):
        follow(self._stage.held, [])


@pytest.mark.board
@pytest.mark.parametrize("kind", ["hand", "mark"])
def test_contact_that_sticks_is_not_taken_for_the_next_press(sensor, kind):
    sticky = replaced(sensor, contact={"sticking_percent": 1.0, "sticking_s": 1.0})
    firm = Wanted(kind=kind, place_um=10_000.0, force_mN=10_000.0)
    weak = Wanted(kind=kind, place_um=70_000.0, force_mN=500.0)
    with Stage(sticky, seed=4) as stage:
        guide = Guide(Console(file=io.StringIO()))
        bench = Bench(stage.reader, Hesitant(stage), guide, stage.length_um, Path("a.toml"))
        stage.reader.set_up(dark_s=2.0)
        alone = bench.take(weak).reading.counts
        bench.release()
        for _ in stage.board.frames(10.0):
            pass
        bench.take(firm)
        bench.release()
        assert bench.take(weak).reading.counts == pytest.approx(alone, rel=0.05, abs=0.5)
        bench.release()
        bench.take(firm)
        bench.release()
        # As a re-zero after typing.
        bench = Bench(stage.reader, Hesitant(stage), guide, stage.length_um, Path("a.toml"))
        bench.part()
        stage.reader.set_up(dark_s=2.0, untouched=True)
        assert not stage.reader.baseline.any()
