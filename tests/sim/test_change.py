"""Simulated drift of a strip: each change has the size and the sign that its key states."""

import json

import msgspec
import numpy as np
import pytest
from support.refusals import refusal

from spots import SpotsError
from spots.cli import main
from spots.errors import FileError
from spots_sim.board.identity import board_id
from spots_sim.strip import files
from spots_sim.strip.change import NAMES, Change
from spots_sim.strip.files import (
    ScenarioFile,
    SensorFile,
    load,
    load_change,
)
from spots_sim.strip.optics import WAVELENGTH_NM, Optics
from spots_sim.strip.scenario import Held, Press, Scenario
from spots_sim.strip.world import World, chip

PLAN = ("F3", "F4", "F5", "F6", "F7", "F8")


def logs(sensor, change, x_mm=40.0, led_K=0.0):
    optics = Optics(sensor, change, led_K)
    rates = optics.press(x_mm, 4.0) * optics.source_uW_cm2(20)
    return np.log([rates[optics.names.index(name)] for name in PLAN])


def moved(sensor, x_mm=40.0, **keys):
    return logs(sensor, Change(**keys), x_mm) - logs(sensor, Change(), x_mm)


def centred(logs):
    return logs - logs.mean()


def with_(sensor, **parts):
    return msgspec.structs.replace(
        sensor, **{k: msgspec.structs.replace(getattr(sensor, k), **v) for k, v in parts.items()}
    )


@pytest.mark.parametrize(
    ("keys", "part", "fields"),
    [
        ({"die_nm": 1.5}, "led", {"blue_nm": 453.5}),
        ({"phosphor_nm": -2}, "led", {"phosphor_nm": 588.0}),
        ({"phosphor_fwhm_nm": 3}, "led", {"phosphor_fwhm_nm": 133.0}),
        ({"blue_share_percent": 2}, "led", {"blue_share": 0.24}),
        ({"clear_percent": 10}, "dye", {"clear_per_mm": 0.0044}),
        ({"dye_percent": -5}, "dye", {"strength_per_mm": 0.0152}),
    ],
)
def test_a_change_is_added_to_the_value_of_the_file(sensor, keys, part, fields):
    assert logs(sensor, Change(**keys)) == pytest.approx(
        logs(with_(sensor, **{part: fields}), Change())
    )
    assert np.abs(moved(sensor, **keys)).max() > 1e-3


def test_light_is_common_to_all_channels(sensor):
    assert moved(sensor, light_percent=5) == pytest.approx(np.full(6, np.log(1.05)))


def test_a_tilt_is_linear_in_wavelength_from_the_bluest_to_the_reddest(sensor):
    # The gain at the middle wavelengths of F1 and of F8, and between them.
    optics, plain = Optics(sensor, Change(tilt_percent=0.5)), Optics(sensor)
    gain = optics._lit[8] / plain._lit[8]  # CLEAR sees all
    at = [np.interp(nm, WAVELENGTH_NM, gain) for nm in (415, 547.5, 680)]
    assert at == pytest.approx([1.0, 1.0025, 1.005])


def test_bands_move_against_the_spectrum(sensor):
    # A shift of all filters by +0.3 nm is like a shift of everything else by -0.3 nm.
    down = {"die_nm": -0.3, "phosphor_nm": -0.3}
    dye = with_(sensor, dye={"edge_nm": sensor.dye.edge_nm - 0.3})
    assert moved(sensor, bands_nm=0.3) == pytest.approx(
        logs(dye, Change(**down)) - logs(sensor, Change()), abs=1e-4
    )


def test_a_kelvin_becomes_the_others_and_length(sensor):
    per = sensor.temperature
    assert per.length_ppm_per_K > 0
    assert per.bands_nm_per_K > 0
    keys = {k: 10 * getattr(per, f"{k}_per_K", 0.0) for k in NAMES if k != "temperature_K"}
    grown = (1 + 10e-6 * per.length_ppm_per_K) ** 3
    thin = with_(sensor, dye={"strength_per_mm": sensor.dye.strength_per_mm / grown})
    assert logs(sensor, Change(temperature_K=10)) == pytest.approx(logs(thin, Change(**keys)))


def collected(world, start_s, seconds, led_mA=20.0):
    step_s = 1.0
    for i in range(int(seconds)):
        got = world.collect(1e6 * (start_s + i), 1e6 * (start_s + i + step_s), led_mA)
    return np.log([got[name] for name in PLAN]) if led_mA else None


def warmed(sensor):
    return with_(
        sensor,
        temperature={"led_K_per_mA": 0.5, "led_warm_up_s": 60.0},
        led={"noise_ppm_10ms": 0.0, "warm_up_percent": 0.0},
    )


def world_of(sensor):
    held = Held()
    held.press = Press(40.0, 3000.0, 4.0)
    return World(sensor, held, np.random.default_rng(0))


def test_the_led_warms_by_its_own_power_with_its_time_constant(sensor):
    sensor = warmed(sensor)
    cold, hot = logs(sensor, Change()), logs(sensor, Change(), led_K=10.0)
    world = world_of(sensor)
    first = collected(world, 0, 1)
    then = collected(world, 1, 59)
    end = collected(world, 60, 600)
    share = (then - then.mean() - (first - first.mean())) / (
        hot - hot.mean() - (cold - cold.mean())
    )
    assert share == pytest.approx(np.full(6, 1 - np.exp(-1)), abs=0.03)
    assert end - end.mean() == pytest.approx(hot - hot.mean(), abs=1e-4)


def test_the_led_cools_while_it_is_off(sensor):
    world = world_of(warmed(sensor))
    hot = collected(world, 0, 600)
    collected(world, 600, 60, led_mA=0.0)
    after = collected(world, 660, 1)
    cold = collected(world_of(warmed(sensor)), 0, 1)
    share = (after - after.mean() - (cold - cold.mean())) / (
        hot - hot.mean() - (cold - cold.mean())
    )
    assert share == pytest.approx(np.full(6, np.exp(-1)), abs=0.03)


def test_a_scenario_moves_each_change_in_time(tmp_path, sensor):
    path = tmp_path / "drift.toml"
    path.write_text(
        "seconds = 100\n[change]\ndie_nm = [[0, 0], [100, 2]]\ndye_percent = [[50, -4]]\n"
    )
    scenario = Scenario(load(ScenarioFile, path))
    assert scenario.change(25.0) == Change(die_nm=0.5, dye_percent=-4.0)
    sensor = with_(sensor, led={"noise_ppm_10ms": 0.0, "warm_up_percent": 0.0})

    class Pressed(Scenario):
        def presses(self, time_s):
            return [Press(40.0, 3000.0, 4.0)]

        def is_dark(self, start_s, end_s):
            return False

    world = World(sensor, Pressed(load(ScenarioFile, path)), np.random.default_rng(0))
    got = world.collect(24e6, 26e6, 20.0)
    log = np.log([got[name] for name in PLAN])
    expected = logs(sensor, Change(die_nm=0.5, dye_percent=-4.0))
    assert log - log.mean() == pytest.approx(expected - expected.mean(), abs=1e-6)


def test_a_sensor_file_may_have_changed_and_is_the_same_board(sensor):
    changed = msgspec.structs.replace(sensor, change=Change(phosphor_nm=1.0))
    assert board_id(changed) == board_id(sensor)
    for one in (changed, sensor):
        rates = World(one, world_of(one)._scenario, np.random.default_rng(0)).collect(0, 1e5, 20)
        log = np.log([rates[name] for name in PLAN])
        assert log - log.mean() == pytest.approx(
            logs(sensor, one.change) - logs(sensor, one.change).mean(), abs=1e-3
        )


@pytest.mark.parametrize("head", ["", "[change]\n"])
def test_a_change_file_has_the_keys_bare_or_in_their_table(tmp_path, head):
    path = tmp_path / "c.toml"
    path.write_text(head + "phosphor_nm = 1.0\ndye_percent = -5\n")
    assert load_change(path) == Change(phosphor_nm=1.0, dye_percent=-5.0)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("phosphor = 1.0", "unknown key 'phosphor'"),
        ("dye_percent = -100", "-99"),
        ("die_nm = nan", "not a finite number"),
        ("[change]\nspeed = 1.0", "unknown key 'speed' in table change"),
        ("die_nm = 'red'", "die_nm must be a number, not text"),
    ],
)
def test_a_mistake_in_a_change_is_one_sentence_with_its_place(tmp_path, text, says):
    path = tmp_path / "c.toml"
    path.write_text(text)
    with pytest.raises(SpotsError, match=says) as caught:
        load_change(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_points_of_a_change_ascend(tmp_path):
    path = tmp_path / "s.toml"
    path.write_text("seconds = 9\n[change]\ndie_nm = [[3, 1], [2, 2]]\n")
    with refusal(FileError, file="s.toml"):
        load(ScenarioFile, path)


def test_a_sensor_file_is_written_as_it_is_read(tmp_path, sensor):
    changed = msgspec.structs.replace(sensor, change=Change(phosphor_nm=1.0))
    (tmp_path / "s.toml").write_text(files.to_toml(changed))
    assert load(SensorFile, tmp_path / "s.toml") == changed


def test_a_tilted_press_is_the_weighted_mean_of_narrow_ones(sensor):
    optics = Optics(sensor)
    places = np.linspace(35, 45, 1001)
    parts = np.array([optics.press(at, 0.0) for at in places])
    weights = 1 + 0.8 * (places - 40) / 5
    mean = (parts * weights[:, None]).sum(axis=0) / weights.sum()
    assert optics.press(40, 10.0, tilt_percent=80.0) == pytest.approx(mean, rel=1e-4)


def test_noise_of_the_ratios_is_each_channels_own(sensor):
    sensor = with_(
        sensor,
        converter={"read_noise_counts": 0.0, "ratio_noise_ppm": 1000.0},
        led={"noise_ppm_10ms": 0.0},
    )
    noisy = chip(sensor, Held(), seed=1)
    diodes = "F1", "F2", "F3", "F4", "F5", "F6"
    converter = noisy._converter
    converter.routing = [{diode: 1.0} for diode in diodes]
    light = dict.fromkeys(diodes, 100.0)
    counts = np.array(
        [converter.convert(light, 9, 100_000.0, 65_535)[0] for _ in range(1000)], dtype=float
    )
    relative = counts / counts.mean(axis=0)
    assert relative.std(axis=0) == pytest.approx(np.full(6, 1e-3), rel=0.1)
    assert np.abs(np.corrcoef(relative.T) - np.eye(6)).max() < 0.15


def test_a_lamp_has_a_phase():
    steps = {"steps": [(0.0, 10.0)], "flicker_percent": 100.0, "flicker_hz": 100.0}
    at = [
        Scenario(
            ScenarioFile(seconds=1.0, ambient=files.Ambient(**steps, flicker_phase_deg=phase))
        ).ambient_uW_cm2(0.0, 1e-6)
        for phase in (0.0, 180.0)
    ]
    assert at == pytest.approx([20.0, 0.0], abs=1e-3)


def test_every_change_of_the_package_loads_by_its_name():
    names = [path.stem for path in (files.DATA / "changes").glob("*.toml")]
    assert "mixed" in names
    assert all(load_change(name) != Change() for name in names)


@pytest.mark.board
def test_a_demonstration_is_calibrated_before_the_change(capsys):
    errors_um = []
    for words in ([], ["--change", "phosphor"]):
        assert main(["demo", "--fast", "--json", "--seconds", "6", "--seed", "1", *words]) == 0
        errors_um.append(json.loads(capsys.readouterr().out)["position_rmse_um"])
    assert errors_um[0] < 150  # 63 to 127 with forty other seeds
    assert errors_um[1] > 1500
