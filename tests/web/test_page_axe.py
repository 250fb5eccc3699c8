"""Accessibility: axe-core reports no serious problem, and the keyboard reaches all controls."""

from __future__ import annotations

import pytest
from axe_playwright_python.base import AXE_SCRIPT
from playwright.sync_api import expect
from support.screens import SCREENS
from support.serving import Bench, until

from spots.link.board import Board
from spots.recording.recorder import Recorder
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.scenario import Held, Press
from spots_web.board_feed import _NEXT
from spots_web.editors import KINDS
from spots_web.state import PageState

LONG_MS = 60_000
ALL = {"resultTypes": ["violations"]}
# In the dark scheme only colours differ, so only the rules about colours run. They are selected by
# id: a selection by tag would include stricter rules, too.
SCHEMES = {"light": ALL, "dark": ALL | {"runOnly": ["color-contrast", "link-in-text-block"]}}


def serious(page):
    """Return scheme, rule, element and remedy of each serious problem that axe-core reports."""
    found = []
    page.evaluate(f"() => {{ if (!window.axe) {{ {AXE_SCRIPT} }} }}")
    for scheme, options in SCHEMES.items():
        page.emulate_media(color_scheme=scheme)
        found += [
            (scheme, one["id"], node["target"], node["failureSummary"])
            for one in page.evaluate("(options) => axe.run(options)", options)["violations"]
            if one["impact"] in ("serious", "critical")
            for node in one["nodes"]
        ]
    return found


def test_a_strip_with_its_keys(bench, serve, open_page):
    held = Held()
    held.press = Press(40.0, 3000, 4.0)
    page = open_page(serve(bench(held).state).url)
    for width, height in (SCREENS["desk"], SCREENS["phone"]):
        page.set_viewport_size({"width": width, "height": height})
        page.evaluate("drawn.length = 0")
        until(page, "drawn.length > 5")
        assert serious(page) == [], (width, height)


def test_an_editor_of_keys(bench, serve, open_page, tmp_path):
    held = Held()
    one = bench(held, edit=tmp_path / "mine.toml", layout="mini")
    page = open_page(serve(one.state, queues=one.queues).url)
    page.locator("#edit").click(timeout=LONG_MS)
    until(page, "drawn.length > 20")
    page.get_by_text("Tuning").click()
    held.press = Press(40.0, 3000, 4.0)
    expect(page.locator("#editor .zone.lit")).to_have_count(1, timeout=LONG_MS)
    assert serious(page) == []
    page.get_by_role("combobox", name="hold", exact=True).fill("vol")
    expect(page.get_by_role("option").first).to_be_visible()
    assert serious(page) == []
    page.keyboard.press("Escape")
    page.get_by_role("button", name="New").click()
    page.get_by_role("button", name="Put on the board").click()
    expect(page.get_by_role("dialog")).to_be_visible(timeout=LONG_MS)
    assert serious(page) == []


def test_two_strips(bench, serve, open_page, tmp_path):
    second = Held()
    second.press = Press(40.0, 3000, 4.0)
    one = bench(Held(), second=second, edit=tmp_path / "mine.toml")
    page = open_page(serve(one.state, queues=one.queues).url)
    expect(page.locator("#beside .press.on")).to_have_count(1, timeout=LONG_MS)
    assert serious(page) == []
    page.get_by_role("button", name="strip 0", exact=True).focus()
    page.keyboard.press("Tab")
    page.keyboard.press("Enter")
    chosen = page.get_by_role("button", name="strip 1", exact=True)
    expect(chosen).to_have_attribute("aria-pressed", "true", timeout=LONG_MS)
    expect(page.locator("#touch .press.on")).to_have_count(1, timeout=LONG_MS)
    assert serious(page) == []


@pytest.mark.parametrize("name", KINDS)
def test_an_editor_of_settings(bench, serve, open_page, tmp_path, name):
    held = Held()
    one = bench(held, settings={name: tmp_path / "mine.toml"})
    page = open_page(serve(one.state, queues=one.queues).url)
    page.locator(f"#edit-{name}").click(timeout=LONG_MS)
    until(page, "drawn.length > 20")
    held.press = Press(40.0, 6000, 4.0)
    lit = {"controller": "#controller .card.lit", "gestures": "#gestures .last"}[name]
    expect(page.locator(lit)).to_have_count(1, timeout=LONG_MS)
    assert serious(page) == []


def test_recordings(bench, serve, open_page, sensor, tmp_path):
    for name in "ab":
        with Board(LockstepLink(sensor, Held())) as board:
            board.command("stream touch")
            with Recorder(board, tmp_path / f"{name}.spots"):
                next(board.frames(0.1))
    one = bench(Held(), record_to=tmp_path)
    page = open_page(serve(one.state, queues=one.queues).url)
    page.locator("#open-recordings").click(timeout=LONG_MS)
    page.get_by_label("Compare a.spots").check(timeout=LONG_MS)
    page.get_by_label("Compare b.spots").check()
    compare = page.get_by_role("button", name="Compare", exact=True)
    compare.focus()
    page.keyboard.press("Enter")
    expect(page.locator("#recordings canvas").first).to_be_visible(timeout=LONG_MS)
    assert serious(page) == []
    assert reached(page, "recordings") == 0


def test_a_linkage(linkage_page):
    assert serious(linkage_page()) == []


@pytest.mark.parametrize("state", _NEXT)
def test_a_board_that_cannot_be_read(serve, open_page, state):
    shown = PageState()
    shown.put("board", {"state": state, "message": "a reason", "next": _NEXT[state]})
    page = open_page(serve(shown).url)
    expect(page.locator("#next")).to_be_visible(timeout=LONG_MS)
    page.wait_for_timeout(500)  # the panels change their colours gradually
    assert serious(page) == []


def test_a_calibration(sensor, serve, open_page, tmp_path):
    one = Bench(sensor, None, Held(), session=tmp_path / "calibration.jsonl")
    try:
        page = open_page(serve(one.state, queues=one.queues).url)
        start = page.locator("#calibration .kind[value=rough]")
        start.wait_for(timeout=LONG_MS)
        assert serious(page) == []
        start.click()
        expect(page.locator("#calibration .todo")).to_contain_text("ress", timeout=LONG_MS)
        assert serious(page) == []
    finally:
        one.close()


def reached(page, panel):
    """Press Tab repeatedly; return how many controls of a panel never got the focus."""
    wanted = page.evaluate(
        f"""[...document.querySelectorAll(
          '#{panel} :is(button, input, select, textarea, summary, [role=separator])'
        )].filter((one) => one.checkVisibility() && !one.disabled && one.tabIndex >= 0).length"""
    )
    page.evaluate(
        f"""() => {{
          const panel = document.getElementById("{panel}");
          window.reached = new Set();
          panel.addEventListener("focusin", ({{ target }}) => reached.add(target));
        }}"""
    )
    for _ in range(2):
        for _ in range(wanted):
            page.keyboard.press("Tab")
        if (found := page.evaluate("reached.size")) == wanted:
            break
    return wanted - found


@pytest.mark.parametrize("name", KINDS)
def test_the_keyboard_reaches_all_settings(bench, serve, open_page, tmp_path, name):
    one = bench(Held(), settings={name: tmp_path / "mine.toml"})
    page = open_page(serve(one.state, queues=one.queues).url)
    page.locator(f"#edit-{name}").wait_for(timeout=LONG_MS)
    page.locator(f"#edit-{name}").focus()
    page.keyboard.press("Enter")
    expect(page.locator(f"#{name} .tune").first).to_be_visible(timeout=LONG_MS)
    slider = page.locator(f"#{name} input[type=range]").first
    slider.focus()
    page.keyboard.press("ArrowRight")
    save = page.locator(f"#{name}").get_by_role("button", name="Save")
    expect(save).to_be_enabled(timeout=LONG_MS)
    assert reached(page, name) == 0
    save.focus()
    page.keyboard.press("Enter")
    expect(page.locator(f"#{name} .state")).to_have_text("saved in mine.toml", timeout=LONG_MS)


def test_the_keyboard_reaches_everything_of_the_editor(bench, serve, open_page, tmp_path):
    one = bench(Held(), edit=tmp_path / "mine.toml", layout="mini")
    page = open_page(serve(one.state, queues=one.queues).url)
    page.locator("#edit").wait_for(timeout=LONG_MS)
    page.locator("#edit").focus()
    page.keyboard.press("Enter")
    expect(page.locator("#editor .zone").first).to_be_visible(timeout=LONG_MS)
    push = page.get_by_role("button", name="Put on the board")
    expect(push).to_be_enabled(timeout=LONG_MS)
    for part in ("tuning", "behaviours"):
        page.locator(f"#editor .{part} summary").focus()
        page.keyboard.press("Enter")
    for kind in ("tap dance", "mod-morph"):
        page.get_by_role("button", name=f"Add a {kind}").click()
        expect(page.get_by_label(f"Name of the {kind}")).to_be_visible()
    expect(page.get_by_label("Force of a firm press, mN")).to_be_visible()
    assert reached(page, "editor") == 0
    # The arrow keys reach the zones and borders that Tab skips.
    page.locator("#editor .zone[tabindex='0']").focus()
    page.keyboard.press("End")
    expect(page.locator("#editor legend").first).to_contain_text("Zone 9 of 9")
    page.keyboard.press("ArrowLeft")
    expect(page.locator("#editor legend").first).to_contain_text("Zone 8 of 9")
