"""All forms of the firmware send the same frames for the same recorded samples.

The samples are those of touches on the simulated strip, 20 samples a touch, with the noise of the
sensor, rollovers, and ambient light that changes. CPython, MicroPython and machine code process
them; the frames contain readings, fingers and keys. A longer comparison, of 100,000 touches:
``SPOTS_REPLAY=2000000 make test ARGS=tests/micropython/test_vm_replay.py``.
"""

import os

import numpy as np
import pytest

from spots_sim.measure.bound import Bound

pytestmark = pytest.mark.board

SAMPLES = int(os.environ.get("SPOTS_REPLAY", "5000"))
PER_TOUCH = 20
LINES = 20
PLAN = ("F3", "F4", "F5", "F6", "F7", "F8")
# Kinds of frames and settings, one after another.
PARTS = [
    ["touch"],
    ["touch", "contact", "keys=1"],
    ["touch", "contact", "spectrum", "average=2"],
    ["touch", "contact", "average=1", "dark_every=50"],
    ["touch", "keys=0", "gamepad=1"],
]


def recorded(sensor, samples):
    """Return uint16: for each sample six counts with the LED on, and six with the LED off."""
    rng = np.random.default_rng(40)
    bound = Bound(sensor, PLAN, 9, 10_000, 20)
    places_um = np.linspace(1000, 1000 * sensor.length_mm - 1000, 60)
    forces_mN = np.geomspace(400, 5000, 8)
    lights = np.array([[bound.counts(x_um, f_mN) for f_mN in forces_mN] for x_um in places_um])
    touches = samples // PER_TOUCH + 2
    of_touch = lights[rng.integers(0, 60, touches), rng.integers(0, 8, touches)]
    press = np.array([0.4, *[1.0] * 9, 0.5, *[0.0] * 9])
    presses = np.where(rng.random(touches)[:, None] < 0.1, 1.0, press)  # some fingers do not lift
    light = (of_touch[:, None, :] * presses[:, :, None]).reshape(-1, 6)
    early = np.repeat(rng.random(touches) < 0.15, PER_TOUCH)[:-12]
    light[:-12][early] += light[12:][early]  # the next finger touches before the present one lifts
    lamp = rng.choice((0.0, 0.0, 0.0, 30.0), touches // 50 + 1)
    dark = np.repeat(4 + lamp, 50 * PER_TOUCH)[: len(light), None] * np.ones(6)
    light += dark
    light[rng.random(len(light)) < 1e-3] *= 40  # saturation
    mean = np.hstack([light, dark])
    counts = rng.normal(mean, np.sqrt(0.1 + mean / 50))  # noise of converter and light
    return np.clip(np.rint(counts), 0, 65_535).astype("<u2")[:samples]


@pytest.fixture(scope="module")
def given(calibration):
    own = ["board 00" if line.startswith("board") else line for line in calibration]
    every = SAMPLES // LINES
    return {"calibration": own, "settings": PARTS, "samples": SAMPLES, "every": every}


@pytest.fixture(scope="module")
def replay(sensor, given):
    samples = recorded(sensor, SAMPLES).tobytes()

    def replay(machine):
        (machine.folder / "samples.bin").write_bytes(samples)
        machine.timeout_s = max(60, SAMPLES // 100)
        return machine.run("replay", given)

    return replay


@pytest.fixture(scope="module")
def expected(cpython, replay):
    return replay(cpython)


def test_the_recorded_samples_are_the_same_frames(machine, replay, expected):
    assert replay(machine) == expected


def test_each_part_of_the_recording_has_frames(expected):
    frames = [int(line.split()[0]) for line in expected]
    assert len(frames) == LINES
    assert np.diff(frames).min() > 0.5 * SAMPLES / LINES
