"""Boards with two strips: the web UI shows both; a browser with the token selects one to edit."""

from __future__ import annotations

import json
import re
import threading
import time

import pytest
from playwright.sync_api import expect
from support.person import Person
from support.screens import SCREENS
from support.serving import Bench, apart, eventually, post, token_of

from spots.keyboard.layout import load
from spots.link.board import Board
from spots.link.frames import Spectrum, Touch
from spots.link.timeouts import CONNECTED
from spots_device.board.settings import checksum
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import Finger, ScenarioFile
from spots_sim.strip.scenario import Held, Press, Scenario
from spots_web.one_strip import OneStrip
from spots_web.state import PageState

LONG_MS = 60_000
DESK = {"viewport": {"width": 1440, "height": 900}}
MINI = load("mini")


@pytest.fixture
def two(bench, serve, tmp_path):
    """Return a function that starts a board with two strips and its web server.

    Its argument is the simulated finger of strip 1; strip 0 is not touched.
    """

    def make(second=None, **options):
        one = bench(Held(), second=second or Held(), **options)
        one.server = serve(one.state, queues=one.queues)
        return one

    return make


class Unplugged:
    """I2C bus of a sensor that was unplugged: it does not answer."""

    def __init__(self, bus):
        self.chip, self.clock, self.lines, self.light = bus.chip, bus.clock, bus.lines, bus.light
        self.frequency_hz, self._refuse = bus.frequency_hz, bus.refuse

    def write(self, *transfer):
        self._refuse()

    read = write_read = write


def numbers(page, strip):
    """Return the page elements with the numbers of a strip: position in mm and force in N."""
    return page.get_by_role("region", name=strip, exact=True).locator(".figure b")


def mark_mm(page, strip):
    """Return the position in mm at which the press is drawn on a strip."""
    mark = page.get_by_role("region", name=strip, exact=True).locator(".press.on").bounding_box()
    track = page.get_by_role("region", name=strip, exact=True).locator(".track").bounding_box()
    return 85 * (mark["x"] + mark["width"] / 2 - track["x"]) / track["width"]


def shown(one, part):
    return one.state.since(one.state.begin())[1].get(part)


def ready(one, strip=0):
    end_s = time.monotonic() + 60
    while (shown(one, "board") or {}).get("strip") != strip:
        assert time.monotonic() < end_s
        time.sleep(0.02)


def test_both_strips_have_picture_numbers_and_history(two, open_page):
    second = Held()
    one = two(second)
    one._scenario.press, second.press = Press(20.0, 3000, 4.0), Press(60.0, 5000, 4.0)
    page = open_page(one.server.url, **DESK)
    expect(numbers(page, "Strip 0").first).to_have_text(re.compile(r"^(19|20)\.\d\dmm"))
    expect(numbers(page, "Strip 1").first).to_have_text(re.compile(r"^(59|60)\.\d\dmm"))
    assert mark_mm(page, "Strip 0") == pytest.approx(20, abs=1)
    assert mark_mm(page, "Strip 1") == pytest.approx(60, abs=1)
    box = page.locator("#beside .layers").bounding_box()
    page.mouse.move(box["x"] + 0.98 * box["width"], box["y"] + 50)
    expect(page.locator("#beside .readout")).to_have_text(re.compile(r"(59|60)\.\d\d mm, \d"))
    expect(page.locator("#strips")).to_be_hidden()  # nothing can be changed here
    expect(page.locator("#next")).to_be_hidden()


def test_both_pictures_are_in_sight(two, open_page):
    second = Held()
    one = two(second)
    second.press = Press(60.0, 5000, 4.0)
    page = open_page(one.server.url)
    expect(page.locator("#beside .press.on")).to_have_count(1)
    for width, height in SCREENS.values():
        page.set_viewport_size({"width": width, "height": height})
        for strip in ("#touch", "#beside"):
            box = page.locator(f"{strip} .guide").bounding_box()
            assert box["y"] >= 0
            assert box["y"] + box["height"] <= height
        assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_each_strip_has_the_sentence_of_its_state(two, open_page):
    fingers = [
        Finger(points=[(t, mm, 3000 * (at < t < 600)) for t in (at, at + 0.1, 599, 600)])
        for at, mm in ((6, 15), (8, 70))
    ]
    one = two(Scenario(ScenarioFile(seconds=600, touch=fingers)))
    page = open_page(one.server.url, **DESK)
    words = page.locator("#beside .remark")
    expect(words).to_have_text(re.compile(r"^two fingers touch, at about 1[45]\.\d and (69|70)"))
    expect(page.locator("#next")).to_be_hidden()  # strip 0 needs no advice
    expect(page.locator("#beside .other.on")).to_have_count(2)
    # One strip is unplugged from the board, and the other one still gives readings.
    one.wires.second = Unplugged(one.wires.second)
    expect(words).to_have_text("no readings arrive; next: check the wires of the sensor")
    expect(page.locator("#beside .other.on")).to_have_count(0)
    one._scenario.press = Press(20.0, 3000, 4.0)
    expect(numbers(page, "Strip 0").first).to_have_text(re.compile(r"^(19|20)\.\d\dmm"))


def test_the_first_strip_may_be_the_lost_one(two, open_page):
    second = Held()
    one = two(second)
    second.press = Press(60.0, 5000, 4.0)
    page = open_page(one.server.url, **DESK)
    expect(page.locator("#beside .press.on")).to_have_count(1)
    one.wires.bus = Unplugged(one.wires.bus)
    expect(page.locator("#next")).to_have_text(
        "strip 0: no readings arrive; next: check the wires of the sensor"
    )
    expect(numbers(page, "Strip 1").first).to_have_text(re.compile(r"^(59|60)\.\d\dmm"))


def test_the_layout_goes_to_the_chosen_strip(two, open_page, tmp_path):
    second = Held()
    one = two(second, edit=tmp_path / "mine.toml", layout="mini")
    page = open_page(one.server.url, **DESK)
    page.get_by_role("button", name="strip 1", exact=True).click(timeout=LONG_MS)
    expect(page.get_by_role("button", name="strip 1", exact=True)).to_have_attribute(
        "aria-pressed", "true"
    )
    page.locator("#edit").click()
    page.get_by_role("button", name="Put on the board").click(timeout=LONG_MS)
    expect(page.locator("#editor .state")).to_have_text(re.compile("^on the board"))
    assert shown(one, "editor")["stored"] == "this"
    layouts = [
        apart(lambda line=line: one.board.command(line)["layout"])
        for line in ("hello", "hello sensor=1")
    ]
    assert layouts == [None, checksum(MINI.lines)]
    # The editor shows the zones of strip 1, and which zone its finger touches.
    second.press = Press(85 * 3.5 / 9, 3000, 4.0)
    expect(page.locator("#editor .zone.under")).to_have_count(1)
    page.locator("#edit").click()
    region = page.get_by_role("region", name="Strip 0", exact=True)
    expect(region.locator(".figure.none")).to_have_count(2)
    expect(numbers(page, "Strip 1").first).to_have_text(re.compile(r"^3[23]\.\d\dmm"))
    top = "(name) => document.querySelector(name).getBoundingClientRect().top"
    assert page.evaluate(top, "#beside") < page.evaluate(top, "#touch")  # strip 0 comes first
    page.get_by_role("button", name="strip 0", exact=True).click()
    eventually(lambda: shown(one, "editor")["stored"] == "default")


def test_only_the_token_chooses_an_existing_strip(two, tmp_path):
    one = two(edit=tmp_path / "mine.toml")
    ready(one)
    token = token_of(one.server)
    for wrong in (None, "wrong", token[:-1]):
        assert post(one.server, "1", path="strip", token=wrong)[0] == 403
    assert post(one.server, "1", path="strip", token=token, Origin="http://evil.example")[0] == 403
    for body in ("", "2x", "-1", "11", "²", '{"do":"push"}'):
        assert post(one.server, body.encode(), path="strip", token=token)[0] == 400
    status, why = post(one.server, "2", path="strip", token=token)
    assert (status, "the board has no strip 2" in why) == (409, True)
    assert shown(one, "board")["strip"] == 0
    assert post(one.server, "1", path="strip", token=token)[0] == 204
    ready(one, 1)


def test_a_request_is_handled_as_soon_as_the_board_is_shown(two, tmp_path, monkeypatch):
    put, answers = PageState.put, []

    def put_and_ask(state, part, value):
        put(state, part, value)
        if part == "board" and value["state"] == CONNECTED and not answers:
            answers.append(one.queues["strip"].submit(1))

    # The reader's thread starts inside of `two`, before `one` exists.
    begin = threading.Event()
    open_ = Bench._open
    monkeypatch.setattr(Bench, "_open", lambda *args: begin.wait(60) and open_(*args))
    monkeypatch.setattr(PageState, "put", put_and_ask)
    one = two(edit=tmp_path / "mine.toml")
    begin.set()
    ready(one, 1)
    assert answers[0].result(60) is None


def test_a_session_calibrates_the_chosen_strip(two, open_page, tmp_path, calibration):
    second = Held()
    one = two(second, session=tmp_path / "mine.jsonl", speed=4.0)
    ready(one)
    before = apart(lambda: one.board.command("get"))
    page = open_page(one.server.url, **DESK)
    page.get_by_role("button", name="strip 1", exact=True).click(timeout=LONG_MS)
    eventually(lambda: shown(one, "calibration")["file"] == "mine-1.toml")
    page.locator("#calibrate").click()
    person = Person(page, second, 85.0)
    person.start("rough")
    expect(page.locator("#strips")).to_be_hidden()
    person.go_on(lambda seen: seen["count"].startswith("1 of"))
    assert not (tmp_path / "mine.jsonl").exists()
    page.get_by_role("button", name="Stop", exact=True).click()
    person.wait(lambda seen: seen["starts"])
    made = [json.loads(line) for line in (tmp_path / "mine-1.jsonl").read_text().splitlines()]
    assert any("-1" in json.dumps(one) for one in made)
    after = apart(lambda: one.board.command("get"))
    assert [before[name] for name in ("gain", "exposure_us")] == [
        after[name] for name in ("gain", "exposure_us")
    ]


def test_one_strip_of_a_board_reads_and_changes_this_strip_only(sensor):
    with Board(LockstepLink(sensor, Held(), second=(Held(), 2))) as board:
        strips = [OneStrip(board, i) for i in board.sensors]
        strips[1].set(gain=7)
        assert [strip.command("get")["gain"] for strip in strips] == [9, 7]
        assert strips[1].command("hello")["id"] == strips[1].info["id"] == board.info["id"] + "-1"
        board.stream("touch", "spectrum")
        for frames, kind in ((strips[1].frames(0.2), Touch), (strips[1].spectra(0.2), Spectrum)):
            found = list(frames)
            assert {one.sensor for one in found} == {1}
            assert sum(isinstance(one, kind) for one in found) > 10
        live = strips[0].spectra()
        while next(live).sensor == 0 and live.unread:  # must end, although strip 1 sends, too
            pass
