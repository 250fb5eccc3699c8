"""Readings become gamepad states; untrusted readings keep the state, and a timeout releases all."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from spots.controller.controller_settings import (
    ControllerSettings,
    ForceAxis,
    PositionAxis,
    Pressed,
    Smooth,
    Tapped,
)
from spots.controller.gamepad_engine import Controller
from spots.link.frames import Touch
from spots.outputs.devices import AXIS_MAX, REST, State
from spots_device.reading.decode import (
    DROPPED,
    FITS_WITH_DRIFT,
    LED_OFF,
    MISFIT,
    NOT_CALIBRATED,
    SATURATED,
    TOO_DARK,
    TOUCHING,
)

LENGTH_UM = 100_000  # 1 % of the length is 1 mm
EVERY_S = 0.01
SHARP = Smooth(min_cutoff_hz=1000, beta=1000)  # almost no smoothing
X = PositionAxis(min_percent=0, max_percent=100, smooth=SHARP)
Z = ForceAxis(rest_mN=0, max_mN=1000, smooth=SHARP)
TREMBLES = Pressed(number=1, press_mN=500, release_mN=400)
ONE, TWO = 1, 2


class Play:
    """A controller with a simulated clock; records the states that it sends."""

    def __init__(self, every_s=EVERY_S, start_us=0, **settings):
        settings = {"x": X, "z": Z, "rate_hz": 1000, **settings}
        self.controller = Controller(ControllerSettings(**settings), LENGTH_UM)
        self.every_s = every_s
        self.now_s, self.start_us = 50.0, start_us
        self.sent = []  # (time, state)
        self.dark()

    def reading(self, mm=0.0, mN=0, flags=TOUCHING):
        self.now_s += self.every_s
        t_us = (self.start_us + round((self.now_s - 50) * 1e6)) % 2**32
        touch = Touch(0, 0, t_us, flags, 0, 0, round(mm * 1000), mN)
        self._keep(self.controller.take(touch, self.now_s))
        return self

    def touch(self, mm, mN=500, count=1, flags=TOUCHING):
        for _ in range(count):
            self.reading(mm, mN, flags)
        return self

    def dark(self, count=1):
        for _ in range(count):
            self.reading(flags=TOO_DARK)
        return self

    def lift(self):
        return self.reading(flags=0)

    def silence(self, seconds, step_s=0.001):
        end_s = self.now_s + seconds
        while self.now_s + step_s <= end_s + 1e-9:
            self.now_s += step_s
            self._keep(self.controller.tick(self.now_s))
        return self

    def _keep(self, state):
        if state is not None:
            self.sent.append((self.now_s, state))

    @property
    def states(self):
        return [state for _, state in self.sent]

    @property
    def x(self):
        return self.controller.state.x

    @property
    def buttons(self):
        return self.controller.state.buttons


def test_nothing_is_sent_while_nobody_touches():
    play = Play().dark(500).silence(1)
    for flags in (0, TOO_DARK | DROPPED, LED_OFF, NOT_CALIBRATED, SATURATED | TOO_DARK, MISFIT):
        play.touch(73, 500, 20, flags)
    assert play.sent == []


def test_a_finger_moves_the_axes_and_a_lift_centres_them():
    play = Play().touch(0, 500).touch(50, 1000).touch(100, 2000).lift()
    low, middle, high, end = play.states
    assert (low.x, low.z) == (-AXIS_MAX, round(AXIS_MAX / 2))
    assert abs(middle.x) < 0.01 * AXIS_MAX
    assert high.x > 0.99 * AXIS_MAX
    assert high.z == pytest.approx(AXIS_MAX, rel=0.01)
    assert end == REST
    assert play.dark(100).states[-1] is end


def test_a_finger_that_rests_in_the_deadband_sends_once():
    axis = PositionAxis(min_percent=0, max_percent=100, deadband=0.1, smooth=SHARP)
    play = Play(x=axis, z=None)
    for i in range(200):
        play.touch(50 + 4 * (-1) ** i)
    assert play.sent == []
    play.touch(80)
    assert len(play.sent) == 1


DOUBTS = [MISFIT, SATURATED, LED_OFF, NOT_CALIBRATED, MISFIT | SATURATED | DROPPED]


def test_a_reading_that_fits_one_press_up_to_the_drift_moves_the_axes():
    play = Play().touch(20)
    assert play.touch(80, flags=TOUCHING | FITS_WITH_DRIFT | DROPPED).x > 0.5 * AXIS_MAX
    assert not play.controller.held
    play.lift()
    assert play.x == 0


@pytest.mark.parametrize("flags", DOUBTS + [flags | TOUCHING for flags in DOUBTS])
def test_untrusted_readings_keep_the_last_valid_state_for_hold_ms_and_then_rest(flags):
    play = Play(hold_ms=100).touch(80, count=5)
    before, good_s = play.controller.state, play.now_s
    assert not play.controller.held
    while play.now_s < good_s + 0.085:
        play.reading(3, 60_000, flags)  # an untrusted position, far from the finger
        assert play.controller.state == before
        assert play.controller.held
    play.silence(0.05)
    assert play.controller.state == REST
    assert not play.controller.held
    (rest_s, last) = play.sent[-1]
    assert last == REST
    assert rest_s - good_s == pytest.approx(0.1, abs=0.0021)


def test_a_timeout_keeps_the_last_valid_state_for_hold_ms_and_then_rests_once():
    play = Play(hold_ms=100).touch(80, count=5)
    good_s = play.now_s
    play.silence(0.098)
    assert play.x > 0
    play.silence(1)
    assert [state for _, state in play.sent].count(REST) == 1
    assert play.sent[-1][0] - good_s == pytest.approx(0.1, abs=0.0021)


def test_one_reading_that_is_too_dark_is_bridged_two_are_a_lift():
    play = Play(release_ms=15).touch(80, count=5)
    before = play.controller.state
    assert play.dark().controller.state == before
    play.touch(80, count=3)
    assert REST not in play.states
    assert play.dark(2).controller.state == REST


def test_a_finger_that_comes_back_after_the_hold_moves_the_axes_but_pushes_no_button():
    buttons = [Pressed(number=1), Tapped(number=2)]
    play = Play(hold_ms=50, button=buttons).touch(80, count=5)
    assert play.buttons == ONE
    play.silence(0.2)
    play.touch(20)
    assert play.x < 0
    assert play.buttons == 0
    play.lift()
    assert play.buttons == 0
    assert play.touch(20).buttons == ONE


def test_a_finger_that_was_there_before_pushes_no_button():
    settings = ControllerSettings(button=[Pressed(number=1), Tapped(number=2)])
    play = Play()
    play.controller = Controller(settings, LENGTH_UM)
    assert play.touch(20).lift().silence(0.1).states == []


def test_readings_after_lost_frames_are_followed():
    play = Play(hold_ms=100).touch(80, count=5)
    play.now_s += 0.05
    play.touch(40, flags=TOUCHING | DROPPED)
    assert play.x < 0


PATHS = st.lists(st.tuples(st.floats(0, 100), st.sampled_from(["good", "lost", "doubt", "dark"])))


@given(PATHS, st.sampled_from([SHARP, Smooth(), Smooth(min_cutoff_hz=0.5, beta=0.0)]))
def test_x_is_never_where_no_finger_was(path, smooth):
    axis = PositionAxis(min_percent=0, max_percent=100, smooth=smooth)
    play = Play(x=axis)
    given_x = []
    for mm, kind in path:
        if kind == "good":
            play.touch(mm)
            given_x.append(AXIS_MAX * (mm - 50) / 50)
        elif kind == "doubt":
            play.touch(mm, flags=TOUCHING | MISFIT)
        elif kind == "dark":
            play.dark()
        else:
            play.silence(EVERY_S)
        if play.controller.state == REST:
            continue
        assert min(given_x) - 25 <= play.x <= max(given_x) + 25  # rounding to um and to counts
    play.silence(0.2)
    assert play.controller.state == REST
    assert play.sent == [] or play.states[-1] == REST


@pytest.mark.parametrize("every_s", [0.001, 0.0028, 0.01])
def test_no_more_states_are_sent_than_allowed_and_the_last_always_is(every_s):
    play = Play(every_s=every_s, rate_hz=125)
    for i in range(300):
        play.touch(i / 3)
    times = [time_s for time_s, _ in play.sent]
    assert min(b - a for a, b in itertools.pairwise(times)) >= 1 / 125 - 1e-9
    assert len(times) >= 0.8 * min(300, 300 * every_s * 125 / (1 + every_s * 125))
    play.silence(0.009)
    assert play.states[-1] == play.controller.state
    play.lift().silence(0.02)
    assert play.states[-1] == REST


def test_every_push_of_a_button_is_sent_whatever_the_rate():
    play = Play(every_s=0.001, rate_hz=50, button=[TREMBLES])
    for mN in (100, 600, 100, 600, 100):
        play.touch(50, mN)
    play.silence(0.2)
    pushes = [key for key, _ in itertools.groupby(state.buttons for state in play.states)]
    assert pushes == [0, 1, 0, 1, 0]
    times = [time_s for time_s, _ in play.sent]
    assert min(b - a for a, b in itertools.pairwise(times)) >= 0.02 - 1e-9


def test_a_button_that_trembles_for_ever_ends_as_it_is():
    play = Play(every_s=0.001, rate_hz=1, button=[TREMBLES])
    for i in range(1000):
        play.touch(50, 100 + 500 * (i % 2))
    play.lift()
    play.silence(100, step_s=0.1)
    assert play.states[-1] == REST
    assert len(play.states) <= 30


def test_a_hard_press_is_a_button_with_two_thresholds():
    play = Play(button=[Pressed(number=2, press_mN=500, release_mN=400)])
    forces = (100, 499, 500, 450, 400, 399, 450, 500)
    assert [play.touch(50, mN).buttons for mN in forces] == [0, 0, 2, 2, 2, 0, 0, 2]
    assert play.lift().buttons == 0


def test_a_button_without_a_second_threshold_is_down_until_the_lift():
    play = Play(button=[Pressed(number=1, press_mN=500)])
    assert [play.touch(50, mN).buttons for mN in (100, 600, 100)] == [0, ONE, ONE]
    assert play.lift().buttons == 0


def test_a_touch_belongs_to_the_zone_where_it_began():
    buttons = [Pressed(number=1, to_percent=30), Pressed(number=2, from_percent=70)]
    play = Play(button=buttons)
    assert [play.touch(mm).buttons for mm in (10, 50, 90)] == [ONE, ONE, ONE]
    play.lift()
    assert [play.touch(mm).buttons for mm in (50, 10, 90)] == [0, 0, 0]
    play.lift()
    assert play.touch(90).buttons == TWO


def test_a_tap_is_a_push_of_its_length_after_the_lift():
    play = Play(button=[Tapped(number=1, to_percent=50, longest_ms=200, pulse_ms=30)])
    play.touch(20, count=10)
    assert play.buttons == 0
    play.lift()
    assert play.buttons == ONE
    play.silence(0.1)
    pushed = [time_s for time_s, state in play.sent if state.buttons]
    up = next(time_s for time_s, state in play.sent if time_s > pushed[-1])
    assert up - pushed[0] == pytest.approx(0.03, abs=0.0021)
    assert play.touch(20, count=30).lift().buttons == 0  # too long
    assert play.touch(60, count=10).lift().buttons == 0  # elsewhere


def test_two_taps_are_two_pushes():
    play = Play(button=[Tapped(number=1, pulse_ms=30)])
    for _ in range(2):
        play.touch(20, count=5).dark(8)
    play.silence(0.1)
    assert [key for key, _ in itertools.groupby(s.buttons for s in play.states)] == [0, 1, 0, 1, 0]


def test_a_tap_that_ends_in_darkness_counts_and_one_that_ends_in_doubt_does_not():
    taps = [Tapped(number=1)]
    assert Play(button=taps).touch(20, count=5).dark(3).buttons == ONE
    in_doubt = [
        Play(button=taps).touch(20, count=5).silence(0.3),
        Play(button=taps).touch(20, count=5).touch(0, 0, 30, MISFIT),
    ]
    for play in in_doubt:
        assert play.states[-1] == REST
        assert not any(state.buttons for state in play.states)


def test_the_boards_clock_may_wrap_within_a_touch():
    axis = PositionAxis(min_percent=0, max_percent=100)
    usual, wrapping = (
        Play(start_us=start_us, x=axis, button=[Tapped(number=1)])
        for start_us in (0, 2**32 - 50_000)
    )
    for play in (usual, wrapping):
        for mm in range(0, 100, 10):
            play.touch(mm)
        play.lift()
    assert usual.sent == wrapping.sent
    assert usual.buttons == ONE


def test_the_hosts_clock_tells_nothing_of_the_movement():
    late, even = Play(x=PositionAxis()), Play(x=PositionAxis())
    for mm in range(20, 80, 5):
        even.touch(mm)
        late.now_s += 0.004 * (mm % 2)  # arrives later, but was read at the same time
        late.start_us -= 4000 * (mm % 2)
        late.touch(mm)
    assert late.states == even.states


def test_below_its_rest_a_force_is_none():
    z = ForceAxis(rest_mN=300, max_mN=1000, smooth=SHARP)
    play = Play(x=None, z=z)
    assert [play.touch(50, mN).controller.state.z for mN in (100, 299, 300)] == [0, 0, 0]
    assert play.touch(50, 650).controller.state.z == pytest.approx(AXIS_MAX / 2, rel=0.01)


def test_an_axis_that_is_back_before_it_may_be_sent_is_not_sent():
    play = Play(every_s=0.001, rate_hz=50)
    play.touch(80)
    play.touch(20).touch(80, count=100)
    assert len(play.states) <= 2


def test_any_axis_may_follow_either_and_be_turned_round():
    y = ForceAxis(rest_mN=0, max_mN=1000, invert=True, smooth=SHARP)
    x = PositionAxis(min_percent=0, max_percent=100, invert=True, smooth=SHARP)
    play = Play(x=x, y=y, z=None)
    assert play.touch(100, 500).controller.state == State(-AXIS_MAX, -round(AXIS_MAX / 2), 0, 0)
    assert Play(x=None, z=None).touch(80).sent == []


TAPS = Tapped(number=1, longest_ms=200, pulse_ms=50)


def test_a_tap_whose_end_nobody_was_asked_for_is_forgotten():
    play = Play(button=[TAPS], release_ms=50).touch(80, count=5).dark()
    play.now_s += 600
    play.dark(5)
    assert play.buttons == 0
    assert all(state.buttons == 0 for state in play.states)


def test_a_touch_of_before_a_silence_that_nobody_watched_has_ended():
    play = Play(button=[TREMBLES]).touch(80, 900, count=5)
    assert play.buttons == 1
    play.now_s += 600
    play.touch(80, 900)
    assert play.buttons == 0


def test_after_a_release_nothing_is_sent_and_a_finger_pushes_nothing_until_it_was_lifted():
    play = Play(button=[TREMBLES], rate_hz=1).touch(80, 900, count=5)
    play.controller.release()
    sent = len(play.sent)
    play.silence(5)
    assert len(play.sent) == sent
    play.touch(80, 900, count=5)
    assert play.buttons == 0
    play.lift().touch(80, 900)
    assert play.buttons == 1
