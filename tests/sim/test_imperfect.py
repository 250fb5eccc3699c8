"""Effects of imperfect strips: each has the size and the sign of its keys, and none by default."""

import json

import numpy as np
import pytest
from sensors import replaced

from spots_sim.board.identity import board_id
from spots_sim.measure.effects import errors, main, with_keys
from spots_sim.measure.rig import Rig
from spots_sim.strip.change import Change
from spots_sim.strip.contact import coupling
from spots_sim.strip.optics import WAVELENGTH_NM, Optics, decay_per_mm
from spots_sim.strip.scenario import Held, Press
from spots_sim.strip.world import World


def quiet(sensor, **keys):
    """Return a copy of a sensor without noise of its LED, with other values of some keys."""
    still = replaced(sensor, led={"noise_ppm_10ms": 0.0, "warm_up_percent": 0.0})
    return with_keys(still, {key.replace("__", "."): value for key, value in keys.items()})


def spectrum(sensor, **press):
    """Return the light of a press at each wavelength, up to the response of the diodes."""
    optics = Optics(sensor)
    optics._lit = np.eye(len(WAVELENGTH_NM))
    return optics.press(**({"position_mm": 40.0, "width_mm": 4.0} | press))


def collected(world, time_s=0.0, seconds=0.01):
    counts = world.collect(1e6 * time_s, 1e6 * (time_s + seconds), 20.0)
    return np.array([counts[name] for name in Optics.names])


def held_world(sensor, *press):
    held = Held()
    held.press = Press(*press) if press else None
    return held, World(sensor, held, np.random.default_rng(0))


def test_an_ideal_strip_has_no_effect_in_the_last_bit(sensor):
    # The light of the plain formula, computed in the same order.
    optics = Optics(sensor)
    dyed = decay_per_mm(sensor.dye) - sensor.dye.clear_per_mm
    volume = 1.1 ** (1 - 2 * sensor.stretch.poisson_ratio)
    for at_mm in (0.0, 12.3, 84.0):
        decay = sensor.dye.clear_per_mm + dyed / volume
        half = decay * 4.0 / 2
        spread = 1 + half**2 / 6 + half**4 / 120
        plain = 0.975 * (optics._lit @ (np.exp(-decay * at_mm) * spread))
        assert (optics.press(at_mm, 4.0, 0.1, 90.0) == plain).all()


def test_the_light_of_an_ideal_strip_has_one_colour(sensor):
    forces = 600.0, 3000.0, 9000.0
    light = [collected(held_world(quiet(sensor), 40.0, force, 4.0)[1]) for force in forces]
    shares = np.array([coupling(sensor.contact, force) for force in forces])
    assert np.array(light) / shares[:, None] == pytest.approx(np.tile(light[0] / shares[0], (3, 1)))


@pytest.mark.parametrize("gap_percent", [10.0, -30.0])
def test_light_across_gaps_is_redder_the_lighter_the_press(sensor, gap_percent):
    plain, gappy = spectrum(sensor), quiet(sensor, contact__gap_percent=gap_percent)
    for share in (0.05, 0.5, 1.0):
        factor = 1 + gap_percent / 100 * (1 - share) * (WAVELENGTH_NM - 565) / 565
        assert spectrum(gappy, share=share) == pytest.approx(plain * factor)


@pytest.mark.parametrize("mode_percent", [5.0, -5.0])
def test_steep_modes_lengthen_the_dyed_path_alone(sensor, mode_percent):
    steep, firm = quiet(sensor, contact__mode_percent=mode_percent), coupling(sensor.contact, 6000)
    for share in (0.05, firm, 0.9):
        longer = 1 + mode_percent / 100 * (share - firm)
        dye = replaced(sensor, dye={"strength_per_mm": longer * sensor.dye.strength_per_mm})
        assert spectrum(steep, share=share) == pytest.approx(spectrum(dye))


def test_the_colour_follows_the_contact_share_of_the_force(sensor):
    coloured = quiet(sensor, contact__gap_percent=10.0, contact__mode_percent=-3.0)
    for force_mN in (600.0, 3000.0):
        share = coupling(sensor.contact, force_mN)
        light = Optics(coloured).press(40.0, 4.0, share=share)
        expected = share * light * Optics(coloured).source_uW_cm2(20.0) * 10.0
        found = collected(held_world(coloured, 40.0, force_mN, 4.0)[1])
        assert found == pytest.approx(expected, rel=1e-6)


def test_a_key_with_its_default_keeps_the_board(sensor):
    assert board_id(sensor) == "fb74ec41e54f2790"
    assert board_id(quiet(sensor, contact__gap_percent=1.0)) != board_id(quiet(sensor))


def test_errors_of_a_strip_are_measured_by_force(sensor):
    with Rig(sensor, 0, 10_000, 1) as rig:
        light, firm = errors(rig, (0.6, 3.0), readings=12, places=(0.2, 0.5, 0.8))
        assert 0.8 < firm.scatter_to_bound < 1.3
        assert firm.error_mm < 0.1 < light.error_mm
        assert firm.untrusted_percent == firm.missing_percent == 0
        rig.stage.held.changed = Change(phosphor_nm=1.0)
        (moved,) = errors(rig, (3.0,), readings=4, places=(0.2, 0.5, 0.8))
        assert 1 < moved.bias_mm < moved.worst_bias_mm < 5
        (missed,) = errors(rig, (0.01,), readings=2, places=(0.5,))
        assert missed.missing_percent == 100


def test_the_program_prints_errors_or_what_is_wrong(monkeypatch, capsys):
    def run(*words):
        monkeypatch.setattr("sys.argv", ["effects", "--readings", "2", "--forces", "3", *words])
        main()
        return capsys.readouterr().out

    row = json.loads(run("--json", "--set", "dye.edge_nm=590"))
    assert row["force_N"] == 3
    for words, says in (
        (["--set", "dye.edgy_nm=5"], "unknown key 'edgy_nm' in table dye"),
        (["--set", "dye.edge_nm"], "KEY=VALUE"),
        (["--set", "dye.edge_nm=red"], "KEY=VALUE"),
        (["--later", "phosphor=1"], "unknown key 'phosphor'"),
    ):
        with pytest.raises(SystemExit, match=says):
            run(*words)
