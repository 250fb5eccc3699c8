"""The exposure for keys: the shortest at which every key is certain; one that a user set stays."""

import pytest

from spots.advice.key_exposure import sentence, shortest_us
from spots.deploy.doctor import examine_board
from spots.keyboard.keys import push
from spots.keyboard.layout import load
from spots.link.board import Board
from spots.link.connect import prepare
from spots_device.keys.layout import action, default_lines
from spots_device.usb.usages import KEYBOARD
from spots_sim.board.lockstep import LockstepLink
from spots_sim.person.stage import calibrate
from spots_sim.strip.files import SensorFile
from spots_sim.strip.files import load as load_file
from spots_sim.strip.scenario import Held


def row(count):
    bounds = [1000 * i // count for i in range(count + 1)]
    keys = [f"key {a} {b} {action(KEYBOARD, 4)} 0 0 0 0 0" for a, b in zip(bounds, bounds[1:])]
    return ["layer 0 0", *keys]


def test_narrower_keys_need_longer_exposures(calibration):
    found = [shortest_us(calibration, row(count)) for count in (5, 10, 14, 20, 28)]
    assert found[:2] == [4000, 4000]
    assert found == sorted(found)
    assert found[-1] > 2 * found[0]
    # The noise of the position is inversely proportional to the exposure.
    assert found[-1] == pytest.approx(found[-2] * 28 / 20, rel=0.1)


def test_no_exposure_suffices_for_keys_that_are_too_narrow(calibration):
    assert shortest_us(calibration, row(80)) is None


def test_a_layout_of_another_version_has_no_exposure(calibration):
    assert shortest_us(calibration, ["what 1"]) is None


def test_an_empty_layout_is_the_default_one(calibration):
    assert shortest_us(calibration, []) == shortest_us(calibration, default_lines())


def test_the_narrowest_key_counts(calibration):
    narrow = ["layer 0 0", *row(5)[1:-1], f"key 960 1000 {action(KEYBOARD, 4)} 0 0 0 0 0"]
    assert shortest_us(calibration, narrow) > shortest_us(calibration, row(5))


@pytest.mark.board
def test_a_calibration_holds_at_any_exposure(sensor, calibration):
    at_5_ms = calibrate(sensor, 5_000)
    layout = row(14)
    assert shortest_us(at_5_ms, layout) == pytest.approx(shortest_us(calibration, layout), rel=0.1)


@pytest.mark.board
def test_a_long_strip_needs_more(calibration):
    assert shortest_us(calibrate(load_file(SensorFile, "long_200mm")), row(10)) > 8000


@pytest.mark.parametrize(
    ("exposure_us", "chosen_us", "words"),
    [
        (4001, 4000, "4.0 ms, the shortest at which every key is certain"),
        (9999, 4000, "from 4.0 ms on every key is certain: 'set exposure_us=4000' types faster"),
        (2780, 4000, "too short: from 4.0 ms on every key is certain; send 'set exposure_us=4000'"),
        (9999, None, "at no exposure every key is certain; make the keys wider, or fewer"),
    ],
)
def test_the_sentence_names_the_exposure_to_set(exposure_us, chosen_us, words):
    assert words in sentence(exposure_us, chosen_us)


@pytest.fixture
def board(sensor, calibration):
    with Board(LockstepLink(sensor, Held())) as board:
        prepare(board, calibration)
        yield board


def exposure_us(board):
    return board.command("get")["exposure_us"]


@pytest.mark.board
def test_a_push_sets_and_stores_the_exposure(board):
    pushed = push(board, load("digits"), expose=True)
    assert "4.0 ms, the shortest" in pushed.exposure
    board.command("reboot")
    list(board.frames(1.0))
    assert exposure_us(board) == pytest.approx(4000, rel=0.01)
    push(board, load("numpad"), expose=True)
    assert exposure_us(board) == pytest.approx(4500, rel=0.01)


@pytest.mark.board
def test_an_exposure_that_the_user_has_set_stays(board):
    push(board, load("digits"), expose=True)
    board.command("set exposure_us=6000")
    pushed = push(board, load("mini"), expose=True)
    assert exposure_us(board) == pytest.approx(6000, rel=0.01)
    assert "6.0 ms; from 4.0 ms on every key is certain" in pushed.exposure


@pytest.mark.board
def test_lamps_still_determine_the_exposure(board):
    board.command("set mains_hz=50")
    pushed = push(board, load("digits"), expose=True)
    assert exposure_us(board) == 10_000
    assert pushed.exposure


@pytest.mark.board
def test_without_a_calibration_nothing_is_chosen(sensor):
    with Board(LockstepLink(sensor, Held())) as board:
        before = exposure_us(board)
        assert push(board, load("digits"), expose=True).exposure is None
        assert exposure_us(board) == before


@pytest.mark.board
@pytest.mark.parametrize(("set_us", "ok"), [(4_000, True), (2_780, False)])
def test_the_doctor_finds_an_exposure_that_is_too_short_for_the_keys(board, set_us, ok):
    push(board, load("digits"))
    board.command(f"set exposure_us={set_us}")
    (found,) = [finding for finding in examine_board(board) if finding.check == "keys"]
    assert found.ok == ok
    assert "every key is certain" in found.text


@pytest.mark.board
def test_the_doctor_says_nothing_about_keys_that_are_off(board):
    assert "keys" not in [finding.check for finding in examine_board(board)]
