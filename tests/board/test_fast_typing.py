"""Fast typing with overlapping touches (rollover): share of wrong keys, and latency of keys.

`python -m spots_sim.demo.typing_speed 40 60 80 100 people` measures the same with ten times as many
touches.
"""

import numpy as np
import pytest
from support.sensors import replaced

from spots.calibrate.fit.shift import shifted
from spots_sim.demo.demo import open_fast
from spots_sim.demo.demo_applications import type_on_board
from spots_sim.demo.typing_speed import added, typed
from spots_sim.person.stage import calibrate
from spots_sim.strip.files import Finger, ScenarioFile, to_toml
from spots_sim.strip.scenario import Scenario

# Limits by words a minute: errors in percent of the touches, keys without a finger, and 99th
# percentile of the latency in ms: one of a hundred fingers that touch alone looks like two until it
# lifts. docs/evidence/applications.md has the errors of 3,000 touches.
LIMITS = {40: (0.3, 0, 85), 100: (3.0, 6, 120)}
SEEDS = {40: [21], 100: (21, 22, 23)}


def check(runs, percent, no_finger, late_ms):
    figures = added(runs)
    print(figures)
    assert figures["error_percent"] <= percent
    assert figures["no_finger"] <= no_finger
    assert figures["stuck"] == 0
    assert figures["latency_ms"]["p50"] <= 30
    assert figures["pooled_latency_ms"]["p99"] <= late_ms
    assert all(run["host_agrees"] and not run["keys_down"] for run in runs)


@pytest.mark.board
@pytest.mark.parametrize("words_per_min", LIMITS)
def test_fast_typing_is_understood(words_per_min):
    check(
        [typed(words_per_min, 100, seed) for seed in SEEDS[words_per_min]], *LIMITS[words_per_min]
    )


@pytest.mark.board
def test_people_are_understood_at_their_own_speeds():
    check([typed("people", 30, seed) for seed in range(5)], 1.0, 2, 70)


@pytest.mark.board
def test_fast_typing_is_understood_at_half_the_exposure(sensor):
    lines = calibrate(sensor, 5000)
    check([typed(100, 100, 21, lines=lines)], 3, 5, 110)


@pytest.mark.board
def test_fast_typing_is_understood_while_each_channel_is_off_by_a_hundredth(sensor, calibration):
    # This drift moves positions by up to 0.6 mm. A larger drift would move touches to other keys.
    nepers = 0.01 * np.array([1, 1, 1, -1, 1, 1])
    lines = shifted(calibration, [1000 * sensor.length_mm / 2], [nepers / np.log(2)])
    check([typed(100, 100, 21, lines=tuple(lines))], 6, 1, 150)


@pytest.mark.board
def test_five_keys_at_120_words_a_minute(tmp_path):
    # During six of a hundred touches, three fingers touch at the same time.
    layout = tmp_path / "five.toml"
    layout.write_text('name = "five"\n[[layer]]\nname = "five"\nkeys = ["1", "2", "3", "4", "5"]\n')
    check([typed(120, 100, 21, layout=str(layout))], 8, 1, 200)


# Largest number of errors in 200 touches at 60 words a minute. Without the rule that a position
# near a finger is its own, fingers that roll make 9, and fingers that slide 33 or more.
@pytest.mark.board
@pytest.mark.parametrize(
    ("hands", "errors"), [("rolling", 3), ("sliding", 4), ("sliding-slowly", 8), ("wide", 1)]
)
def test_fingers_that_roll_or_slide_are_one_key(hands, errors):
    figures = typed(60, 100, 31, hands=hands)
    print(hands, figures)
    assert figures["wrong"] + figures["missed"] + figures["extra"] <= errors
    assert figures["stuck"] == 0


@pytest.mark.board
def test_two_fingers_at_the_same_time_are_two_keys():
    figures = typed("two-fingers", 100, 31)
    assert figures["right"] >= 99


def test_two_fingers_are_two_keys_if_the_colour_depends_on_the_force(tmp_path, sensor):
    strip = tmp_path / "strip.toml"
    strip.write_text(to_toml(replaced(sensor, contact={"mode_percent": -7.0})))
    figures = typed("two-fingers", 100, 33, sensor=str(strip))
    assert figures["right"] >= 99
    assert figures["host_agrees"]
    assert figures["wrong"] + figures["extra"] <= 1


def at(key):
    """Return the middle of one of the ten keys, in mm."""
    return 8.5 * ("1234567890".index(key) + 0.5)


def finger(key, begins_s, ends_s, force_mN=2000):
    x_mm = at(key)
    points = [(begins_s, 0), (begins_s + 0.02, force_mN), (ends_s - 0.02, force_mN), (ends_s, 0)]
    return Finger(points=[(3.0 + time_s, x_mm, force) for time_s, force in points])


def play(*fingers):
    seconds = max(finger.points[-1][0] for finger in fingers) + 0.5
    truth = Scenario(ScenarioFile(seconds=seconds, touch=list(fingers)))
    board, _ = open_fast("default", truth, 5)
    with board:
        return type_on_board(board, truth, 0.0, seconds - board.now_s(), True, "digits")


@pytest.mark.board
@pytest.mark.parametrize("phase_s", [0.0, 0.007])
def test_rollover_types_what_was_touched(phase_s):
    text = "75310864297531"
    fingers = [
        finger(key, phase_s + 0.09 * i, phase_s + 0.09 * i + 0.12) for i, key in enumerate(text)
    ]
    figures = play(*fingers)
    assert figures["typed"] == text


@pytest.mark.board
@pytest.mark.parametrize("second", "50")
def test_a_second_finger_is_a_second_key_while_the_first_one_rests(second):
    figures = play(finger("4", 0.0, 2.0), finger(second, 0.5, 0.7), finger(second, 1.0, 1.2))
    assert figures["typed"] == "4" + 2 * second
    assert figures["extra"] == figures["missed"] == figures["stuck"] == 0


@pytest.mark.board
def test_two_fingers_that_rest_are_two_keys():
    figures = play(finger("3", 0.0, 3.0), finger("9", 0.5, 3.0))
    assert (figures["typed"], figures["keys_down"]) == ("39", 0)


@pytest.mark.board
@pytest.mark.parametrize("phase_s", [0.0, 0.007])
def test_a_second_finger_is_a_key_soon_although_the_force_of_the_first_one_was_rising(phase_s):
    # The second finger comes 10 ms after the first one is at its full force.
    figures = play(finger("4", phase_s, phase_s + 0.15), finger("6", phase_s + 0.03, 0.2))
    assert figures["typed"] == "46"
    assert figures["latency_ms"]["p99"] <= 50


@pytest.mark.board
@pytest.mark.parametrize("phase_s", [0.003, 0.007])
def test_the_next_key_needs_one_reading_after_the_lift_of_the_first_finger(phase_s):
    # The second finger comes when the first one begins to lift, which takes 20 ms.
    figures = play(finger("4", phase_s, phase_s + 0.12), finger("7", phase_s + 0.1, 0.25))
    assert figures["typed"] == "47"
    assert figures["latency_ms"]["p99"] <= 38


@pytest.mark.board
@pytest.mark.parametrize("phase_s", [0.0, 0.007])
def test_a_finger_that_was_never_alone_is_typed_when_the_other_one_is(phase_s):
    # The second finger comes while the force of the first one still rises, and leaves before it.
    figures = play(finger("8", phase_s, phase_s + 0.3), finger("2", phase_s + 0.015, 0.2))
    assert figures["typed"] == "82"


# Times in ms at which the force rises, is full, falls and ends; position in mm; force in mN.
FIRST = (3, 24, 80, 109, 39.7, 1100)
BRIEF = (76, 95, 111, 126, 72.1, 1600)
LONG = (3, 17, 81, 106, 39.8, 2100)
SHORT = (72, 90, 99, 118, 63.5, 1900)
THIRD = (116, 131, 171, 189, 54.7, 1200)


@pytest.mark.parametrize("phase_ms", [2, 3])
@pytest.mark.parametrize(
    ("text", "fingers"), [("58", (LONG, SHORT)), ("597", (FIRST, BRIEF, THIRD))]
)
def test_a_finger_that_is_alone_for_one_reading_is_typed(text, fingers, phase_ms):
    touches = [
        Finger(
            points=[
                (3 + (at_ms + phase_ms) / 1000, x_mm, force)
                for at_ms, force in zip(times_ms, (0, force_mN, force_mN, 0))
            ]
        )
        for *times_ms, x_mm, force_mN in fingers
    ]
    assert play(*touches)["typed"] == text


@pytest.mark.board
@pytest.mark.parametrize("apart_s", [0.0, 0.004])
def test_of_fingers_that_came_together_both_are_typed(apart_s):
    figures = play(finger("3", 0.0, 0.3), finger("9", apart_s, 0.2))
    assert sorted(figures["typed"]) == ["3", "9"]


@pytest.mark.board
@pytest.mark.parametrize("phase_s", [0.0, 0.007])
@pytest.mark.parametrize("text", ["269", "295"])
def test_a_third_finger_taps_its_key_while_two_rest(text, phase_s):
    first, second, third = text
    figures = play(
        finger(first, phase_s, phase_s + 0.5),
        finger(second, phase_s + 0.15, phase_s + 0.5),
        finger(third, phase_s + 0.25, phase_s + 0.35),
    )
    assert figures["typed"] == text
    assert figures["latency_ms"]["p99"] <= 60


@pytest.mark.board
@pytest.mark.parametrize("phase_s", [0.0, 0.007])
def test_a_third_finger_is_typed_once_although_it_remains(phase_s):
    ends_s = phase_s + 0.3
    figures = play(
        finger("2", phase_s, ends_s),
        finger("6", phase_s + 0.1, ends_s + 0.01),
        finger("9", phase_s + 0.2, ends_s + 0.2),
    )
    assert figures["typed"] == "269"
    assert figures["stuck"] == figures["keys_down"] == 0


def test_the_host_finds_touches_at_the_same_reading_as_the_board():
    # The second finger comes while the force of the first one rises: the first reading counts.
    first = Finger(points=[(3.0, 12.7, 0), (3.04, 12.7, 2400), (3.1, 12.7, 2400), (3.12, 12.7, 0)])
    second = Finger(
        points=[(3.03, 63.7, 0), (3.06, 63.7, 1650), (3.1, 63.7, 1650), (3.12, 63.7, 0)]
    )
    third = Finger(
        points=[(3.085, 21.2, 0), (3.1, 21.2, 1400), (3.15, 21.2, 1400), (3.17, 21.2, 0)]
    )
    assert play(first, second, third)["host_agrees"]


@pytest.mark.parametrize(("from_mm", "to_mm", "key"), [(8, 77, "1"), (77, 8, "0")])
def test_a_finger_that_slides_at_300_mm_a_second_is_one_key(from_mm, to_mm, key):
    slid_s = 3.1 + abs(to_mm - from_mm) / 300
    path = [(3.0, from_mm, 0), (3.02, from_mm, 2000), (3.1, from_mm, 2000)]
    path += [(slid_s, to_mm, 2000), (slid_s + 0.1, to_mm, 2000), (slid_s + 0.12, to_mm, 0)]
    assert play(Finger(points=path))["typed"] == key


@pytest.mark.board
def test_fast_typing_is_understood_on_a_weak_dye():
    figures = added([typed(100, 100, 21, "weak_dye")])
    print(figures)
    assert figures["error_percent"] <= 9
    assert figures["no_finger"] <= 6  # 2 to 6 on the weak dye for texts that begin 0 to 9 ms later
