"""The web UI explains each state of the strip and the next step, visibly on every screen size."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect
from support.screens import SCREENS
from support.serving import apart, until

from spots_sim.demo.demo import show_page
from spots_sim.strip.files import Finger, ScenarioFile
from spots_sim.strip.scenario import Held, Press, Scenario
from spots_web.state import PageState

LONG_MS = 60_000
LENGTH_MM = 85.0
IN_SIGHT = """(name) => {
  const { top, bottom, left, right } = document.querySelector(name).getBoundingClientRect();
  return top >= 0 && left >= 0 && bottom <= innerHeight && right <= innerWidth;
}"""


@pytest.fixture(params=SCREENS)
def screen(request):
    width, height = SCREENS[request.param]
    return {"viewport": {"width": width, "height": height}}


def test_two_fingers_are_two_marks_and_a_sentence(bench, serve, open_page):
    fingers = [
        Finger(points=[(t, mm, 3000 * (at < t < 600)) for t in (at, at + 0.1, 599, 600)])
        for at, mm in ((6, 15), (8, 70))
    ]
    one = bench(Scenario(ScenarioFile(seconds=600, touch=fingers)))
    page = open_page(serve(one.state).url)
    expect(page.locator("#next")).to_have_text(
        re.compile(r"^two fingers touch, at about 1[45]\.\d and (69|70)\.\d mm; next: lift one"),
        timeout=LONG_MS,
    )
    expect(page.locator(".press.on")).to_have_count(0)
    shares = """[...document.querySelectorAll('.other.on')].map((one) => {
      const mark = one.getBoundingClientRect();
      const track = document.querySelector('.track').getBoundingClientRect();
      return (mark.left + mark.width / 2 - track.left) / track.width;
    })"""
    places_mm = sorted(LENGTH_MM * share for share in page.evaluate(shares))
    assert places_mm == pytest.approx([15, 70], abs=1.5)
    expect(page.locator(".words")).to_have_text("two fingers")
    expect(page.locator(".figure.none")).to_have_count(1)  # no force: the measured one is of both


@pytest.mark.parametrize("calibrated", [True, False])
def test_the_next_step_is_in_sight(serve, open_page, screen, calibrated):
    state = PageState()
    board = {"state": "lost", "message": "", "next": "the board is disconnected; next: plug it in"}
    page = open_page(serve(state).url, **screen)
    state.put("board", board | ({"layout": None, "length_um": 85_000} if calibrated else {}))
    expect(page.locator("#next")).to_be_visible(timeout=LONG_MS)
    assert page.evaluate(IN_SIGHT, "#next")


def test_strip_and_keys_are_in_sight(bench, serve, open_page, screen):
    page = open_page(serve(bench(Held()).state).url, **screen)
    expect(page.locator(".key")).to_have_count(10, timeout=LONG_MS)
    for name in ("#figures", "#strip", ".keys"):
        assert page.evaluate(IN_SIGHT, name), name
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")


def test_the_history_is_in_mm_and_shows_the_value_at_the_pointer(bench, serve, open_page):
    held = Held()
    held.press = Press(40.0, 4000, 4.0)
    page = open_page(serve(bench(held).state).url, viewport={"width": 1440, "height": 900})
    until(page, "drawn.length > 60")
    box = page.locator("#history .layers").bounding_box()
    page.mouse.move(box["x"] + 0.98 * box["width"], box["y"] + 50)
    readout = page.locator("#history .readout")
    expect(readout).to_have_text(
        re.compile(r"^0\.\d s ago: (39\.9|40\.0)\d mm, [34]\.\d\d N$"), timeout=LONG_MS
    )
    page.mouse.move(5, 5)
    expect(readout).to_be_empty()
    page.get_by_role("button", name="Show the contrast").click()
    slider = page.get_by_role("slider", name="Time of the values")
    slider.focus()
    page.keyboard.press("ArrowLeft")
    expect(slider).to_have_attribute("aria-valuetext", re.compile("mm, .* N, contrast "))
    page.keyboard.press("Escape")
    expect(readout).to_be_empty()


@pytest.mark.parametrize(
    ("use", "panel"), [("keyboard", "keyboard"), ("wearable", "keyboard"), ("controller", "stick")]
)
def test_the_application_that_was_asked_for_is_in_sight(
    bench, serve, open_page, monkeypatch, use, panel
):
    served = []
    monkeypatch.setattr("spots_web.serve.serve", lambda state, *_: served.append(state))
    apart(show_page, use, "default", "demo", 0)
    (state,) = served
    one = bench(Held())
    one.state.put("application", state.since(state.begin())[1]["application"])
    page = open_page(serve(one.state).url)
    expect(page.locator("#stick")).to_be_visible(timeout=LONG_MS)
    expect(page.locator(".key")).to_have_count(10)
    top = "(name) => document.querySelector(name).getBoundingClientRect().top"
    for width, height in SCREENS.values():
        page.set_viewport_size({"width": width, "height": height})
        until(page, f"({IN_SIGHT})('#{panel} h2')")
        shown = ("touch", panel, *{"history", "spectrum", "keyboard", "stick"} - {panel})
        tops = [page.evaluate(top, f"#{name}") for name in shown]
        assert tops[0] < tops[1] < min(tops[2:])


def test_a_linkage_comes_first_and_fills_its_place(linkage_page, screen):
    page = linkage_page(**screen)
    assert page.evaluate(IN_SIGHT, "#panel-twin canvas")
    assert page.evaluate(IN_SIGHT, "#panel-twin .figures")
    tops = """[...document.querySelectorAll('main > section:not([hidden])')].map((one) =>
      [one.getBoundingClientRect().top, one.id])"""
    assert min(page.evaluate(tops))[1] == "panel-twin"
    # The drawing fills most of the height or of the width of its panel.
    share = """() => {
      const c = document.querySelector('#panel-twin canvas');
      const all = c.getContext('2d').getImageData(0, 0, c.width, c.height).data;
      let [left, right, top, bottom] = [c.width, 0, c.height, 0];
      for (let y = 0; y < c.height; y++) for (let x = 0; x < c.width; x++) {
        if (!all[4 * (y * c.width + x) + 3]) continue;
        left = Math.min(left, x); right = Math.max(right, x);
        top = Math.min(top, y); bottom = Math.max(bottom, y);
      }
      return Math.max((right - left) / c.width, (bottom - top) / c.height);
    }"""
    until(page, f"({share})() > 0.6")
