"""A drift that no flag shows is advised within some presses; a strip without drift never is."""

import numpy as np
import pytest
from msgspec.structs import replace

from spots.advice.advice import Advice, advice_for
from spots.advice.notice import PRESSES_A_WEEK, Cusum, Floor, notice_for
from spots.advice.run_length import MOST, run_length, threshold
from spots.common.press_spectra import PressSpectra, press_spectra
from spots.keyboard.keyboard import type_on
from spots.keyboard.layout import load as load_layout
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.frames import Spectrum, Touch
from spots.link.stored import stored_calibration
from spots.outputs.devices import PrintedKeyboard
from spots_device.board.settings import checksum
from spots_device.reading.decode import DARK_SUBTRACTED, LED_OFF, MISFIT, TOO_DARK, TOUCHING
from spots_sim.board.lockstep import LockstepLink
from spots_sim.measure.bound import Bound
from spots_sim.measure.rezeroed import recalibrated
from spots_sim.strip.change import NAMES, Change
from spots_sim.strip.files import Ambient, ChangeInTime, Finger, ScenarioFile, load
from spots_sim.strip.scenario import Scenario

START_S, PERIOD_S, HELD_S = 3.0, 0.6, 0.3
PRESSES = 20
READINGS = 12  # of a simulated press of `readings`


def pressed(sensor, change, force_mN=6000, seed=7, presses=PRESSES):
    """Return a board whose strip is pressed at random places, and the time of the last press."""
    rng = np.random.default_rng(seed)
    fingers = []
    for i in range(presses):
        x_mm = float(rng.uniform(0.06, 0.94)) * sensor.length_mm
        steps = ((0, 0), (0.02, force_mN), (HELD_S - 0.02, force_mN), (HELD_S, 0))
        begin_s = START_S + PERIOD_S * i
        fingers.append(Finger(points=[(begin_s + after_s, x_mm, mN) for after_s, mN in steps]))
    drift = ChangeInTime(**{name: [(0.0, change[name])] for name in NAMES if name in change})
    end_s = START_S + PERIOD_S * presses
    file = ScenarioFile(seconds=end_s + 1, touch=fingers, change=drift)
    return Board(LockstepLink(sensor, Scenario(file), seed=seed)), end_s


def advised(sensor, lines, change, **more):
    """Return the advice, and the number of presses before it; presses are the last if none came."""
    board, end_s = pressed(sensor, change, **more)
    with board:
        prepare(board, lines)
        advice = advice_for(board, board.info)
        board.stream("touch", "spectrum")
        for frame in board.frames(end_s - board.now_s()):
            advice.take(frame, board.now_s())
            if advice.sentence:
                break
    return advice.sentence, advice.notice.presses


# Position errors of 1 to 3 mm on the default strip.
DRIFTS = {
    "die": {"die_nm": -1.2},
    "phosphor redder": {"phosphor_nm": 0.42},
    "phosphor bluer": {"phosphor_nm": -0.8},
    "more blue": {"blue_share_percent": 2.0},
    "filters": {"bands_nm": 0.9},
    "warm": {"temperature_K": 25.0},
    "tilt": {"tilt_percent": 3.2},
    "mixed": {
        "die_nm": 0.5,
        "phosphor_nm": 0.5,
        "blue_share_percent": 1.0,
        "bands_nm": 0.15,
        "tilt_percent": 0.25,
        "dye_percent": -2.5,
    },
}


@pytest.mark.board
@pytest.mark.parametrize("name", DRIFTS)
@pytest.mark.parametrize("force_mN", [1500, 6000])
def test_each_drift_of_a_millimetre_is_advised(sensor, calibration, name, force_mN):
    sentence, presses = advised(sensor, calibration, DRIFTS[name], force_mN=force_mN)
    assert "a re-zero is advised: spots rezero" in sentence
    assert presses < PRESSES


@pytest.mark.board
@pytest.mark.parametrize(
    "change", [{}, {"temperature_K": 4.0}, {"light_percent": -20.0}, {"dye_percent": -3.0}]
)
@pytest.mark.parametrize("force_mN", [800, 6000])
def test_nothing_is_advised_without_an_error_that_spectra_show(
    sensor, calibration, change, force_mN
):
    sentence, presses = advised(sensor, calibration, change, force_mN=force_mN)
    assert sentence == ""
    assert presses >= PRESSES - 2  # noise may look like a second finger


@pytest.mark.board
def test_a_re_zero_ends_the_advice(sensor):
    change = {"phosphor_nm": 0.8}
    lines = recalibrated(replace(sensor, change=Change(**change)))
    assert advised(sensor, lines, change)[0] == ""


@pytest.mark.board
def test_the_estimate_is_the_error_of_the_position(sensor, calibration):
    board, end_s = pressed(sensor, {"phosphor_nm": 0.42})
    with board:
        prepare(board, calibration)
        notice = notice_for(board.calibration, board.info)
        board.stream("touch", "spectrum")
        for frame in board.frames(end_s - board.now_s()):
            notice.take(frame)
    assert notice.error_um[-1] == pytest.approx(1000, abs=150)
    assert "positions are probably wrong by 1.0 mm" in notice.sentence
    assert "the phosphor of the LED" in notice.sentence


@pytest.mark.board
def test_an_application_prints_the_advice(sensor, calibration, capsys):
    board, end_s = pressed(sensor, {"phosphor_nm": -0.42}, presses=8)
    with board:
        prepare(board, calibration)
        board.calibration = None  # the application was not started by the session
        type_on(board, load_layout("digits"), PrintedKeyboard(), end_s - board.now_s())
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "positions are probably wrong by 1.0 mm" in said


@pytest.mark.parametrize(("shift", "high"), [(0.6, 3.0), (1.0, 4.0), (2.0, 3.0)])
def test_the_computed_run_length_is_the_simulated_one(shift, high):
    rng, tests = np.random.default_rng(5), 2000
    sums, lasted, going = np.zeros(tests), np.zeros(tests), np.ones(tests, bool)
    while going.any():
        steps = shift * rng.standard_normal(tests) - shift**2 / 2
        sums = np.maximum(0.0, sums + np.minimum(steps, MOST * high))
        lasted += going
        going &= sums <= high
    assert lasted.mean() == pytest.approx(run_length(shift, high), rel=0.1)


@pytest.mark.parametrize("shift", [0.5, 1.0, 3.0, 6.0])
def test_the_threshold_gives_the_wanted_run_length(shift):
    high = threshold(shift, PRESSES_A_WEEK)
    found = run_length(shift, high)
    assert found == pytest.approx(PRESSES_A_WEEK, rel=0.2) if shift < 4 else found > PRESSES_A_WEEK


def readings(sensor, spectra, board, force_mN, rng):
    """Yield frames of faint presses, and of the untouched strip between them, without end."""
    made = Bound(sensor, spectra.plan, board["gain"], board["exposure_us"], board["led_mA"])
    low_um, high_um = spectra.ends_um
    places_um = np.linspace(low_um, high_um, 12)[1:-1]
    light = [made.counts(x_um, force_mN) for x_um in places_um]
    variance = sensor.converter.read_noise_counts**2
    t_us = 0

    def frames(net, x_um):
        nonlocal t_us
        t_us = (t_us + 10_000) % (1 << 32)
        sigma = np.sqrt(variance + net / made._electrons)
        counts = np.maximum(np.floor(net + sigma * rng.standard_normal(6) + 0.5), 0)
        flags = DARK_SUBTRACTED | (TOUCHING if x_um else TOO_DARK)
        yield Touch(0, 0, t_us, flags, 0, 0, x_um, force_mN if x_um else 0.0, 0.0)
        yield Spectrum(0, 0, t_us, flags, board["gain"], tuple(counts.astype(int).tolist()))

    while True:
        at = rng.integers(len(places_um))
        for _ in range(2 if t_us > 2_000_000 else 100):
            yield from frames(np.zeros(6), 0.0)
        for _ in range(READINGS):
            yield from frames(light[at], float(places_um[at]))


@pytest.mark.parametrize("seed", [11])
def test_false_alarms_come_as_often_as_computed(sensor, calibration, seed):
    # Presses so faint that their noise exceeds all other errors, one every six seconds. The
    # threshold is set to one false alarm an hour; four hours must have some, but not many.
    an_hour, hours = 600, 4
    spectra = press_spectra(calibration)
    info = {"gain": 9, "exposure_us": 10_000, "led_mA": 20, "average": 1}
    notice = notice_for(calibration, info, presses=an_hour)
    alarms = 0
    for frame in readings(sensor, spectra, info, 500.0, np.random.default_rng(seed)):
        notice.take(frame)
        if notice.wrong:
            alarms += 1
            notice.wrong, notice._test = False, Cusum(500.0, 2 * an_hour)
        if notice.presses >= hours * an_hour:
            break
    assert 1 <= alarms <= 8


def test_moving_light_is_the_advice_not_a_re_zero():
    advice, rng = Advice(), np.random.default_rng(1)
    for i in range(1000):
        touching = i > 600
        flags = TOUCHING | MISFIT if touching else 0
        light = 60 + 40 * np.sin(i / 15)
        counts = (light + rng.standard_normal(6)).astype(int)
        advice.take(Touch(0, 0, i, flags, 0, 0, 4e4, 3000.0 * touching, 0.0), 0.01 * i)
        advice.take(Spectrum(0, 0, i, flags, 9, tuple(counts.tolist())), 0.01 * i)
    assert "the ambient light changes; next: shade the strip" in advice.sentence
    assert "rezero" not in advice.sentence


@pytest.mark.parametrize("dark_moves", [False, True])
def test_light_that_only_the_lit_strip_shows_is_contact_that_sticks(dark_moves):
    floor = Floor()
    for i in range(2000):
        moves = 30 + 25 * np.sin(i / 15)
        unlit = i % 20 < 3
        flags = (LED_OFF if i % 20 < 2 else LED_OFF | DARK_SUBTRACTED) if unlit else DARK_SUBTRACTED
        floor.follow(Touch(0, 0, i, flags, 0, 0, 0.0, 0.0, 0.0))
        counts = moves if not unlit or dark_moves or not i % 20 else 5
        floor.follow(Spectrum(0, 0, i, flags, 9, (int(counts),) * 6))
    assert floor.changes.sum() > 60
    assert floor.moving is dark_moves


@pytest.mark.board
@pytest.mark.parametrize("light_uW_cm2", [3.0, 20.0])
def test_nothing_is_re_zeroed_under_moving_leaves(sensor, calibration, light_uW_cm2):
    leaves = Ambient(steps=[(0.0, light_uW_cm2)], leaves_percent=80.0)
    said = set()
    scenario = Scenario(replace(load(ScenarioFile, "worn"), ambient=leaves))
    with Board(LockstepLink(sensor, scenario, seed=3)) as board:
        prepare(board, calibration)
        advice = advice_for(board, board.info)
        board.stream("touch", "spectrum")
        for frame in board.frames(60 - board.now_s()):
            advice.take(frame, board.now_s())
            said.add(advice.sentence)
    # The board follows the light, so there may be no advice at all.
    assert all("the ambient light changes" in one for one in said if one)


@pytest.mark.board
def test_a_host_reads_the_calibration_from_the_board(sensor, calibration):
    board, _ = pressed(sensor, {})
    with board:
        assert stored_calibration(board, board.command("hello")) is None
        prepare(board, calibration)
        board.calibration = None
        info = board.command("hello")
        assert stored_calibration(board, info) == list(calibration)
        replies = [board.command("cal lines"), board.command("cal lines 9999")]
        assert [reply["of"] for reply in replies] == [len(calibration)] * 2
        assert replies[1]["lines"] == []
        assert stored_calibration(board, {**info, "calibration": checksum(["other"])}) is None


@pytest.mark.board
def test_a_calibration_without_spectra_is_used_without_them(sensor, calibration):
    lines = [line for line in calibration if not line.startswith("spectrum")]
    assert press_spectra(lines) is None
    assert notice_for(lines, {"strain_ppm": 0}) is None
    assert notice_for(calibration, {"strain_ppm": 20_000}) is None
    assert notice_for(None, {}) is None
    board, _ = pressed(sensor, {"phosphor_nm": 0.42}, presses=4)
    with board:
        prepare(board, lines)
        assert advice_for(board, board.info).notice is None


def test_the_spectra_are_those_of_the_presses(sensor, calibration):
    spectra = PressSpectra(calibration)
    info = {"gain": 9, "exposure_us": 10_000, "led_mA": 20}
    made = Bound(sensor, spectra.plan, **info)
    for x_um in (9_000.0, 42_000.0, 77_000.0):
        logs = np.log2(made.counts(x_um, 6000.0)) - spectra.logs(x_um)
        assert np.ptp(logs) < 2e-3
        ahead, back = spectra.logs(x_um + 50), spectra.logs(x_um - 50)
        assert spectra.slopes(x_um) == pytest.approx((ahead - back) / 100, rel=1e-3)
