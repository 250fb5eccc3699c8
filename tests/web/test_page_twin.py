"""The digital twin of a linkage in the web UI, with two boards, and its error messages."""

from __future__ import annotations

import math
import re
import time

import pytest
from playwright.sync_api import expect
from support.joints import JOINT
from support.joints import touch as reading
from support.linkage_machine import Machine
from support.refusals import refusal
from support.serving import apart, until

from spots import SpotsError, cli
from spots.errors import SettingError
from spots.keyboard.layout import load as load_layout
from spots.link.board import Board
from spots_linkage import Encoder, Linkage, Twin, panel
from spots_sim.board.paced import PacedLink
from spots_sim.demo.linkage_demo import endless
from spots_web.panel_feed import readers_of, shower
from spots_web.state import PageState

LONG_MS = 60_000
LINKAGE = Linkage(100, 80)

# Pixels in the colour of the trail.
DRAWN = """() => {
  const c = document.querySelector('#panel-twin canvas');
  if (!c || !c.width) return 0;
  const [r, g, b] = [0x1f, 0x7a, 0x8c];
  const data = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
  let found = 0;
  for (let i = 0; i < data.length; i += 4)
    found += data[i] === r && data[i + 1] === g && data[i + 2] === b;
  return found;
}"""


def twin(state):
    return shower(state, "twin")


def at(theta_rad, i):
    return reading((math.degrees(theta_rad) + 20) / 0.002, i, time_s=0.03 * i)


@pytest.fixture(scope="module")
def machine(sensor, tmp_path_factory):
    return Machine(sensor, tmp_path_factory.mktemp("arm"))


def part(state):
    _, news = state.since(state.begin()._replace(version=0))
    return news.get("panel-twin")


def test_a_simulated_linkage_moves_on_the_page(machine, monkeypatch, running, serve, open_page):
    monkeypatch.setattr(
        "spots_sim.measure.simulated_linkage._strips", lambda *_: [machine.strip] * 2
    )
    state = PageState()
    running(readers_of(panel.driven_sources(endless(), twin(state)), load_layout("digits"), state))
    page = open_page(serve(state).url)
    expect(page.locator("#panel-twin")).to_be_visible(timeout=LONG_MS)
    # The page shows the strip of joint 1 like any other strip, and the trail gets longer.
    expect(page.locator(".press.on")).to_have_count(1, timeout=LONG_MS)
    until(page, f"({DRAWN})() > 20")
    before = page.evaluate(DRAWN)
    until(page, f"({DRAWN})() > {before} + 100")
    assert part(state)["base_mm"] == pytest.approx(80.72)


@pytest.mark.board
def test_boards_of_a_linkage_file_are_waited_for(machine, monkeypatch, running):
    there = {"0"}

    def finder(port, *_):
        def open_board(board_id):
            if port not in there:
                raise SpotsError(f"no board on {port}, plug it in")
            return Board(PacedLink(machine.link(port), time.monotonic()))

        return open_board

    monkeypatch.setattr(panel, "finder", finder)
    state = PageState()
    sources = panel.linkage_sources(str(machine.arm), ["0", "1"], twin(state))
    assert part(state)["note"] == "waiting for readings of both joints"
    running(readers_of(sources, load_layout("digits"), state))
    awaited(lambda: part(state)["note"] == "joint 2: no board on 1, plug it in")
    assert part(state)["x_mm"] is None
    there.add("1")
    awaited(lambda: part(state)["x_mm"] is not None)
    assert part(state)["note"] == ""
    with refusal(SettingError):
        panel.linkage_sources(str(machine.arm), ["0", "1", "2"], twin(state))


def awaited(condition, timeout_s=60.0):
    end_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end_s, "it never came"
        time.sleep(0.02)


def test_the_trail_is_no_finer_than_a_page_shows_it_and_limits_are_named(serve, open_page):
    state = PageState()
    feed = panel.TwinFeed(Twin(LINKAGE, (Encoder(JOINT), Encoder(JOINT))), twin(state))
    assert part(state)["note"] == "waiting for readings of both joints"
    for i in range(100):
        for joint in (0, 1):
            feed.take(joint, at(-0.3 - 0.001 * i, i))
    shown = part(state)
    steps = [math.dist(a, b) for a, b in zip(shown["trail"], shown["trail"][1:])]
    assert 3 < len(steps) < 60
    assert min(steps) >= 0.49
    assert max(steps) < 1
    page = open_page(serve(state).url)
    words = page.locator("#panel-twin .remark")
    expect(words).to_have_text("")
    for i in range(100, 110):
        for joint in (0, 1):
            feed.take(joint, at(-1.5, i))
    expect(words).to_have_text("the elbows are farther apart than the outer bars reach")
    assert part(state)["x_mm"] is None
    assert part(state)["trail"] == shown["trail"]
    for i in range(250, 260):
        feed.take(0, at(-0.3, i))
    expect(words).to_have_text(re.compile("^no angle of joint 2: check"))
    feed.lost(1, "it was unplugged")
    expect(words).to_have_text("joint 2: it was unplugged")
    feed.take(0, at(-0.3, 270))
    assert part(state)["note"] == "joint 2: it was unplugged"


def test_recordings_that_are_played_again_are_followed_again():
    state, counts = PageState(), []
    feed = panel.TwinFeed(Twin(LINKAGE, (Encoder(JOINT), Encoder(JOINT))), twin(state))
    for _ in range(3):
        before = part(state)["trail"]
        for i in range(200):
            for joint in (0, 1):
                feed.take(joint, at(-0.2 - 0.001 * i, i))
        counts.append(len(part(state)["trail"]))
        assert part(state)["x_mm"] is not None
        assert part(state)["note"] == ""
        assert part(state)["trail"] == before or not before
    assert counts[0] == counts[1] == counts[2] > 10


def test_boards_with_named_ports_are_found_again_by_their_ids(machine, monkeypatch):
    asked = []

    def finder(port, *_):
        def open_board(board_id):
            asked.append((port, board_id))
            raise SpotsError("away")

        return open_board

    monkeypatch.setattr(panel, "finder", finder)
    for ports, known in ((["0", "1"], None), (["0", "1"], "an id")):
        for open_board, *_ in panel.linkage_sources(str(machine.arm), ports, lambda value: None):
            with pytest.raises(SpotsError):
                open_board(known)
    assert asked == [("0", None), ("1", None), ("0", "an id"), ("1", "an id")]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--port", "a", "--port", "b"], "shows one board, but --port was given 2 times"),
        (["--linkage", "nope.toml"], "cannot read the linkage file nope.toml"),
        (
            ["--linkage", "nope", "--port", "virtual"],
            "cannot read the linkage file nope, because there is no such file: give the path",
        ),
    ],
)
def test_mistakes_are_told_before_a_page_is_served(arguments, words, capsys):
    assert apart(cli.main, ["serve", *arguments]) == 2
    err = capsys.readouterr().err
    assert words in err
    assert err.count("\n") == 1
