"""Effects of imperfect strips: each has the size and the sign of its keys, and none by default."""

import json
from importlib import import_module

import msgspec
import numpy as np
import pytest
from support.sensors import replaced

from evidence.effects import errors, main, with_keys
from spots.calibrate.calibration_file import INDENTER
from spots.calibrate.pressers import used_by
from spots.errors import SpotsError
from spots_sim.board.identity import board_id
from spots_sim.measure.bound import Bound
from spots_sim.measure.rig import Rig
from spots_sim.person.by_hand import calibrate_by_hand
from spots_sim.person.person import follow_pipe, line_of
from spots_sim.person.stage import Stage
from spots_sim.strip.change import Change
from spots_sim.strip.contact import coupling
from spots_sim.strip.files import ScenarioFile, SensorFile, load, to_toml
from spots_sim.strip.optics import WAVELENGTH_NM, Optics, decay_per_mm, led_spectrum
from spots_sim.strip.path import DyedPath
from spots_sim.strip.scenario import Held, Press, Scenario
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


def test_skin_reflects_red_light_of_a_finger_and_not_of_an_indenter(sensor):
    skinny = quiet(sensor, contact__skin_percent=3.0)
    added = spectrum(skinny, skin=True) / spectrum(sensor) - 1
    assert (np.diff(added) > -1e-12).all()
    assert added[-1] == pytest.approx(0.03)
    assert 0.009 < added[0] < 0.018
    assert (spectrum(skinny) == spectrum(sensor)).all()
    finger, stage = (
        collected(held_world(skinny, 40.0, 3000.0, 4.0, 0.0, skin, skin)[1])
        for skin in (True, False)
    )
    ratio = finger / stage
    assert 1.012 < ratio[Optics.names.index("F3")] < 1.014 < 1.027 < ratio[7] < 1.03


def narrow(sensor, *places, **press):
    """Return the optical depth of the dye, in mm of evenly dyed guide, of presses without width."""
    k = (decay_per_mm(sensor.dye) - sensor.dye.clear_per_mm)[0]
    clear = replaced(sensor, dye={"strength_per_mm": 0.0})
    depths = []
    for place in places:
        at = {"position_mm": place, "width_mm": 0.0} | press
        depths.append(np.log(spectrum(clear, **at)[0] / spectrum(sensor, **at)[0]) / k)
    return np.array(depths)


def test_uneven_dye_lengthens_and_shortens_the_path_along_the_strip(sensor):
    places = np.linspace(0, 85, 12)
    assert narrow(sensor, *places) == pytest.approx(places)
    uneven = {"uneven_percent": 10.0, "uneven_mm": 30.0, "uneven_phase_deg": 40.0}
    fine = np.linspace(0, 85, 85_001)
    strength = 1 + 0.1 * np.sin(2 * np.pi * fine / 30 + np.radians(40))
    integral = np.concatenate([[0], np.cumsum((strength[1:] + strength[:-1]) / 2 * 0.001)])
    expected = np.interp(places, fine, integral)
    assert narrow(replaced(sensor, dye=uneven), *places) == pytest.approx(expected, abs=1e-4)
    # The dye moves with the material, and is diluted.
    stretched = narrow(replaced(sensor, dye=uneven), *(1.2 * places), strain=0.2)
    assert stretched == pytest.approx(
        expected * 1.2 ** (2 * sensor.stretch.poisson_ratio), abs=1e-4
    )


def test_a_bend_lengthens_the_path_of_its_piece(sensor):
    bent = replaced(
        sensor, stretch={"bend_path_percent": 5.0, "bend_mm": 20.0, "bend_at_percent": 40.0}
    )
    places = 10.0, 24.0, 34.0, 44.0, 85.0  # the bent piece is from 24 to 44 mm
    assert narrow(bent, *places) == pytest.approx(places)
    longer = narrow(bent, *places, bend_deg=45.0) - places
    assert longer == pytest.approx([0, 0, 0.25, 0.5, 0.5], abs=1e-9)


def test_dye_changes_in_each_third(sensor):
    now = Change(dye_near_percent=-5.0, dye_middle_percent=10.0, dye_far_percent=-1.0)
    path = DyedPath(sensor, now)
    third = sensor.length_mm / 3
    expected = third * np.cumsum([0.95, 1.10, 0.99])
    assert [path.at(n * third, 0.0)[0] for n in (1, 2, 3)] == pytest.approx(expected)
    assert path.at(1.5 * third, 0.0)[1] == pytest.approx(1.10)
    rates = [Optics(sensor, change).press(85.0, 0.0) for change in (Change(), now)]
    assert (rates[1] < rates[0]).all()  # the whole path is longer


def test_a_wide_press_on_uneven_dye_is_the_mean_of_narrow_ones(sensor):
    uneven = replaced(sensor, dye={"uneven_percent": 10.0, "far_end_percent": 4.0})
    optics = Optics(uneven)
    parts = np.mean([optics.press(at, 0.0) for at in np.linspace(35, 45, 1001)], axis=0)
    assert optics.press(40.0, 10.0) == pytest.approx(parts, rel=1e-3)


def test_the_far_end_reflects_light_that_returns_by_the_whole_guide(sensor):
    shiny = replaced(sensor, dye={"far_end_percent": 4.0})
    for optics in (Optics(shiny), Optics(sensor, Change(far_end_percent=4.0))):
        optics._lit = np.eye(len(WAVELENGTH_NM))
        there = optics.press(60.0, 0.0)
        direct, mirrored = (
            spectrum(sensor, position_mm=at, width_mm=0.0) for at in (60.0, 2 * 85.0 - 60.0)
        )
        assert there == pytest.approx(direct + 0.04 * mirrored)


@pytest.mark.parametrize("name", ["default", "first"])
def test_many_narrow_contacts_are_computed_at_once(name):
    optics = Optics(load(SensorFile, name))
    places = np.array([0.5, 30.5, 84.5])
    one_by_one = [optics.press(at, 0.0, 0.1, 40.0, share=0.0) for at in places.tolist()]
    assert optics.narrow(places, 0.1, 40.0) == pytest.approx(np.array(one_by_one))


def table(path, nm, values, head="nm,value\n", between=","):
    path.write_text(head + "".join(f"{a:g}{between}{b:g}\n" for a, b in zip(nm, values)))


def with_spectra(tmp_path, sensor, **names):
    """Return a sensor whose LED or dye has the spectrum of a file, as read from a sensor file."""
    for part, name in names.items():
        sensor = replaced(sensor, **{part: {"spectrum": name}})
    (tmp_path / "my.toml").write_text(to_toml(sensor))
    return load(SensorFile, tmp_path / "my.toml")


def test_spectra_come_from_the_files_of_a_spectrometer(tmp_path, sensor):
    nm = np.arange(900.0, 300.0, -1.0)  # some spectrometers write the longest wavelength first
    led = np.interp(nm, WAVELENGTH_NM, led_spectrum(sensor.led))
    dye = np.interp(nm, WAVELENGTH_NM, decay_per_mm(sensor.dye) - sensor.dye.clear_per_mm)
    table(tmp_path / "led.csv", nm, 1e4 * led)
    table(tmp_path / "dye.txt", nm, 0.7 * dye, "# A dye\nnm;A\n", ";")
    found = with_spectra(tmp_path, sensor, led="led.csv", dye="dye.txt")
    assert Optics(found).press(40.0, 4.0) == pytest.approx(
        Optics(sensor).press(40.0, 4.0), rel=1e-3
    )
    # It goes through a file without the tables, and is another board.
    (tmp_path / "copy.toml").write_text(to_toml(found))
    assert load(SensorFile, tmp_path / "copy.toml") == found
    assert board_id(found) != board_id(sensor)
    # It changes as the peaks do.
    change = Change(phosphor_nm=1.0)
    ratio = Optics(found, change).press(40.0, 4.0) / Optics(found).press(40.0, 4.0)
    model = Optics(sensor, change).press(40.0, 4.0) / Optics(sensor).press(40.0, 4.0)
    assert ratio == pytest.approx(model, rel=1e-3)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        (None, "cannot read the spectrum .*led.csv"),
        ("nm,value\n", "lines such as 450,0.83 from 430 nm"),
        ("500,1\n900,1\n", "from 430 nm or less"),
        ("400,1\n600,1\n", "to 670 nm or more"),
        ("400,1\n500,red\n900,1\n", "line 2 of the spectrum .* must be a wavelength"),
        ("400,1\n500\n900,1\n", "line 2 of the spectrum .* must be a wavelength"),
        ("400,1\n500,nan\n900,1\n", "line 2 of the spectrum .* must be a wavelength"),
        ("400,1\n400,2\n900,1\n", "line 2 of the spectrum .* repeats 400 nm"),
        ("400,-1\n900,0\n", "no value above 0"),
    ],
)
def test_a_mistake_in_a_spectrum_is_one_sentence_with_its_place(tmp_path, sensor, text, says):
    if text is not None:
        (tmp_path / "led.csv").write_text(text)
    with pytest.raises(SpotsError, match=says) as caught:
        with_spectra(tmp_path, sensor, led="led.csv")
    assert str(tmp_path / "led.csv") in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.fixture(scope="module")
def published_leds():
    return import_module("colour.colorimetry.datasets.illuminants").SDS_ILLUMINANTS


@pytest.mark.board
@pytest.mark.parametrize("name", ["LED-B3", "LED-V2"])
def test_a_strip_under_a_published_led_spectrum_calibrates(tmp_path, sensor, published_leds, name):
    published = published_leds[name]
    table(tmp_path / "led.csv", published.wavelengths, published.values)
    found = with_spectra(tmp_path, sensor, led="led.csv")
    inside = (WAVELENGTH_NM <= 780) & (WAVELENGTH_NM % 5 == 0)
    share = led_spectrum(found.led)[inside] / led_spectrum(found.led).sum()
    values = np.array([published[nm] for nm in WAVELENGTH_NM[inside]])
    assert share == pytest.approx(values * share.sum() / values.sum())
    with Rig(found, 0, 10_000, 1) as rig:
        (firm,) = errors(rig, (3.0,), readings=8, places=(0.1, 0.3, 0.5, 0.7, 0.9))
    assert firm.error_mm < 0.15
    assert firm.missing_percent == 0


def test_the_default_led_is_between_published_ones_of_its_colour(sensor, published_leds):
    # 4000 K: LED-B3 has 4103 K, LED-B4 has 5109 K.
    blue = [led_spectrum(sensor.led)[WAVELENGTH_NM < 500].sum()]
    for name in ("LED-B3", "LED-B4"):
        published = published_leds[name]
        blue.append(published.values[published.wavelengths < 500].sum() / published.values.sum())
    assert blue[1] < blue[0] < blue[2]


@pytest.mark.board
def test_a_stage_waits_until_its_last_press_has_parted(sensor):
    # Each place is read alone: the light of two presses is the same in either order.
    sticky = with_keys(sensor, {"contact.sticking_percent": 5.0, "contact.sticking_s": 0.3})
    logs = []
    for places in ([10_000.0, 60_000.0], [60_000.0]):
        with Stage(sticky) as stage:
            stage.expose()
            logs.append(stage.read(places, [3000.0], 8).logs[-1])
    assert logs[0] == pytest.approx(logs[1], abs=0.01)


def test_a_stage_has_no_hand_until_one_presses(sensor):
    with Stage(sensor) as stage:
        stage.press(10_000, 3000)
        assert not stage.held.press.hand
        stage.by_hand = True
        stage.press(10_000, 3000)
        assert stage.held.press.hand


def test_a_hands_press_goes_through_a_pipe_as_it_is(tmp_path):
    pipe = tmp_path / "pipe"
    press = Press(40.0, 3000.0, 8.0, hand=False)
    pipe.write_text(line_of([(0.0, 5.0, press)]))
    held = Held()
    follow_pipe(held, pipe).join()
    assert held.presses(1.0) == [press]


@pytest.mark.board
def test_errors_of_a_strip_are_measured_by_force(sensor):
    with Rig(sensor, 0, 10_000, 1) as rig:
        light, firm = errors(rig, (0.6, 3.0), readings=12, places=(0.2, 0.5, 0.8))
        assert 0.8 < firm.scatter_to_bound < 1.3
        assert firm.error_mm < 0.1 < light.error_mm
        assert firm.missing_percent == 0
        assert firm.untrusted_percent < 3  # at most one reading is in doubt as a touch begins
        rig.stage.held.changed = Change(phosphor_nm=1.0)
        (moved,) = errors(rig, (3.0,), readings=4, places=(0.2, 0.5, 0.8))
        assert 1 < moved.bias_mm < moved.worst_bias_mm < 5
        (missed,) = errors(rig, (0.01,), readings=2, places=(0.5,))
        assert missed.missing_percent == 100


@pytest.mark.board
def test_a_person_calibrates_the_strip_by_hand_and_then_with_a_finger(sensor):
    def error_mm(lines, by_hand):
        rig.use(lines)
        rig.stage.by_hand = by_hand
        (firm,) = errors(rig, (3.0,), readings=6, places=(0.2, 0.5, 0.8))
        assert firm.missing_percent == 0
        return firm.error_mm

    with Rig(with_keys(sensor, {"contact.skin_percent": 3.0}), 0, 10_000, 1) as rig:
        made = calibrate_by_hand(rig.stage, seed=1, count=22)
        assert (made.gain, made.exposure_us) == (rig.conditions.gain, 10_000)
        indenter = used_by(made, INDENTER).lines
        assert error_mm(indenter, by_hand=False) < 0.25
        assert error_mm(indenter, by_hand=True) > 0.8
        assert error_mm(made.lines, by_hand=True) < 0.4


@pytest.mark.board
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


def test_dust_couples_its_light_beside_that_of_a_press(sensor):
    dusty = quiet(sensor, contact__dust=[[30.0, 0.3], [60.0, 1.0]])
    optics = Optics(sensor)
    dust = 0.003 * optics.press(30.0, 0.0) + 0.01 * optics.press(60.0, 0.0)
    dust *= optics.source_uW_cm2(20.0) * 10.0
    assert collected(held_world(dusty)[1]) == pytest.approx(dust)
    press = collected(held_world(quiet(sensor), 40.0, 2000.0, 4.0)[1])
    assert collected(held_world(dusty, 40.0, 2000.0, 4.0)[1]) == pytest.approx(press + dust)
    scenario = Scenario(ScenarioFile(seconds=10.0))
    untouched = World(dusty, scenario, np.random.default_rng(0))
    assert collected(untouched) == pytest.approx(dust)
    stretched = World(
        dusty, Scenario(ScenarioFile(seconds=10.0, strain_percent=20)), np.random.default_rng(0)
    )
    moved = 0.003 * optics.press(36.0, 0.0, 0.2) + 0.01 * optics.press(72.0, 0.0, 0.2)
    assert collected(stretched) == pytest.approx(moved * optics.source_uW_cm2(20.0) * 10.0)


def test_a_lifted_press_leaves_a_part_of_its_contact_that_decays(sensor):
    sticky = quiet(sensor, contact__sticking_percent=1.0, contact__sticking_s=0.5)
    held, world = held_world(sticky, 40.2, 3000.0, 4.0)
    pressed = collected(world)
    assert pressed == pytest.approx(collected(held_world(quiet(sensor), 40.2, 3000.0, 4.0)[1]))
    held.press = None
    for time_s in (0.1, 0.5, 2.0):
        left = collected(world, time_s, 0.001) * 10  # after the middles of the two exposures
        kept = 0.01 * np.exp(-(time_s + 0.0005 - 0.005) / 0.5)
        assert left == pytest.approx(kept * pressed, rel=3e-3)


def test_a_slide_leaves_contact_only_where_it_lifts(sensor):
    sticky = quiet(sensor, contact__sticking_percent=1.0, contact__sticking_s=0.5)
    held, world = held_world(sticky, 20.0, 3000.0, 4.0)
    plain_held, plain = held_world(quiet(sensor))
    for i, at_mm in enumerate(np.arange(20.0, 60.1, 0.5).tolist()):
        held.press = plain_held.press = Press(at_mm, 3000.0, 4.0)
        pressed = collected(world, 0.01 * i)
        assert pressed == pytest.approx(collected(plain, 0.01 * i))
    for force_mN in (2000.0, 1000.0, 200.0):  # a lift takes time
        i += 1
        held.press = Press(60.0, force_mN, 4.0)
        collected(world, 0.01 * i)
    held.press = None
    left = collected(world, 0.01 * (i + 1))
    assert left == pytest.approx(0.01 * np.exp(-0.04 / 0.5) * pressed, rel=3e-3)


def test_a_press_beside_what_remains_adds_to_it_and_one_on_it_does_not(sensor):
    sticky = quiet(sensor, contact__sticking_percent=2.0, contact__sticking_s=1e9)
    held, world = held_world(sticky, 20.5, 6000.0, 4.0)
    collected(world)
    remaining = 0.02 * coupling(sensor.contact, 6000.0)
    for at_mm, added in ((20.5, 0.0), (60.5, remaining)):
        held.press = Press(at_mm, 1000.0, 4.0)
        share = coupling(sensor.contact, 1000.0)
        optics = Optics(sensor)
        expected = share * optics.press(at_mm, 4.0) + added * optics.press(20.5, 4.0)
        expected *= optics.source_uW_cm2(20.0) * 10.0
        assert collected(world, 1.0) == pytest.approx(expected, rel=1e-3)


def test_contact_that_remains_is_seen_between_the_touches_of_a_scenario(sensor):
    sticky = quiet(sensor, contact__sticking_percent=1.0)
    touch = {"points": [(1.0, 40.0, 3000.0), (2.0, 40.0, 3000.0)]}
    scenario = Scenario(msgspec.convert({"seconds": 10.0, "touch": [touch]}, ScenarioFile))
    world = World(sticky, scenario, np.random.default_rng(0))
    assert not collected(world, 0.5).any()
    pressed = collected(world, 1.9)
    assert collected(world, 2.005, 0.001) * 10 == pytest.approx(0.01 * pressed, rel=0.2)
    assert not collected(world, 0.5 + 30.0).any()


def test_the_hand_shades_ambient_light_while_it_presses(sensor):
    lit = {"irradiance_uW_cm2": 5.0, "shaded_percent": 40.0}
    shaded = replaced(quiet(sensor), surroundings=lit)
    held, world = held_world(shaded)
    lamp = Optics(sensor).ambient(5.0) * 10.0

    def dark(time_s):
        counts = world.collect(1e6 * time_s, 1e6 * time_s + 1e4, 0.0)
        return np.array([counts[name] for name in Optics.names])

    assert dark(0.0) == pytest.approx(lamp)
    held.press = Press(40.0, 3000.0, 4.0)
    assert dark(1.0) == pytest.approx(0.6 * lamp)
    held.press = Press(40.0, 3000.0, 4.0, hand=False)
    assert dark(2.0) == pytest.approx(lamp)
    touch = {"points": [(1.0, 40.0, 3000.0), (2.0, 40.0, 3000.0)]}
    ambient = {"steps": [(0.0, 5.0)], "shaded_percent": 40.0}
    file = {"seconds": 10.0, "touch": [touch], "ambient": ambient}
    scenario = Scenario(msgspec.convert(file, ScenarioFile))
    assert scenario.ambient_uW_cm2(0.5, 0.51) == pytest.approx(5.0)
    assert scenario.ambient_uW_cm2(1.5, 1.51) == pytest.approx(3.0)


def test_the_sun_through_leaves_changes_irregularly_around_its_mean():
    ambient = {"steps": [(0.0, 5.0)], "leaves_percent": 80.0, "leaves_hz": 2.0}
    scenario = Scenario(msgspec.convert({"seconds": 100.0, "ambient": ambient}, ScenarioFile))
    at_s = np.arange(0.0, 100.0, 0.01)
    light = np.array([scenario.ambient_uW_cm2(t, t + 0.01) for t in at_s.tolist()])
    assert light.mean() == pytest.approx(5.0, rel=0.01)
    assert 1.0 <= light.min() < 1.5
    assert 8.5 < light.max() <= 9.0
    frequencies = np.fft.rfftfreq(len(at_s), 0.01)
    power = np.abs(np.fft.rfft(light - light.mean()))
    assert frequencies[power > 0.3 * power.max()] == pytest.approx([2.0, 2.83, 4.47], abs=0.03)
    assert scenario.ambient_uW_cm2(3.0, 4.0) == pytest.approx(light[300:400].mean())


def test_the_bound_contains_the_noise_of_the_dusts_light(sensor):
    conditions = ("F3", "F4", "F5", "F6", "F7", "F8"), 9, 10_000, 20.0
    noisy = replaced(sensor, converter={"ratio_noise_ppm": 1e5})  # far above all other noise
    percent = 100 * coupling(sensor.contact, 3000.0)
    dusty = quiet(noisy, contact__dust=[[50.0, percent]])  # its light is that of the press
    plain, with_dust = Bound(noisy, *conditions), Bound(dusty, *conditions)
    assert with_dust.counts(50_000, 3000) == pytest.approx(plain.counts(50_000, 3000))
    assert with_dust.sigma(50_000, 3000)[0] == pytest.approx(
        2 * plain.sigma(50_000, 3000)[0], rel=0.01
    )
