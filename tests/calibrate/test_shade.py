"""Presses whose hand shades the ambient light: the dark samples of the press are subtracted."""

import numpy as np
import pytest
from support.sensors import replaced

from spots_sim.person.stage import Stage

pytestmark = pytest.mark.board


def pressed(sensor, irradiance_uW_cm2, watched):
    strip = replaced(
        sensor, surroundings={"irradiance_uW_cm2": irradiance_uW_cm2, "shaded_percent": 50.0}
    )
    with Stage(strip, seed=4, settings="exposure_us=10000") as stage:
        stage.by_hand = True
        stage.reader.set_up(dark_s=2.5, untouched=True)
        stage.press(60_000.0, 1500.0)
        if not watched:
            return stage.reader.read(96).counts
        with stage.reader.watched():
            counts = stage.reader.read(96).counts
        assert stage.board.command("get")["dark_every"] == 0
        return counts


@pytest.mark.parametrize("irradiance_uW_cm2", [5.0, 50.0])
def test_the_shadow_of_the_hand_is_not_subtracted(sensor, irradiance_uW_cm2):
    expected = pressed(sensor, 0.0, watched=False)
    assert pressed(sensor, irradiance_uW_cm2, watched=True) == pytest.approx(expected, abs=0.7)
    shaded = pressed(sensor, irradiance_uW_cm2, watched=False)
    assert np.all(shaded < expected - 1.2 * irradiance_uW_cm2)
