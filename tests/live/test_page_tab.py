"""The page `live` with the board of the tab, in a real browser."""

from __future__ import annotations

import re

import pytest
from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import expect

CONNECTED = "#board[data-state=connected]"


def place(page, mm):
    """Return a point of the drawn strip, which is 85 mm long."""
    box = page.locator("#strip .track").bounding_box()
    return box["x"] + mm / 85 * box["width"], box["y"] + box["height"] / 2


def tap(page, mm):
    """Press the strip with the mouse until the page shows position and light, then lift."""
    page.mouse.move(*place(page, mm))
    page.mouse.down()
    shown = page.locator("#figures .figure").first.locator("b")
    expect(shown).not_to_contain_text("–")
    page.wait_for_function("document.querySelector('#strip .press').classList.contains('on')")
    expect(page.locator("#spectrum .bars b").last).not_to_have_text("0")
    page.mouse.up()
    expect(page.locator("#strip .press.on")).to_have_count(0)


@pytest.fixture
def page(bridge, open_page):
    """Return the page when its board is connected."""
    opened = open_page(bridge.url)
    expect(opened.locator(CONNECTED)).to_be_visible()
    return opened


def test_pressed_keys_type(page):
    # Fails if firmware, light, decoder, keyboard reports or the panel of the keys fail in the tab.
    for mm in (12, 45, 80):
        tap(page, mm)
    expect(page.locator("#typed")).to_have_value("260")
    expect(page.locator("#keyboard .tape span")).to_have_text(["2", "6", "0"])


def test_keyboard_alone_presses(page):
    page.locator("#strip .guide").focus()
    for _ in range(3):
        page.keyboard.press("Shift+ArrowRight")
    for _ in range(4):
        page.keyboard.press("ArrowLeft")
    expect(page.locator("#strip .ring")).to_be_visible()
    page.keyboard.down(" ")
    expect(page.locator("#strip .press.on")).to_have_count(1)
    page.keyboard.up(" ")
    expect(page.locator("#typed")).to_have_value("8")  # 42.5 + 3 * 8.5 - 4 = 64 mm


def test_two_touches_on_a_phone_type_two_keys(bridge, open_page):
    page = open_page(bridge.url, viewport={"width": 390, "height": 800}, has_touch=True)
    expect(page.locator(CONNECTED)).to_be_visible()
    touch = page.context.new_cdp_session(page)

    def send(kind, *mms):
        points = [{"x": x, "y": y, "id": i} for i, (x, y) in enumerate(place(page, m) for m in mms)]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    send("touchStart", 13)
    expect(page.locator("#typed")).to_have_value("2")
    send("touchStart", 13, 64)
    expect(page.locator("#typed")).to_have_value("28")
    send("touchEnd")
    expect(page.locator("#strip .ring")).to_have_count(0)


def test_layout_and_world_change_without_a_network(page, bridge):
    # Fails if a file is loaded late, or if a press is not re-computed with drift, dust and lamp.
    page.context.set_offline(True)
    page.locator("#choose-layout").select_option("mini")
    expect(page.locator("#keyboard h2")).to_contain_text("Mini keyboard")
    tap(page, 5)
    expect(page.locator("#typed")).to_have_value(re.compile("[ehg]"))  # by its duration and force
    page.locator("#drift").fill("100")
    page.mouse.move(*place(page, 40))
    page.mouse.down()
    shown = page.locator("#figures .figure").first.locator("b")
    expect(shown).to_have_text(re.compile(r"^(37|38|42|43)\."))
    page.mouse.up()
    page.context.set_offline(False)


def test_no_request_to_another_host_and_no_serious_finding(page, bridge):
    urls = []
    page.on("request", lambda request: urls.append(request.url))
    page.reload()
    expect(page.locator(CONNECTED)).to_be_visible()
    assert urls
    assert [url for url in urls if not url.startswith(bridge.url)] == []
    for scheme in ("light", "dark"):
        page.emulate_media(color_scheme=scheme)
        found = Axe().run(page).response["violations"]
        assert [one["id"] for one in found if one["impact"] in ("serious", "critical")] == []
