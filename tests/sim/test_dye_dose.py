"""`spots design --measure-dye`: the dose of dye from measurements of two test pieces."""

import json

import pytest
from support.refusals import refusal
from support.sensors import replaced

from spots.calibrate.session.spectra import SpectrumReader
from spots.cli import main
from spots.errors import CalibrationError, SpotsError
from spots_make import dye_dose
from spots_sim.person.stage import Stage
from spots_sim.strip.change import NONE, Change
from spots_sim.strip.files import SensorFile, load
from spots_sim.strip.scenario import Press

LENGTH_MM = 60.0
TARGET = ["--length-mm", "85", "--resolution-um", "50", "--rate-hz", "100"]


def measured(capsys, sensor, *options):
    line = ["design", *TARGET, "--measure-dye", "--port", "virtual", "--sensor", sensor]
    assert main([*line, "--json", *options]) == 0
    return json.loads(capsys.readouterr().out.splitlines()[-1])


@pytest.mark.board
@pytest.mark.parametrize("sensor", ["default", "weak_dye", "strong_dye", "always", "cold_led"])
def test_the_strength_of_a_test_piece_is_measured(capsys, sensor):
    found = measured(capsys, sensor)
    true = load(SensorFile, sensor).dye.strength_per_mm
    assert found["measured_per_mm"] == pytest.approx(true, rel=0.01)
    assert found["dose_g_per_100g"] == pytest.approx(2 * found["wanted_per_mm"] / true, rel=0.01)
    assert found["misfit"] < 0.01


@pytest.mark.board
def test_dose_and_length_of_the_test_piece_count(capsys):
    usual = measured(capsys, "default")["dose_g_per_100g"]
    more = measured(capsys, "default", "--test-dose", "3")["dose_g_per_100g"]
    assert more == pytest.approx(1.5 * usual, rel=0.01)
    shorter = measured(capsys, "default", "--test-length-mm", "30")
    assert shorter["dose_g_per_100g"] == pytest.approx(usual, rel=0.02)


class Person:
    """A simulated person who inserts the requested test piece; each couples light differently."""

    def __init__(self, stage, order=("clear", "dyed")):
        self._stage = stage
        self._order = iter(order)

    def ask(self, text):
        piece = next(self._order)
        self._stage.held.changed = Change(dye_percent=-100.0) if piece == "clear" else NONE
        force_mN = 6_000 if piece == "clear" else 3_000
        self._stage.held.press = Press(LENGTH_MM, force_mN, 0.0)
        return ""


def pieces(sensor, **options):
    with Stage(sensor, 5) as stage:
        reader = SpectrumReader(stage.board)
        read = dye_dose.read_pieces(reader, Person(stage, **options).ask, stage.take_dark)
    return dye_dose.strength(sensor, LENGTH_MM, *read)


def test_how_well_a_piece_touches_does_not_count():
    sensor = load(SensorFile, "default")
    assert pieces(sensor).per_mm == pytest.approx(sensor.dye.strength_per_mm, rel=0.01)


def test_another_colour_is_reported(capsys):
    sensor = load(SensorFile, "default")
    other = replaced(sensor, dye={"edge_nm": 520.0})
    with Stage(other, 5) as stage:
        read = dye_dose.read_pieces(stage.reader, Person(stage).ask, stage.take_dark)
    assert dye_dose.strength(sensor, LENGTH_MM, *read).misfit > dye_dose._MISFIT_MAX


@pytest.mark.parametrize(
    ("order", "says"),
    [
        (("clear", "clear"), "the same colour"),
        (("dyed", "clear"), "put in first|saturates"),
    ],
)
def test_pieces_in_the_wrong_order_are_noticed(order, says):
    with pytest.raises(SpotsError, match=says):
        pieces(load(SensorFile, "default"), order=order)


@pytest.mark.parametrize(("dark", "less_dye"), [("clear", False), ("dyed", True)])
def test_only_a_dark_dyed_piece_asks_for_a_smaller_dose(dark, less_dye):
    counts = {"clear": [100.0] * 6, "dyed": [50.0] * 6, dark: [0.0] + [50.0] * 5}
    with refusal(CalibrationError) as error:
        dye_dose.strength(
            load(SensorFile, "default"), LENGTH_MM, ("F1",) * 6, counts["clear"], counts["dyed"]
        )
    assert ("smaller dose" in str(error.value)) is less_dye


def test_a_dose_that_no_tint_gives_is_refused():
    with refusal(CalibrationError):
        dye_dose.dose(2.0, 0.001, 0.1)
    assert dye_dose.dose(2.0, 0.016, 0.032) == pytest.approx(4.0)
