"""State that the web UI shows, computed from readings; also of slow boards and without readings."""

from types import SimpleNamespace

import msgspec
import pytest

from spots.controller.controller_settings import load as load_controller
from spots.keyboard.layout import load
from spots.link.frames import Touch
from spots_device.reading.decode import MISFIT
from spots_web.state import PageState
from spots_web.strip_feed import StripFeed

ONCE = """
name = "x"
[[layer]]
name = "a"
keys = ["sticky b", "A"]
[[layer]]
name = "b"
keys = ["1", "2"]
"""


class Shown(PageState):
    """A `PageState` that stores the last value of each part of the state."""

    def __init__(self):
        super().__init__()
        self.parts = {}

    def put(self, name, value):
        super().put(name, value)
        self.parts[name] = value


def feed_of(layout, exposure_us, **options):
    info = {"length_um": 85_000, "exposure_us": exposure_us, "average": 1, "keys": 0}
    board = SimpleNamespace(command=lambda line: info, now_s=lambda: 0.0)
    state = Shown()
    return StripFeed(board, info, state, layout, **options), state


def read(feed, now_s, flags, x_um=10_000):
    feed.take(Touch(0, 0, round(1e6 * now_s), flags, 0, 0, x_um, 1500, now_s), now_s)


@pytest.mark.parametrize(("exposure_us", "stick"), [(10_000, True), (400_000, False)])
def test_a_board_too_slow_for_a_stick_is_shown_without_one(exposure_us, stick):
    feed, state = feed_of(load("digits"), exposure_us)
    for i in range(5):
        read(feed, i * exposure_us * 1e-6, 1)
        feed.tick(i * exposure_us * 1e-6)
    assert state.parts["touch"]["touching"]
    assert (state.parts["stick"] is not None) is stick


def test_a_layer_that_silence_ends_is_shown(tmp_path):
    path = tmp_path / "once.toml"
    path.write_text(ONCE)
    feed, state = feed_of(load(path), 10_000)
    for i, flags in enumerate([4] * 8 + [1] * 8 + [4] * 8):
        read(feed, 0.01 * i, flags)
    assert state.parts["keys"]["layer"] == "b"
    feed.tick(1.0)
    assert state.parts["keys"]["layer"] == "a"


def test_untrusted_readings_are_shown_within_a_second():
    feed, state = feed_of(load("digits"), 10_000)
    read(feed, 0.0, 1)
    for i in range(1, 101):
        read(feed, 0.01 * i, 1 | MISFIT)
    assert "does not fit one press; next: " in state.parts["untrusted"]
    read(feed, 1.01, 1)
    assert state.parts["untrusted"] == ""


def test_silence_returns_the_stick_to_rest():
    settings = load_controller()
    settings = msgspec.structs.replace(settings, hold_ms=10_000)
    feed, state = feed_of(load("digits"), 10_000, controller=settings)
    for i in range(8):
        read(feed, 0.01 * i, 1)
    assert state.parts["stick"]["z"] > 0
    feed.silence("no reading arrives")
    assert state.parts["stick"]["z"] == 0


def test_a_draft_that_is_sent_again_still_sees_the_touch(tmp_path):
    path = tmp_path / "draft.toml"
    path.write_text('name = "x"\n[[layer]]\nname = "a"\nkeys = ["C", "A"]\n')
    feed, state = feed_of(load("digits"), 10_000, draft=lambda: load(path))
    tried = []
    state.add_event = tried.append
    for i, flags in enumerate([4] * 8 + [1] * 8 + [4] * 8):
        read(feed, 0.01 * i, flags)
    assert [(one["name"], one["pressed"]) for one in tried if one["kind"] == "tried"] == [
        ("C", True),
        ("C", False),
    ]
