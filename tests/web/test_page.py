"""The web UI in a real browser, with the firmware on a simulated strip."""

from __future__ import annotations

import math
import re
import time
from itertools import pairwise

import pytest
from playwright.sync_api import expect
from support.serving import Bench, eventually, until

from spots.keyboard.layout import load as load_layout
from spots.link.board import Board
from spots.link.frames import Touch
from spots.link.timeouts import CONNECTED, LOST, REFUSED, SEARCHING, STALLED
from spots.recording.recorder import Recorder
from spots.recording.replay import open_recording
from spots_device.reading.decode import LED_OFF, TOUCHING
from spots_sim.board.lockstep import LockstepLink
from spots_sim.demo.demo import open_fast
from spots_sim.strip.files import Finger, ScenarioFile, load
from spots_sim.strip.scenario import Held, Press, Scenario
from spots_web import board_feed as reader
from spots_web.board_feed import BoardReader
from spots_web.state import PageState
from spots_web.strip_feed import _message

LONG_MS = 60_000
KNOB = "new DOMMatrix(getComputedStyle(document.querySelector('.knob')).transform).e"
FLASH_MS = 500  # longer than the web UI highlights a key after a tap
LIFT_S = 0.1  # of the board's time: much longer than the release debounce
LENGTH_MM = 85.0
DRAWN_MM = 0.01  # largest distance of the drawn mark from the reading; a pixel is 0.1 mm
FIRM_MN = 1000  # at lower forces, such as at the end of a lift, the light is mostly noise

# Records where the press is drawn, and the number beside it.
LOOK = """
window.seen = [];
document.addEventListener("drawn", ({ detail }) => {
  const middle = (name) => document.querySelector(name).getBoundingClientRect();
  const press = middle(".press"), track = middle(".track");
  seen.push({
    ...detail,
    on: document.querySelector(".press").classList.contains("on"),
    share: (press.left + press.width / 2 - track.left) / track.width,
    text: document.querySelector(".figure b").firstChild.data,
  });
});
"""
# Largest age of the reading that a number shows: a number changes only five times a second. On a
# slow machine the age may be longer, but at most this number of messages, because each message
# redraws only one of the 14 panels that can wait, and some of them are due again before the number.
FIGURE_S = 1.0
FIGURE_MESSAGES = 16


def ready(page):
    """Wait until readings arrive; a finger that touches before that would press no key."""
    until(page, "drawn.length > 5")


def test_a_moving_press_is_where_the_finger_is(bench, serve, open_page):
    truth = Scenario(load(ScenarioFile, "demo"))
    # From the first message on: later, a number may show an earlier reading.
    page = open_page(serve(bench(truth).state).url, scripts=(LOOK,))
    until(page, "seen.filter((one) => one.trusted).length > 150")
    places, lately = [], []
    for one in page.evaluate("seen"):
        soon = [past for past in lately if one["time_s"] - past["time_s"] < FIGURE_S]
        lately = lately[-max(FIGURE_MESSAGES, len(soon)) :] + [one]
        if len(lately) > 1 and one["text"][0].isdigit():
            figure_um = 1000 * float(one["text"])
            places_um = [past["position_um"] for past in lately if past["position_um"] is not None]
            assert min(abs(place_um - figure_um) for place_um in places_um) < 10
        presses = truth.presses(one["time_s"])
        if one["trusted"] and len(presses) == 1:
            at_mm, shown_mm = presses[0].position_mm, LENGTH_MM * one["share"]
            assert one["on"]
            assert abs(shown_mm - one["position_um"] / 1000) < DRAWN_MM
            if presses[0].force_mN > FIRM_MN:
                assert abs(shown_mm - at_mm) < 0.5
                places.append(at_mm)
    assert len(places) > 100
    assert max(places) - min(places) > 30


def test_a_key_is_lit_as_long_as_it_is_pressed(bench, serve, open_page):
    held = Held()
    page = open_page(serve(bench(held).state).url)
    lit, tape = page.locator(".key.lit"), page.locator(".tape .key-event")
    ready(page)
    for place_mm, key in ((30.0, "4"), (80.0, "0")):
        held.press = Press(place_mm, 3000, 4.0)
        expect(lit).to_have_text([key], timeout=LONG_MS)
        page.wait_for_timeout(FLASH_MS)
        assert lit.all_text_contents() == [key]
        held.press = None
        expect(lit).to_have_count(0, timeout=LONG_MS)
    expect(tape).to_have_text(["4", "0"])
    held.press = Press(50.0, 8000, 4.0)
    expect(page.locator(".tape .gesture").last).to_have_text("squeeze", timeout=LONG_MS)


def test_the_stick_goes_where_the_finger_is_and_springs_back(bench, serve, open_page):
    held = Held()
    page = open_page(serve(bench(held).state).url)
    ready(page)
    held.press = Press(80.0, 6000, 4.0)
    until(page, f"{KNOB} > 50")
    expect(page.locator(".button.on")).to_have_text(["1"], timeout=LONG_MS)
    held.press = Press(5.0, 3000, 4.0)
    until(page, f"{KNOB} < -50")
    held.press = None
    until(page, f"{KNOB} === 0")


def test_spectrum_link_and_board_are_told(bench, serve, open_page):
    held = Held()
    held.press = Press(40.0, 4000, 4.0)
    page = open_page(serve(bench(held).state).url)
    expect(page.locator(".bar span")).to_have_text(
        ["F3", "F4", "F5", "F6", "F7", "F8"], timeout=LONG_MS
    )
    until(
        page,
        "[...document.querySelectorAll('.bar b')].every((one) => Number(one.textContent) > 100)",
    )
    expect(page.locator("#spectrum .note")).to_contain_text("fits one press", timeout=LONG_MS)
    expect(page.locator("#spectrum .legend")).to_be_visible()
    # The line that marks the expected value is at the end of each bar.
    ends = """() => [...document.querySelectorAll('.bar')].map((one) => {
      const at = (name) => one.querySelector(name).getBoundingClientRect();
      const { left, width } = at('.whole');
      return [width, at('i').right - left, at('u').left + 1 - left];
    })"""
    until(page, f"({ends})().every(([all, end, line]) => Math.abs(end - line) < 0.02 * all)")
    assert max(end / whole for whole, end, _ in page.evaluate(ends)) > 0.2
    expect(page.locator("#link")).to_contain_text("Hz", timeout=LONG_MS)
    expect(page.locator("#facts")).to_contain_text("10 ms")


def test_the_history_is_drawn(bench, serve, open_page):
    held = Held()
    held.press = Press(40.0, 4000, 4.0)
    page = open_page(serve(bench(held).state).url)
    # Pixels in the colour of the force's line.
    until(
        page,
        """() => {
          const c = document.querySelector('#history canvas:last-child');
          const [r, g, b] = [0x1f, 0x7a, 0x8c];
          const data = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
          let found = 0;
          for (let i = 0; i < data.length; i += 4)
            found += data[i] === r && data[i + 1] === g && data[i + 2] === b;
          return found > 20;
        }""",
    )


def test_without_a_calibration_the_page_shows_what_there_is(sensor, serve, open_page):
    held = Held()
    held.press = Press(40.0, 4000, 4.0)
    one = Bench(sensor, None, held)
    try:
        page = open_page(serve(one.state).url)
        expect(page.locator(".words")).to_contain_text("not calibrated", timeout=LONG_MS)
        expect(page.locator(".bar")).to_have_count(6)
        expect(page.locator("#spectrum .legend")).to_be_hidden()
        expect(page.locator(".bar u.on")).to_have_count(0)
        expect(page.locator("#keyboard")).to_be_hidden()
        expect(page.locator("#stick")).to_be_hidden()
    finally:
        one.close()


LAST = """() => Math.max(...[...document.body.querySelectorAll('*')].map(
  (one) => one.getBoundingClientRect().bottom
)) - document.querySelector('#next').getBoundingClientRect().bottom"""


def test_the_page_of_an_uncalibrated_board_ends_with_the_next_step(sensor, serve, open_page):
    one = Bench(sensor, None, Held())
    try:
        page = open_page(serve(one.state).url)
        step = re.compile(r"^every reading .* has no calibration .*; next: spots calibrate$")
        expect(page.locator("#next")).to_have_text(step, timeout=LONG_MS)
        assert page.evaluate(LAST) < 1
    finally:
        one.close()


def test_a_strip_that_no_finger_has_calibrated_is_told(serve, open_page):
    state = PageState()
    state.put("board", {"state": "connected", "presser": "no_finger"})
    page = open_page(serve(state).url)
    said = "calibrated with an indenter, not yet with a finger; next: spots rezero"
    expect(page.locator("#next")).to_have_text(said, timeout=LONG_MS)
    state.put("board", {"state": "connected", "presser": "finger"})
    expect(page.locator("#next")).to_be_hidden()


def test_a_touch_without_a_position_shows_no_position(serve, open_page):
    state, dark = PageState(), Touch(0, 0, 0, TOUCHING | LED_OFF, 0, 0, math.nan, math.nan, 0.0)
    state.put("board", {"state": "connected", "length_um": 85_000})
    page = open_page(serve(state).url)
    state.put("touch", _message(dark, 0.0))
    expect(page.locator(".words")).to_have_text("LED off", timeout=LONG_MS)
    expect(page.locator(".figure b").first).to_have_text(re.compile(r"^\Dmm$"))
    expect(page.locator(".press")).not_to_have_class(re.compile(r"\bon\b"))


def test_untrusted_readings_have_a_next_step_until_they_are_trusted(bench, serve, open_page):
    both = [
        Finger(points=[(t, mm, 3000 * (1 < t < 4)) for t in (1, 1.1, 3.9, 4)]) for mm in (15, 70)
    ]
    one = Finger(points=[(t, 40.0, 3000 * (6 < t < 9)) for t in (6, 6.1, 8.9, 9)])
    scenario = Scenario(ScenarioFile(seconds=60, touch=[*both, one]))
    page = open_page(serve(bench(scenario).state).url)
    step = page.locator("#next")
    expect(step).to_have_text(re.compile(r"^every reading.*re-zero is advised: "), timeout=LONG_MS)
    expect(step).to_be_hidden(timeout=LONG_MS)


def test_a_lost_board_and_a_lost_server_have_a_next_step(bench, serve, open_page):
    one = bench(Held())
    server = serve(one.state)
    page = open_page(server.url)
    board, step = page.locator("#board"), page.locator("#next")
    expect(board).to_have_attribute("data-state", "connected", timeout=LONG_MS)
    expect(step).to_be_hidden()
    one.unplug()
    expect(step).to_have_text(re.compile("^the board is disconnected; next: plug"), timeout=LONG_MS)
    server.stop()
    expect(step).to_have_text(re.compile("; next: start 'spots serve'"), timeout=LONG_MS)
    one.replug()
    serve(one.state, port=server.port)
    expect(board).to_have_attribute("data-state", "connected", timeout=LONG_MS)
    expect(step).to_be_hidden(timeout=LONG_MS)


def test_a_linkage_is_shown_as_long_as_somebody_tells_of_one(bench, serve, open_page):
    one = bench(Held())
    page = open_page(serve(one.state).url)
    twin = page.locator("#panel-twin")
    expect(page.locator("#board")).to_have_attribute("data-state", "connected", timeout=LONG_MS)
    expect(twin).to_be_hidden()
    message = {
        "x_mm": 40.0, "y_mm": 150.0, "theta1_rad": 0.2, "theta2_rad": 0.2,
        "cov": [1.0, 0.2, 1.0], "trail": [[30.0, 150.0], [40.0, 150.0]],
        "base_mm": 80.0, "bar_mm": [100.0, 100.0, 100.0, 100.0],
    }  # fmt: skip
    one.state.put("panel-twin", message)
    expect(twin).to_be_visible()
    one.state.put("panel-twin", message)
    painted = """() => {
      const c = document.querySelector('#panel-twin canvas');
      return c && c.width && new Uint32Array(
        c.getContext('2d').getImageData(0, 0, c.width, c.height).data.buffer
      ).some((pixel) => pixel);
    }"""
    until(page, painted)
    one.state.put("panel-twin", None)
    expect(twin).to_be_hidden()


def test_a_server_that_restarts_is_found_again(bench, serve, open_page):
    held = Held()
    held.press = Press(20.0, 3000, 4.0)
    one = bench(held)
    server = serve(one.state)
    page = open_page(server.url)
    board, press = page.locator("#board"), page.locator(".press.on")
    expect(press).to_have_count(1, timeout=LONG_MS)
    server.stop()
    expect(board).to_have_text("searching for the server", timeout=LONG_MS)
    expect(press).to_have_count(0)
    serve(one.state, port=server.port)
    expect(press).to_have_count(1, timeout=LONG_MS)
    expect(board).to_have_attribute("data-state", "connected")


def test_a_board_that_is_unplugged_is_found_again(bench, serve, open_page):
    held = Held()
    held.press = Press(20.0, 3000, 4.0)
    one = bench(held)
    page = open_page(serve(one.state).url)
    board, press = page.locator("#board"), page.locator(".press.on")
    expect(press).to_have_count(1, timeout=LONG_MS)
    one.unplug()
    expect(board).to_have_attribute("data-state", "lost", timeout=LONG_MS)
    expect(press).to_have_count(0)
    expect(page.locator(".key.lit")).to_have_count(0)
    one.replug()
    expect(board).to_have_attribute("data-state", "connected", timeout=LONG_MS)
    expect(press).to_have_count(1, timeout=LONG_MS)
    first, *later = one.asked_for
    assert first is None
    assert len(set(later)) == 1
    assert None not in later


@pytest.mark.parametrize("name", [SEARCHING, STALLED, LOST, REFUSED])
def test_whatever_is_wrong_with_a_board_has_words(name, serve, open_page):
    state = PageState()
    state.put("board", {"state": name, "message": "the reason"})
    board = open_page(serve(state).url).locator("#board")
    expect(board).to_have_text(re.compile(r"[a-z ]+: the reason"), timeout=LONG_MS)
    expect(board).not_to_contain_text("undefined")


def test_a_pause_in_a_recording_is_told_and_what_comes_after_it_is_shown(
    sensor, tmp_path, monkeypatch
):
    monkeypatch.setattr(reader, "SEARCH_S", 0.3)
    path = tmp_path / "run.spots"
    board = Board(LockstepLink(sensor, Held()))
    with board, Recorder(board, path):
        for stream, seconds in (("touch", 0.3), ("off", 1.0), ("touch", 0.3)):
            board.command(f"stream {stream}")
            last = [frame for frame in board.frames(seconds) if isinstance(frame, Touch)][-1:]
    state, opened, said = PageState(), [], []

    def open_board(board_id):
        opened.append(board_id)
        return open_recording(path)

    put, shown = state.put, []

    def keep(name, value):
        put(name, value)
        if name == "board" and len(opened) == 1:
            said.append(value["state"])
        if name == "touch" and value and len(opened) == 1:
            shown.append(value["time_s"])

    state.put = keep
    one = BoardReader(open_board, load_layout("digits"), state, search_every_s=0.01)
    one.start()
    try:
        end_s = time.monotonic() + 60
        while len(opened) < 2 and time.monotonic() < end_s:
            time.sleep(0.01)
    finally:
        one.stop()
    assert said[:4] == [CONNECTED, STALLED, CONNECTED, LOST]
    assert shown[-1] == pytest.approx(last[0].time_s, abs=0.1)


def test_a_loose_plug_lets_go_and_is_the_same_board_again(bench, serve, open_page, monkeypatch):
    monkeypatch.setattr(reader, "SEARCH_S", 3600.0)  # no search for another board in a slow test
    held = Held()
    one = bench(held)
    page = open_page(serve(one.state).url)
    board, press = page.locator("#board"), page.locator(".press.on")
    ready(page)
    held.press = Press(20.0, 3000, 4.0)
    expect(page.locator(".key.lit")).to_have_count(1, timeout=LONG_MS)
    cursor = one.state.begin()
    with one.loose():
        expect(board).to_have_attribute("data-state", "lost", timeout=LONG_MS)
        expect(press).to_have_count(0, timeout=LONG_MS)
        expect(page.locator(".key.lit")).to_have_count(0, timeout=LONG_MS)
    expect(board).to_have_attribute("data-state", "connected", timeout=LONG_MS)
    expect(press).to_have_count(1, timeout=LONG_MS)
    assert len(one.asked_for) == 1
    until(page, f"{KNOB} < -20")  # the stick follows the finger, which touched all the time
    events = one.state.since(cursor)[1]["events"]
    assert [event["pressed"] for event in events if event["kind"] == "key"] == [False]
    held.press = None
    expect(press).to_have_count(0, timeout=LONG_MS)
    lifted_s = one.link.now_s()  # the board reports a lift some readings after the drawn one
    eventually(lambda: one.link.now_s() > lifted_s + LIFT_S)
    held.press = Press(80.0, 3000, 4.0)
    expect(page.locator(".key.lit")).to_have_text(["0"], timeout=LONG_MS)


def begun(asked):
    """Return how often the reader started: a command ``stream`` followed by ``hello``.

    The gamepad sends ``hello``, too, so this command alone does not count.
    """
    return sum(a.startswith("stream ") and b == "hello" for a, b in pairwise([*asked]))


def test_a_board_that_restarted_is_asked_again_who_it_is(bench, serve, open_page, monkeypatch):
    monkeypatch.setattr(reader, "SEARCH_S", 3600.0)  # no search for another board in a slow test
    one = bench(Held())
    page = open_page(serve(one.state).url)
    board = page.locator("#board")
    expect(board).to_have_attribute("data-state", "connected", timeout=LONG_MS)
    asked, command = [], one.board.command
    monkeypatch.setattr(one.board, "command", lambda line: (asked.append(line), command(line))[1])
    for count in range(1, 4):
        one.board.stats.restarts += 1
        eventually(lambda count=count: begun(asked) >= count)
    assert begun(asked) == 3
    # The board stays open. Otherwise forged restarts, if they are faster than the board opens,
    # would keep it closed for ever.
    assert one.asked_for == [None]
    one.board.stats.restarts += 1
    monkeypatch.setattr(one.board, "command", lambda line: command(line) | {"id": "another"})
    eventually(lambda: len(one.asked_for) > 1)
    assert one.asked_for == [None, one.board.info["id"]]


def test_a_recording_is_shown_and_begins_again(serve, open_page, tmp_path):
    truth = Scenario(load(ScenarioFile, "demo"))
    path = tmp_path / "run.spots"
    board, _ = open_fast("default", truth, seed=0)
    with board, Recorder(board, path):
        board.command("stream touch spectrum")
        for _ in board.frames(1.5):
            pass
    state, opened = PageState(), []

    def open_board(board_id):
        opened.append(board_id)
        return open_recording(path)

    reader = BoardReader(open_board, load_layout("digits"), state)
    reader.start()
    try:
        page = open_page(serve(state).url)
        expect(page.locator(".press.on")).to_have_count(1, timeout=LONG_MS)
        eventually(lambda: len(opened) > 1)
        assert opened[:2] == [None, board.info["id"]]
        expect(page.locator(".press.on")).to_have_count(1, timeout=LONG_MS)
    finally:
        reader.stop()
