"""A virtual board with the processor time of a Pico: its rates equal those of an emulated Pico."""

import re

import numpy as np
import pytest

from spots.deploy.doctor import examine_board
from spots.errors import SpotsError
from spots.link.connect import upload
from spots_device.reading.decode import DROPPED
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import Finger, ScenarioFile
from spots_sim.strip.scenario import Held, Scenario

pytestmark = pytest.mark.board

# Streamed touches of a calibrated, touched strip: exposure in us, readings in Hz, busy share.
MEASURED = {
    "pico": [(2_780, 359.8, 0.465), (1_000, 999.3, 1.0)],
    "pico-xip50": [(2_780, 359.7, 0.615), (1_000, 867.5, 1.0)],
}
CASES = [(name, *row) for name, rows in MEASURED.items() for row in rows]
SECONDS = 1.0
ONE, TWO = [(20.0, 3000)], [(20.0, 3000), (62.0, 3000)]
# Busy time of a sample in us at 5 ms: by commands and fingers (position in mm, force in mN), as
# tests/bench/board_costs.py measures it.
BUSY = [
    (["stream off"], ONE, 1066),
    (["stream touch"], ONE, 1300),
    (["stream touch spectrum"], ONE, 2026),
    (["stream touch contact"], [], 1658),
    (["stream touch contact"], ONE, 2502),
    (["stream touch contact"], TWO, 3455),
    (["stream touch", "set keys=1"], [], 1802),
    (["stream touch", "set keys=1"], ONE, 1903),
    (["stream touch", "set keys=1"], TWO, 2431),
    (["stream touch", "set average=2"], ONE, 1138),
]


def ready(rig, calibration, cpu, exposure_us):
    """Return a `Rig` with a touched strip that streams TOUCH frames."""
    made = rig(calibration=calibration, cpu=cpu)
    made.press(20.0, 3000)
    reply = made.board.command(f"set exposure_us={exposure_us}")
    upload(made.board, at_exposure(calibration, reply["exposure_us"]))
    made.board.command("stream touch")
    made.settle(0.5)
    return made


def at_exposure(calibration, exposure_us):
    lines = []
    for line in calibration:
        words = line.split()
        if words[0] == "made":
            words[2] = str(exposure_us)
        lines.append(" ".join(words))
    return lines


def touches(made, seconds=SECONDS):
    return list(made.board.touches(seconds))


@pytest.mark.parametrize(("cpu", "exposure_us", "rate_hz", "busy"), CASES)
def test_rate_and_busy_share_are_those_of_the_emulated_board(
    rig, calibration, cpu, exposure_us, rate_hz, busy
):
    made = ready(rig, calibration, cpu, exposure_us)
    clock = made.link.clock
    began_us, idle_us = clock.now_us(), clock.idle_us
    read = touches(made)
    elapsed_us = clock.now_us() - began_us
    assert 1e6 * len(read) / elapsed_us == pytest.approx(rate_hz, rel=0.15)
    if busy:  # measured
        assert 1 - (clock.idle_us - idle_us) / elapsed_us == pytest.approx(busy, rel=0.15)
    if rate_hz < 0.99e6 / exposure_us:
        assert any(touch.flags & DROPPED for touch in read)


@pytest.mark.parametrize(("commands", "fingers", "busy_us"), BUSY)
def test_the_busy_time_of_a_sample_is_that_of_the_emulated_board(
    rig, calibration, commands, fingers, busy_us
):
    points = [
        Finger(points=[(7 + 0.3 * n, at_mm, 0), (7.1 + 0.3 * n, at_mm, mN), (60, at_mm, mN)])
        for n, (at_mm, mN) in enumerate(fingers)
    ]
    scenario = Scenario(ScenarioFile(seconds=60, touch=points))
    made = rig(cpu="pico", scenario=scenario)
    reply = made.board.command("set exposure_us=5000")
    upload(made.board, at_exposure(calibration, reply["exposure_us"]))
    for command in commands:
        made.board.command(command)
    link, clock = made.link, made.link.clock
    assert clock.now_us() < 7e6
    link.sleep(max(0.0, 9.0 - link.now_s()) + 0.5)
    began_us, idle_us, samples = clock.now_us(), clock.idle_us, link.chip.samples
    link.sleep(1.0)
    busy = clock.now_us() - began_us - (clock.idle_us - idle_us)
    assert busy / (link.chip.samples - samples) == pytest.approx(busy_us, rel=0.15)


@pytest.mark.parametrize("cpu", MEASURED)
@pytest.mark.parametrize("exposure_us", [1_000])
def test_the_pauses_of_an_upload_leave_the_fifo_in_use(rig, calibration, cpu, exposure_us):
    made = ready(rig, calibration, cpu, exposure_us)
    assert made.board.command("get")["fifo"]


def test_hello_costs_no_sample(rig, calibration):
    made = ready(rig, calibration, "pico", 2_780)
    lost = []
    # Of the four commands from one ``get`` to the next, one collects garbage.
    for command in ("sync", "hello"):
        before = made.board.command("get")["missed"]
        for _ in range(3):
            made.board.command(command)
            made.settle(0.2)
        lost.append(made.board.command("get")["missed"] - before)
    assert lost == [0, 0]


@pytest.mark.usefixtures("in_micropython")  # for its garbage collection
@pytest.mark.parametrize("exposure_us", [1_000, 2_780])
def test_samples_that_commands_and_their_collections_cost_are_counted(
    rig, calibration, exposure_us
):
    made = ready(rig, calibration, "pico", exposure_us)

    def counted():
        missed = made.board.command("get")["missed"]
        return np.array([missed, made.board.stats.frames, made.link.chip.samples])

    commands = ["sync", "hello", "stream touch", "cal begin", *(f"cal {n}" for n in range(8))]
    before = counted()
    for command in commands:
        made.board.command(command)
        made.settle(0.05)
    missed, frames, samples = counted() - before
    if exposure_us == 1_000:
        assert missed > 8 * 22_100 / exposure_us
    else:
        # A collection may last a sample longer than the FIFO does: that depends on what is in the
        # heap, such as the digits of the calibration.
        assert missed <= 1
    # After an overflow, the time of the first sample is known to one exposure.
    overflows = len(commands) if exposure_us == 1_000 else 0
    assert missed + frames - len(commands) - 1 == pytest.approx(samples, abs=4 + overflows)


@pytest.mark.parametrize(("exposure_us", "ok"), [(1_500, True), (1_000, False)])
def test_doctor_recommends_an_exposure_that_the_slow_board_can_do(
    rig, calibration, exposure_us, ok
):
    made = ready(rig, calibration, "pico", exposure_us)
    (rate,) = [found for found in examine_board(made.board) if found.check == "rate"]
    assert rate.ok is ok
    if not ok:
        wanted_us = int(re.search(r"set exposure_us=(\d+)", rate.text)[1])
        made = ready(rig, calibration, "pico", wanted_us)
        before = made.board.command("get")["missed"]
        assert len(touches(made)) == pytest.approx(SECONDS * 1e6 / wanted_us, rel=0.02)
        assert made.board.command("get")["missed"] - before < 20


def test_both_runtimes_of_the_virtual_board_are_equally_slow(rig, calibration, monkeypatch):
    rates = []
    for runtime in ("micropython", "cpython"):
        monkeypatch.setenv("SPOTS_VIRTUAL_RUNTIME", runtime)
        made = ready(rig, calibration, "pico", 1_500)
        assert made.board.info["runtime"].startswith(runtime)
        rates.append(len(touches(made)))
    assert rates[0] == pytest.approx(rates[1], rel=0.02)


@pytest.mark.parametrize(
    ("cpu", "board", "why"),
    [("z80", "virtual", "use one of pico"), ("pico", "virtual_circuitpython", "MicroPython")],
)
def test_a_processor_that_is_unknown_is_refused(sensor, cpu, board, why):
    with pytest.raises(SpotsError, match=why):
        LockstepLink(sensor, Held(), cpu=cpu, board=board)
