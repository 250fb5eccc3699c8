"""The simulated typist, and the score of typing."""

import json

import numpy as np
import pytest

from spots.keyboard.layout import load
from spots_sim.demo.demo import demo
from spots_sim.demo.typing_speed import interval_percent
from spots_sim.measure.typing_errors import CAUSES
from spots_sim.measure.typing_score import TypingScore
from spots_sim.person.hands import HANDS
from spots_sim.person.typist import fast_typing, two_fingers
from spots_sim.strip.files import Finger, ScenarioFile
from spots_sim.strip.scenario import Scenario

DIGITS = load("digits")
LENGTH_MM = 85.0
ONE, TWO, THREE, NINE = 30, 31, 32, 38
TOGETHER, THREE_AT_ONCE, NEAR, SHORT, SECOND, FIRST, ALONE, TWICE, LATE = CAUSES


def at(began_s, usage, held_s=0.1):
    x_mm = 8.5 * (usage - ONE + 0.5)
    return Finger(
        points=[(began_s, x_mm, 0), (began_s + 0.01, x_mm, 2e3), (began_s + held_s, 5, 0)]
    )


def scored(*presses, fingers, to_s=9.5):
    """Return the typing score of key presses while `fingers` touch, up to the time `to_s`.

    A press is (time in s, usage): the key is released after 50 ms. With (time, usage, None) it
    stays pressed.
    """
    score = TypingScore(ScenarioFile(seconds=10, touch=fingers), DIGITS, LENGTH_MM, 0.5)
    for time_s, usage, *held_s in presses:
        score.key(7, usage, True, time_s)
        if held_s != [None]:
            score.key(7, usage, False, time_s + 0.05)
    return score.summary(to_s)


def counts(figures):
    return {name: n for name, n in figures.items() if name != "latency_ms" and n}


def test_a_key_belongs_to_the_finger_whose_key_and_time_fit():
    fingers = [at(1.0, ONE), at(1.06, THREE), at(2.0, ONE)]
    figures = scored((1.02, ONE), (1.27, THREE), (2.03, ONE), fingers=fingers)
    assert counts(figures) == {"touches": 3, "right": 3}
    assert figures["latency_ms"] == {"p50": 30.0, "p90": 174.0, "p99": 206.4}


def test_a_key_between_two_fingers_is_wrong_and_of_no_finger():
    figures = scored((1.02, ONE), (1.1, TWO), fingers=[at(1.0, ONE), at(1.06, THREE)])
    assert counts(figures) == {
        "touches": 2, "right": 1, "wrong": 1, "no_finger": 1, "causes": {SECOND: 1}
    }  # fmt: skip


def test_a_key_twice_is_extra_and_of_a_finger():
    figures = scored((1.02, ONE), (1.1, ONE), fingers=[at(1.0, ONE)])
    assert counts(figures) == {"touches": 1, "right": 1, "extra": 1, "causes": {TWICE: 1}}


def test_a_key_too_late_is_missed_and_extra():
    figures = scored((1.23, ONE), fingers=[at(1.0, ONE)])
    assert counts(figures) == {
        "touches": 1, "missed": 1, "extra": 1, "no_finger": 1, "causes": {ALONE: 1, LATE: 1}
    }  # fmt: skip


def test_an_error_is_counted_in_the_first_circumstance_that_applies():
    alone = [at(4.0, ONE)]
    for causes, *fingers in (
        ({TOGETHER: 2}, at(1.0, ONE), at(1.01, NINE)),
        ({FIRST: 1, SECOND: 1}, at(1.0, ONE), at(1.02, NINE)),
        ({NEAR: 2}, at(1.0, ONE), at(1.02, TWO)),
        ({SHORT: 1, FIRST: 1}, at(1.0, ONE), at(1.02, NINE, 0.04)),
        ({THREE_AT_ONCE: 3}, at(1.0, ONE), at(1.02, THREE), at(1.04, NINE)),
        # The first and the third one do not touch together, so three never do.
        ({FIRST: 1, SECOND: 2}, at(1.0, ONE), at(1.08, NINE), at(1.12, ONE)),
    ):
        figures = scored(fingers=[*fingers, *alone])
        assert figures["causes"] == {**causes, ALONE: 1}
        assert sum(figures["causes"].values()) == figures["missed"]


def test_a_key_that_stays_down_is_stuck():
    assert scored((1.02, ONE, None), fingers=[at(1.0, ONE)])["stuck"] == 1
    assert scored((1.02, ONE, None), fingers=[at(1.0, ONE)], to_s=1.3)["stuck"] == 0


def overlaps(file):
    """Return the shares of touches that begin while the last one, or the last two, touch."""
    times = [(touch.points[0][0], touch.points[-1][0]) for touch in file.touch]
    two = [b[0] < a[1] for a, b in zip(times, times[1:])]
    three = [c[0] < min(a[1], b[1]) for a, b, c in zip(times, times[1:], times[2:])]
    return np.mean(two), np.mean(three)


# Shares in the data: 10, 20, 31, 44 % of the touches overlap the next one.
@pytest.mark.parametrize(
    ("words_per_min", "overlap"), [(40, 0.10), (60, 0.22), (80, 0.31), (100, 0.42)]
)
def test_touches_overlap_as_those_of_people(words_per_min, overlap):
    file = fast_typing(DIGITS, words_per_min, 2000, LENGTH_MM, seed=1)
    assert overlaps(file)[0] == pytest.approx(overlap, abs=0.03)
    assert 12 * 2000 / (file.seconds - 3) == pytest.approx(words_per_min, rel=0.05)


@pytest.mark.board
def test_people_differ_as_those_in_the_data():
    files = [fast_typing(DIGITS, None, 2000, LENGTH_MM, seed=person) for person in range(10)]
    shares = [overlaps(file) for file in files]
    of_data = [0.32, 0.22, 0.06, 0.44, 0.03, 0.23, 0.04, 0.09, 0.28, 0.04]
    assert [two for two, _ in shares] == pytest.approx(of_data, abs=0.06)
    assert max(three for _, three in shares) > 0.02
    held_s = [[touch.points[-1][0] - touch.points[0][0] for touch in f.touch] for f in files]
    assert 0.05 < np.mean(np.concatenate(held_s) < 0.06) < 0.11  # 8 % in the data
    begins_s = [np.diff([touch.points[0][0] for touch in f.touch]) for f in files]
    assert 0.003 < np.mean(np.concatenate(begins_s) < 0.03) < 0.01  # 0.4 % in the data


def test_two_fingers_are_not_at_the_same_place():
    for hands in HANDS.values():
        file = fast_typing(DIGITS, 100, 300, LENGTH_MM, seed=2, hands=hands)
        for i, one in enumerate(file.touch):
            for other in file.touch[max(i - 6, 0) : i]:
                if other.points[-1][0] > one.points[0][0]:
                    apart_mm = abs(other.points[0][1] - one.points[0][1])
                    assert apart_mm > hands.apart_mm - 1  # the other one may have rolled


def test_a_palm_rests_at_the_end_while_the_fingers_type():
    file = fast_typing(DIGITS, 60, 100, LENGTH_MM, seed=1, hands=HANDS["wobbling-palm"])
    palm, *fingers = file.touch
    assert palm.points[0][0] < min(finger.points[0][0] for finger in fingers)
    assert palm.points[-1][0] > max(finger.points[-1][0] for finger in fingers)
    assert max(finger.points[0][1] for finger in fingers) < palm.points[0][1] - palm.width_mm / 2


def test_a_finger_rolls_slides_and_trembles_as_its_keys_describe():
    points = [(1.0, 20.0, 0.0), (1.1, 20.0, 2000.0), (1.9, 20.0, 2000.0), (2.0, 20.0, 0.0)]
    finger = Finger(points=points, roll_mm=2.0, slide_mm=-4.0, tremor_percent=20.0)
    scenario = Scenario(ScenarioFile(seconds=3, touch=[finger]))
    places = [scenario.presses(time_s)[0].position_mm for time_s in (1.05, 1.5, 1.9, 1.95)]
    assert places == pytest.approx([20.1, 21.0, 21.8, 19.9])
    forces = [scenario.presses(time_s)[0].force_mN for time_s in np.linspace(1.1, 1.9, 200)]
    assert (min(forces), max(forces)) == pytest.approx((1600, 2400), rel=0.01)


@pytest.mark.parametrize("name", HANDS)
def test_hands_move_fingers_as_documented(name):
    hands = HANDS[name]
    file = fast_typing(DIGITS, 60, 200, LENGTH_MM, seed=1, hands=hands)
    for key, limits in (
        ("roll_mm", hands.rolls_mm),
        ("slide_mm", hands.slides_mm),
        ("tremor_percent", hands.tremor_percent),
        ("width_mm", hands.width_mm),
    ):
        sizes = [abs(getattr(finger, key)) for finger in file.touch[hands.palm_mN > 0 :]]
        assert limits[0] <= min(sizes) <= max(sizes) <= limits[1]
    for finger in file.touch[hands.palm_mN > 0 :]:
        assert 0 <= finger.points[-1][1] + finger.roll_mm + finger.slide_mm <= LENGTH_MM


def test_two_fingers_overlap_at_the_documented_distances():
    touches = two_fingers(DIGITS, 200, LENGTH_MM, seed=1).touch
    for first, second in zip(touches[::2], touches[1::2]):
        assert 9 <= abs(first.points[0][1] - second.points[0][1]) <= 60
        assert first.points[0][0] < second.points[0][0] < first.points[2][0]
    ends_first = [
        first.points[-1][0] < second.points[-1][0]
        for first, second in zip(touches[::2], touches[1::2])
    ]
    assert 30 <= sum(ends_first) <= 70


@pytest.mark.parametrize(
    ("count", "total", "low", "high"),
    [(0, 100, 0.0, 3.7), (5, 100, 2.15, 11.18), (100, 100, 96.3, 100)],
)
def test_the_interval_is_wilsons(count, total, low, high):
    assert interval_percent(count, total) == pytest.approx((low, high), abs=0.01)


def test_the_demo_scores_a_scenario(tmp_path):
    path = tmp_path / "two.toml"
    path.write_text(
        "seconds = 5.0\n"
        "[[touch]]\npoints = [[3.0, 4.0, 0], [3.02, 4.0, 2000], [3.1, 4.0, 2000], [3.12, 4.0, 0]]\n"
        "[[touch]]\npoints = [[4.0, 80.0, 0], [4.02, 80.0, 2000], [4.1, 80.0, 2000], [4.12, 80, 0]]"
    )
    figures = demo("default", str(path), 3, None, True, True, "keyboard", "digits")
    assert figures["typed"] == "10"
    assert json.loads(json.dumps(figures))["latency_ms"]["p99"] <= 35
    assert (figures["touches"], figures["right"], figures["host_agrees"]) == (2, 2, True)
