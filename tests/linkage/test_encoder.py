"""A strip as a joint encoder: angle, velocity from the board's times, standard error, backlash."""

from __future__ import annotations

import math

import msgspec
import numpy as np
import pytest
from support.joints import JOINT, PERIOD_S, touch
from support.refusals import refusal

from spots.calibrate.session.joint import fit_joint
from spots.errors import CalibrationError, SettingError
from spots_device.reading import decode
from spots_linkage import Encoder
from spots_sim.measure.simulated_linkage import Turned


def played(joint, angles_deg, noise_deg=0.0, seed=0, encoder=None, **options):
    """Turn a joint with backlash through angles; return the results of `Encoder.take`.

    Parameters
    ----------
    joint : Joint
        Joint with its backlash.
    angles_deg : sequence of float
        Angles, one for each reading.
    noise_deg : float
        Standard deviation of the measured angles.
    seed : int
        Random seed of the noise.
    encoder : Encoder, optional
        Encoder to use instead of a new one.
    options
        Options of `touch`, for each reading.
    """
    rng = np.random.default_rng(seed)
    encoder = encoder or Encoder(joint)
    at, half = angles_deg[0], joint.backlash_deg / 2
    told = []
    for i, angle in enumerate(angles_deg):
        at = min(max(at, angle - half), angle + half)
        seen_deg = at + noise_deg * rng.standard_normal()
        told.append(encoder.take(touch((seen_deg + 20) / 0.002, i, **options)))
    return told


def test_the_angle_is_the_line_of_the_calibration():
    angle = Encoder(JOINT).take(touch(30_000))
    assert angle.angle_rad == pytest.approx(math.radians(40))
    turned = Encoder(JOINT, offset_rad=1.0, gain=-1.0).take(touch(30_000))
    assert turned.angle_rad == pytest.approx(1.0 - math.radians(40))
    assert turned.sigma_rad == pytest.approx(angle.sigma_rad) == pytest.approx(math.radians(0.03))


@pytest.mark.parametrize(
    "flags", [0, decode.TOUCHING | decode.SATURATED, decode.TOUCHING | decode.NOT_CALIBRATED]
)
def test_a_reading_that_is_not_to_be_trusted_is_no_angle(flags):
    assert Encoder(JOINT).take(touch(30_000, flags=flags)) is None


@pytest.mark.parametrize("start_us", [0, 2**32 - 200_000])
def test_the_speed_is_by_the_boards_clock(start_us):
    # The jitter of the host's times and the wrap of the board's times have no effect on the speed.
    encoder, first_s = Encoder(JOINT), math.inf
    for i in range(20):
        jitter_s = 0.01 * (-1) ** i
        now = touch(
            (20 + 1.5 * i + 20) / 0.002, i, time_s=i * PERIOD_S + jitter_s, start_us=start_us
        )
        angle = encoder.take(now)
        assert angle.time_s == now.time_s
        if i < 2:
            assert angle.velocity_rad_s is None
        else:
            assert angle.velocity_rad_s == pytest.approx(math.radians(50), rel=1e-3)
        first_s = min(first_s, angle.device_s)
    assert angle.device_s - first_s == pytest.approx(19 * PERIOD_S, abs=2e-6)
    unmapped = encoder.take(touch(60_000, 20, start_us=start_us))
    assert unmapped.time_s == unmapped.device_s


def test_a_board_that_restarts_makes_no_speed():
    encoder = Encoder(JOINT)
    for i in range(8):
        encoder.take(touch(30_000 + 100 * i, i, start_us=5_000_000))
    assert encoder.take(touch(90_000, 0)).velocity_rad_s is None


@pytest.mark.board
def test_the_speeds_error_is_that_of_its_scatter():
    still = played(JOINT, np.full(4000, 10.0), noise_deg=0.03)[20:]
    speeds = np.array([angle.velocity_rad_s for angle in still])
    sigmas = np.array([angle.velocity_sigma_rad_s for angle in still])
    assert speeds.std() == pytest.approx(sigmas.mean(), rel=0.1)
    fast = played(JOINT, 5.0 * np.arange(20), noise_deg=0.03)[-1]
    assert fast.velocity_sigma_rad_s > 4 * sigmas.mean()  # computed from 3 readings, not from 8
    angles = np.array([angle.angle_rad for angle in still])
    assert angles.std() == pytest.approx(np.mean([a.sigma_rad for a in still]), rel=0.05)


def test_the_noise_is_that_of_the_place():
    joint = msgspec.structs.replace(JOINT, low=(10_000.0, 0.02), high=(70_000.0, 0.08))
    sigma_deg = [
        math.degrees(Encoder(joint).take(touch(um)).sigma_rad)
        for um in (9_000, 10_000, 40_000, 70_000, 72_000)
    ]
    assert sigma_deg == pytest.approx([0.02, 0.02, 0.04, 0.08, 0.08], rel=1e-6)
    within = [Encoder(joint).take(touch(um)).within for um in (0, 9_000, 40_000, 75_000)]
    assert within == [False, True, True, False]


PLAY = msgspec.structs.replace(JOINT, backlash_deg=0.5, accuracy_deg=0.2)


@pytest.mark.parametrize("step_deg", [2.0, 0.05, 0.01])
def test_the_play_is_taken_out_in_both_directions(step_deg):
    steps = int(max(6, 30 * step_deg) / step_deg)
    up = 10 + step_deg * np.arange(steps)
    truth = np.concatenate([up, up[::-1], up])
    told = played(PLAY, truth, noise_deg=0.03)
    error = np.degrees([angle.angle_rad for angle in told]) - truth
    # Not checked are the angles while the joint crosses its backlash, or moves less than the noise.
    taking_deg = 0.5 + 8 * step_deg + 0.4
    turn = np.abs(np.arange(3 * steps)[:, None] - np.array([0, steps, 2 * steps])).min(axis=1)
    known = turn * step_deg > taking_deg
    known &= np.arange(3 * steps) % steps * step_deg > taking_deg
    assert known.any()
    assert abs(error[known]).max() < 5 * 0.03
    ways = np.array([angle.direction for angle in told])
    expected = np.repeat([1, -1, 1], steps)
    assert (ways[known] == expected[known]).all()


def test_at_rest_the_play_is_in_the_error_and_moving_it_is_not():
    up = list(np.arange(0, 20, 1.0))
    told = played(PLAY, np.array(up + [19.0] * 40), noise_deg=0.01)
    play_rad = math.radians(0.5) / math.sqrt(12)
    moving, resting = told[18], told[-1]
    assert moving.direction == resting.direction == 1
    rest = resting.sigma_rad**2 - moving.sigma_rad**2
    assert math.sqrt(rest) == pytest.approx(play_rad, rel=1e-6)
    assert resting.systematic_rad >= play_rad
    unknown = played(PLAY, np.array([5.0]))[0]
    assert unknown.direction == 0
    assert unknown.angle_rad == pytest.approx(math.radians(5), abs=1e-4)


@pytest.mark.board
def test_noise_alone_is_hardly_ever_a_movement():
    told = played(PLAY, np.full(20_000, 10.0), noise_deg=0.03)
    turns = np.count_nonzero(np.diff([angle.direction for angle in told]))
    assert turns < 20


def test_a_turned_around_encoder_turns_its_direction():
    encoder = Encoder(PLAY, gain=-1.0)
    told = played(PLAY, np.arange(0.0, 10.0), encoder=encoder)[-1]
    assert told.direction == -1
    assert told.velocity_rad_s < 0
    assert told.angle_rad == pytest.approx(-math.radians(9), abs=1e-4)


def test_what_a_joint_leaves_of_its_line_does_not_average_out():
    joint = msgspec.structs.replace(JOINT, accuracy_deg=0.05)
    angle = Encoder(joint).take(touch(30_000))
    assert math.degrees(angle.systematic_rad) == pytest.approx(0.05 * math.sqrt(math.pi / 2))
    assert angle.sigma_rad == pytest.approx(math.hypot(angle.systematic_rad, math.radians(0.03)))


def test_a_joints_fit_knows_the_noise_at_both_ends():
    rng = np.random.default_rng(3)
    points = []
    for way in (1, -1):
        for angle in np.linspace(0, 120, 11)[::way]:
            um = (angle + 20 - way * 0.1) / 0.002
            sigma_um = 10 * math.exp((um - 10_000) / 40_000) * rng.uniform(0.9, 1.1)
            points.append(Turned(float(angle), way, um, sigma_um, None))
    joint = fit_joint(points)
    assert joint.backlash_deg == pytest.approx(0.2, abs=1e-3)
    assert joint.low[0] == pytest.approx(9_950, abs=1)
    assert joint.high[0] == pytest.approx(70_050, abs=1)
    assert joint.low[1] == pytest.approx(0.02, rel=0.08)
    assert joint.high[1] == pytest.approx(0.02 * math.exp(1.5), rel=0.08)


def test_an_invalid_encoder_is_refused():
    with refusal(CalibrationError):
        Encoder(None)
    with refusal(SettingError):
        Encoder(JOINT, gain=0.0)
    with refusal(SettingError):
        Encoder(JOINT, offset_rad=math.nan)
