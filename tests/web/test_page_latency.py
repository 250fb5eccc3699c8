"""Age of a reading on the screen; ``pytest -s`` prints the values of docs/evidence/host-costs.md.

The tests do not assert times, which depend on other programs on the machine. They assert that a
page draws each reading one time and in order, that it never has more than two unacknowledged
messages, and that it continues to draw while another page is suspended.
"""

from __future__ import annotations

import os
import time

import numpy as np
import pytest
from support.serving import until

from spots.keyboard.layout import load
from spots.recording.recorder import Recorder
from spots.recording.replay import open_recording
from spots_sim.demo.demo import open_fast
from spots_sim.strip.files import ScenarioFile
from spots_sim.strip.files import load as load_file
from spots_sim.strip.scenario import Scenario
from spots_web.board_feed import BoardReader
from spots_web.editors import LayoutEditor
from spots_web.state import Cursor, PageState

# Readings that the first page draws before and in the measurement: for its values, and otherwise.
PRINTED, TESTED = (60, 150), (10, 40)
MOST_UNDERWAY = 2
RECORDED_S = 90.0  # longer than a test takes


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """A recording of 90 s. It is played because a virtual board would need more processor time."""
    path = tmp_path_factory.mktemp("recordings") / "demo.spots"
    board, _ = open_fast("default", Scenario(load_file(ScenarioFile, "demo")), seed=0)
    with board, Recorder(board, path):
        board.command("stream touch spectrum")
        for _ in board.frames(RECORDED_S):
            pass
    return path


@pytest.fixture
def played(path):
    """The `PageState` of a board that plays the recording, and the list of opened boards."""
    boards, state = [], PageState()

    def open_board(_):
        boards.append(open_recording(path))
        return boards[-1]

    reader = BoardReader(open_board, load("digits"), state)
    reader.start()
    yield state, boards
    reader.stop(30)


def stall(page):
    """Suspend a page by a dialog, which needs no processor time; return a function to resume it."""
    dialogs = []
    page.on("dialog", lambda dialog: dialogs.append(dialog))
    page.evaluate("() => { setTimeout(() => alert('stalled'), 0); }")
    while not dialogs:
        page.wait_for_timeout(20)
    return dialogs[0].dismiss


# Records for each frame of the screen with a new reading which panels changed, without strip and
# keys.
_NOTE_PANELS = """() => {
  const ids = ["figures", "spectrum", "link"], ask = window.requestAnimationFrame.bind(window);
  const observer = new MutationObserver(() => {});
  const all = { subtree: true, childList: true, attributes: true, characterData: true };
  for (const id of ids) observer.observe(document.getElementById(id), all);
  let painted, reading;
  const { clearRect } = CanvasRenderingContext2D.prototype;
  CanvasRenderingContext2D.prototype.clearRect = function (...area) {
    painted = true;
    clearRect.apply(this, area);
  };
  document.addEventListener("drawn", () => { reading = true; });
  window.changed = [];
  window.requestAnimationFrame = (draw) => ask((now_ms) => {
    painted = reading = false;
    observer.takeRecords();
    draw(now_ms);
    const seen = observer.takeRecords().map(({ target }) =>
      ids.find((id) => document.getElementById(id).contains(target)));
    if (painted) seen.push("history");
    if (reading) window.changed.push([...new Set(seen)]);
  });
}"""


def test_a_frame_with_a_reading_draws_one_chart_at_most_and_all_get_their_turn(
    played, serve, open_page
):
    state, _ = played
    page = open_page(serve(state).url)
    until(page, "drawn.length > 0")
    page.evaluate(_NOTE_PANELS)
    until(page, "changed.length > 200")
    changed = page.evaluate("changed")
    assert max(map(len, changed)) == 1
    assert {name for names in changed for name in names} == {
        "figures",
        "spectrum",
        "link",
        "history",
    }


def edit(page):
    """Keep a page busy: move a border of the key layout back and forth until the page closes."""
    page.locator("#edit").click(timeout=60_000)
    page.locator("#editor .border").first.wait_for()
    page.evaluate("""() => {
      let way = 0;
      setInterval(() => {
        const key = way++ & 8 ? "ArrowLeft" : "ArrowRight";
        const pressed = new KeyboardEvent("keydown", { key });
        document.querySelector("#editor .border").dispatchEvent(pressed);
      }, 100);
    }""")


@pytest.mark.parametrize(("pages", "stalled", "editing"), [(1, 0, 0), (8, 1, 1)])
def test_from_frame_to_pixel(
    played, serve, open_page, tmp_path, pytestconfig, pages, stalled, editing
):
    state, boards = played
    settled, measured = PRINTED if pytestconfig.getoption("capture") == "no" else TESTED
    queues = {"layout": LayoutEditor(tmp_path / "mine.toml", load("digits"), state)}
    url = serve(state, queues=queues).url
    opened = [open_page(url) for _ in range(pages)]
    for page in [open_page(url) for _ in range(editing)]:
        edit(page)
    for page in opened:
        until(page, "drawn.length > 0")
    others = [open_page(url) for _ in range(stalled)]
    for page in others:
        until(page, "drawn.length > 0")
    wake = [stall(page) for page in others]
    until(opened[0], f"drawn.length > {settled}")
    for page in opened:
        page.evaluate("drawn.length = 0")
    # The readings of all pages are fetched after the end of the measurement: to return its readings
    # takes a page a large part of a second, and takes processor time from the other pages.
    until(opened[0], f"drawn.length > {measured}")
    end_s = time.time()
    found = [[one for one in page.evaluate("drawn") if one["shown_s"] < end_s] for page in opened]
    epoch_s = time.time() - boards[0].now_s()
    ages_s, rates = [], []
    for drawn in found:
        assert len(drawn) > measured / 10
        times_s = [one["time_s"] for one in drawn]
        assert times_s == sorted(set(times_s))
        ages_s += [one["shown_s"] - epoch_s - one["arrived_s"] for one in drawn]
        rates.append((len(drawn) - 1) / (drawn[-1]["shown_s"] - drawn[0]["shown_s"]))
    board_hz = state.since(Cursor(0, 0))[1]["link"]["rate_hz"]
    p50, p99 = 1000 * np.percentile(ages_s, (50, 99))
    print(
        f"\n{pages} pages, {stalled} stalled and {editing} that edits, each drawing "
        f"{np.median(rates):.0f} of {board_hz:.0f} readings a second; "
        f"from frame to pixel p50 {p50:.1f} ms, p99 {p99:.1f} ms; load {os.getloadavg()[0]:.1f}"
    )
    newest_s = found[0][-1]["time_s"]
    for page, end in zip(others, wake):
        end()
        page.evaluate("drawn.length = 0")
        until(page, f"drawn.filter((one) => one.time_s > {newest_s}).length > 20")
        late = [one for one in page.evaluate("drawn") if one["time_s"] <= newest_s]
        assert len(late) <= MOST_UNDERWAY  # readings that were sent before the page was suspended
    for page in opened + others:
        assert 1 <= page.evaluate("underway") <= MOST_UNDERWAY
