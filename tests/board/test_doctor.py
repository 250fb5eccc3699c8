"""The light check of `spots doctor`: it fails without a wired LED, in any ambient light."""

import re
import time
from itertools import islice

import pytest
from support.boards import virtual_board
from support.sensors import replaced

from spots.calibrate.calibration_file import INDENTER
from spots.calibrate.pressers import marked
from spots.cli import main
from spots.deploy.doctor import examine, examine_board
from spots.deploy.staging import device_of, stage
from spots.keyboard.layout import load as layout
from spots.link.connect import upload
from spots.link.finder import finder
from spots.terminal.monitor import watch
from spots_sim.chip.converter import Converter
from spots_sim.person.stage import NEAR_UM, Stage, calibrate
from spots_sim.strip.change import Change
from spots_sim.strip.files import SensorFile, load
from spots_web.board_feed import BoardReader
from spots_web.state import PageState

UNWIRED = {"irradiance_uW_cm2_per_mA": 1e-9}


def light_of(stage):
    """Run the checks of `spots doctor` in simulated time; return the findings of the light check.

    If the check asks to unplug an LED that is always on, the simulated person does so.
    """
    found = []
    for finding in examine_board(stage.board):
        if finding.check == "light":
            found.append(finding)
            stage.held.unplugged |= "unplug the LED or" in finding.text
    return found


@pytest.mark.board
@pytest.mark.parametrize(("room", "pressed"), [("default", False), ("daylight", True)])
def test_an_led_that_is_not_wired_never_passes(room, pressed):
    with Stage(replaced(load(SensorFile, room), led=UNWIRED)) as stage:
        if pressed:
            stage.press(NEAR_UM, 8_000)
        *asked, verdict = light_of(stage)
    assert [finding.ok for finding in asked] == [True]
    assert "press firmly" in asked[0].text
    assert not verdict.ok
    assert "check the wire from LDR" in verdict.text


@pytest.mark.board
@pytest.mark.parametrize("room", ["daylight"])
def test_a_strip_that_nobody_presses_does_not_pass_either(room):
    with Stage(load(SensorFile, room)) as stage:
        asked, verdict = light_of(stage)
    assert asked.ok
    assert "press firmly" in asked.text
    assert not verdict.ok


@pytest.mark.board
@pytest.mark.parametrize("room", ["default", "daylight"])
def test_a_press_passes_at_once(room):
    with Stage(load(SensorFile, room)) as stage:
        stage.press(NEAR_UM, 8_000)
        (verdict,) = light_of(stage)
    assert verdict.ok
    assert "% of full scale" in verdict.text


@pytest.mark.board
@pytest.mark.parametrize("kind", ["gpio", "always"])
@pytest.mark.parametrize("wired", [True, False])
def test_the_light_of_any_led_is_examined_and_its_wires_named(kind, wired):
    sensor = load(SensorFile, kind)
    with Stage(sensor if wired else replaced(sensor, led=UNWIRED)) as stage:
        stage.press(NEAR_UM, 8_000)
        *_, verdict = light_of(stage)
    assert verdict.ok is wired
    if not wired:
        assert {"gpio": "STRIP_LED_PIN", "always": "the LED's supply"}[kind] in verdict.text
        assert "LDR" not in verdict.text


@pytest.mark.board
def test_a_flickering_lamp_is_not_the_led():
    lamp = {"irradiance_uW_cm2": 200.0, "flicker_hz": 120.0, "flicker_percent": 100.0}
    sensor = replaced(load(SensorFile, "daylight"), led=UNWIRED, surroundings=lamp)
    with Stage(sensor) as stage:
        stage.board.command("set mains_hz=0 exposure_us=1000")  # short samples show the flicker
        stage.press(NEAR_UM, 8_000)
        verdict = light_of(stage)[-1]
    assert not verdict.ok


@pytest.mark.board
@pytest.mark.parametrize("kind", ["default", "gpio", "always"])
def test_ambient_light_that_enters_at_a_press_is_not_the_leds(kind):
    with Stage(replaced(load(SensorFile, kind), led=UNWIRED)) as stage:
        stage.held.ambient_uW_cm2 = lambda *_: 75.0 if stage.held.press else 0.0
        stage.press(NEAR_UM, 8_000)
        *_, verdict = light_of(stage)
    assert not verdict.ok


@pytest.mark.board
def test_an_led_that_is_always_on_and_stays_lit_does_not_pass():
    with Stage(load(SensorFile, "always")) as stage:
        stage.press(NEAR_UM, 8_000)
        asked, verdict = [found for found in examine_board(stage.board) if found.check == "light"]
    assert "unplug the LED or cover the strip's end at the LED" in asked.text
    assert not verdict.ok
    assert "the LED's supply" in verdict.text


def test_an_led_that_is_always_on_needs_its_dark_frame_first():
    with Stage(load(SensorFile, "always")) as stage:
        stage.board.command("set gain=5")
        (verdict,) = light_of(stage)
    assert not verdict.ok
    assert "spots dark" in verdict.text


@pytest.mark.board
@pytest.mark.parametrize("kind", ["default", "gpio", "always"])
def test_a_calibrated_strip_with_any_led_passes_every_check(kind):
    sensor = load(SensorFile, kind)
    lines = calibrate(sensor)
    with Stage(sensor) as stage:
        stage.expose()
        upload(stage.board, list(lines))
        stage.press(NEAR_UM, 6_000)
        for finding in examine_board(stage.board):
            stage.held.unplugged |= "unplug the LED or" in finding.text
            assert finding.ok, finding
    assert finding.text == "a strip of 85 mm"


def test_a_press_that_comes_when_it_is_asked_for_passes():
    with Stage(load(SensorFile, "default")) as stage:
        found = []
        for finding in examine_board(stage.board):
            found.append(finding)
            if "press firmly" in finding.text:
                stage.press(NEAR_UM, 8_000)
    assert all(finding.ok for finding in found)
    assert [finding.check for finding in found].count("light") == 2


@pytest.mark.board
def test_a_light_too_dim_to_use_is_no_pass_and_names_what_to_do():
    with Stage(load(SensorFile, "default"), settings="gain=2 led_mA=4") as stage:
        stage.press(NEAR_UM, 8_000)
        verdict = light_of(stage)[-1]
    assert not verdict.ok
    assert "spots command autoexpose" in verdict.text


@pytest.mark.board
@pytest.mark.parametrize(
    ("exposure_us", "average", "ok"), [(10_000, 1, True), (2_000, 1, False), (2_000, 8, False)]
)
@pytest.mark.usefixtures("in_micropython")  # for `busy_us`
def test_a_board_that_is_asked_for_more_than_it_can_do(rig, exposure_us, average, ok):
    made = rig(busy_us=2_400.0)
    made.press(2.0, 8_000)
    made.board.command(f"set exposure_us={exposure_us} average={average}")
    made.settle(1.0)
    (rate,) = [found for found in examine_board(made.board) if found.check == "rate"]
    assert rate.ok is ok
    if not ok:
        assert "misses" in rate.text
        wanted_us = int(re.search(r"set exposure_us=(\d+)", rate.text)[1])
        made.board.command(f"set exposure_us={wanted_us}")
        made.settle(1.0)
        (rate,) = [found for found in examine_board(made.board) if found.check == "rate"]
        assert rate.ok


@pytest.mark.board
def test_a_fault_at_the_start_of_the_board_is_reported_until_it_is_saved():
    with Stage(load(SensorFile, "default")) as stage:
        stage.press(NEAR_UM, 8_000)
        assert "start" not in [found.check for found in examine_board(stage.board)]
        stage.board.info["boot"] = ["calibration-b.txt is damaged", "stored layout not used: 28"]
        (start,) = [found for found in examine_board(stage.board) if found.check == "start"]
    assert not start.ok
    assert "calibration-b.txt is damaged; stored layout not used: 28; next: " in start.text
    assert "'spots command save'" in start.text


@pytest.mark.board
def test_a_board_with_a_damaged_file_is_reported_by_every_view(tmp_path, capsys):
    stage(device_of("virtual"), tmp_path)
    with virtual_board(tmp_path) as port:
        assert main(["command", "--port", port, "set", "average=2"]) == 0
        assert main(["command", "--port", port, "save"]) == 0
    (saved,) = tmp_path.glob("settings-*.txt")
    saved.write_text("damaged\n")
    with virtual_board(tmp_path) as port:
        capsys.readouterr()
        assert main(["monitor", "--port", port, "--seconds", "0.2"]) == 0
        assert f"at its start, the board found: {saved.name}" in capsys.readouterr().err
        *_, start = islice(examine(port), 5)
        assert start.check == "start"
        assert saved.name in start.text
        reader = BoardReader(finder(port), layout("digits"), state := PageState(), 0.01)
        reader.start()
        try:
            number = state.begin()
            while not (shown := state.since(number)[1].get("board", {})).get("start"):
                time.sleep(0.01)
        finally:
            reader.stop()
        assert saved.name in shown["start"]
        assert main(["command", "--port", port, "save"]) == 0
        capsys.readouterr()
        assert main(["monitor", "--port", port, "--seconds", "0.2"]) == 0
        assert "at its start" not in capsys.readouterr().err


def test_replies_are_not_counted_as_readings():
    with Stage(load(SensorFile, "default")) as stage:
        stage.press(NEAR_UM, 8_000)
        (rate,) = [found for found in examine_board(stage.board) if found.check == "rate"]
    assert rate.text == "100.0 readings a second of 100.0 that exposure and average allow"


def fits_of(change, position_um=NEAR_UM, mark=None):
    """Return the findings of the checks of a press on a strip that has changed."""
    sensor = load(SensorFile, "default")
    with Stage(sensor) as stage:
        upload(stage.board, calibrate(sensor))
        stage.held.changed = change
        stage.press(position_um, 8_000)
        return list(examine_board(stage.board, mark))


@pytest.mark.board
@pytest.mark.parametrize(
    ("change", "words"),
    [
        (Change(), "the press fits the calibration"),
        (Change(temperature_K=3.0), "the press fits the calibration"),
        (Change(die_nm=1.0), "the blue light of the LED"),
        # No flag shows the noisy readings of these two.
        (Change(phosphor_nm=0.5), "wrong by 1.2 mm, the probable cause is the phosphor of the LED"),
        (Change(tilt_percent=-3.0), "the light at the glued ends"),
    ],
)
def test_a_strip_that_has_drifted_is_to_be_re_zeroed(change, words):
    (found,) = [finding for finding in fits_of(change) if finding.check == "fit"]
    assert found.ok is words.startswith("the press fits")
    assert words in found.text
    assert found.ok or "of the strip, run 'spots rezero'" in found.text


@pytest.mark.board
@pytest.mark.parametrize(("dye_percent", "ok"), [(0.0, True), (-5.0, False)])
def test_a_press_at_a_mark_shows_the_error_that_no_spectrum_shows(dye_percent, ok):
    *others, verdict = fits_of(Change(dye_percent=dye_percent), 40_000, 40.0)
    assert verdict.check == "mark"
    assert verdict.ok is ok
    assert all(finding.ok for finding in others)
    error_mm = float(re.search(r"([+-]\d.\d\d) mm", verdict.text)[1])
    assert error_mm == pytest.approx(0.0 if ok else -2.0, abs=0.1)
    assert ok or "spots rezero" in verdict.text


@pytest.mark.board
@pytest.mark.parametrize("mark", [-1.0, 86.0])
def test_a_mark_beside_the_strip_is_refused(mark):
    *_, verdict = fits_of(Change(), mark=mark)
    assert not verdict.ok
    assert "give a place from 0 to 85 mm" in verdict.text


@pytest.mark.board
def test_a_mark_that_nobody_presses_is_reported():
    sensor = load(SensorFile, "default")
    with Stage(sensor) as stage:
        upload(stage.board, calibrate(sensor))
        stage.press(NEAR_UM, 8_000)
        for verdict in examine_board(stage.board, 40.0):
            if verdict.check == "mark":
                stage.release()
    assert not verdict.ok
    assert "no press at 40 mm" in verdict.text


@pytest.mark.board
def test_monitor_ends_with_the_next_step_where_a_board_is_not_calibrated(tmp_path, capsys):
    stage(device_of("virtual"), tmp_path)
    with virtual_board(tmp_path) as port:
        assert main(["monitor", "--port", port, "--seconds", "0.5"]) == 0
    assert capsys.readouterr().err == "next: spots calibrate\n"


@pytest.mark.board
def test_monitor_has_no_next_step_for_a_calibrated_board(capsys):
    assert main(["monitor", "--port", "virtual", "--seconds", "0.5"]) == 0
    assert capsys.readouterr().err == ""


@pytest.mark.board
@pytest.mark.parametrize("chosen", [False, True])
def test_a_strip_that_no_finger_has_calibrated_is_told(chosen, capsys):
    sensor = load(SensorFile, "default")
    with Stage(sensor) as stage:
        upload(stage.board, marked(calibrate(sensor), INDENTER, chosen))
        stage.press(NEAR_UM, 8_000)
        found = [finding for finding in examine_board(stage.board) if finding.check == "presser"]
        watch(stage.board, 0.2, quiet=False)
    said = [] if chosen else ["calibrated with an indenter, not yet with a finger"]
    assert [text.split(";")[0] for _, _, text in found] == said
    assert [line.split(";")[0] for line in capsys.readouterr().err.splitlines()] == [
        f"spots: {one}" for one in said
    ]


@pytest.mark.board
@pytest.mark.parametrize(
    ("channel", "calibrated", "counts"),
    [(0, False, 0), (3, True, 0), (5, False, 65_535), (0, True, 65_535)],
)
def test_a_channel_that_is_dead_or_full_is_named(channel, calibrated, counts, monkeypatch):
    sensor = load(SensorFile, "default")
    lines = calibrate(sensor) if calibrated else ()
    convert = Converter.convert

    def stuck(converter, collected, gain_code, duration_us, full_scale):
        converted, overloaded = convert(converter, collected, gain_code, duration_us, full_scale)
        converted[channel] = min(counts, full_scale)
        return converted, overloaded

    with Stage(sensor) as stage:
        if lines:
            upload(stage.board, lines)
        monkeypatch.setattr(Converter, "convert", stuck)
        stage.press(NEAR_UM, 8_000)
        found = [f for f in examine_board(stage.board) if f.check == "channels"]
    name = stage.board.info["channels"][channel]
    assert [finding.ok for finding in found] == [False]
    assert f"channel {name} (ADC {channel})" in found[0].text
    assert ("no light" if counts == 0 else "full scale") in found[0].text
