"""A browser with the access token edits the controller and the gestures; other clients cannot."""

from __future__ import annotations

import json
import math
import random
import re
import time

import pytest
from playwright.sync_api import expect
from support.browsing import click_opener
from support.fuzzing import fuzz_change_nothing
from support.serving import Bench, Serving, eventually, post, send_from_other_site, token_of, until

from spots.controller import controller_settings
from spots.controller.controller_settings import load
from spots.controller.one_euro import OneEuro
from spots.controller.shaping import deflection, shaped
from spots.wearable import wearable
from spots_sim.strip.scenario import Held, Press
from spots_web.editors import KINDS, SettingsEditor
from spots_web.state import PageState

LONG_MS = 60_000
DESK = {"viewport": {"width": 1440, "height": 900}}
TEXTS = {
    "controller": controller_settings.DEFAULT.read_text(encoding="utf-8"),
    "gestures": wearable.DEFAULT.read_text(encoding="utf-8"),
}


@pytest.fixture
def desk(sensor, calibration, serve, tmp_path):
    """A board, its web server with editors of settings, and the simulated finger."""

    class Desk:
        held = Held()
        paths = {name: tmp_path / f"{name}.toml" for name in KINDS}

        def __init__(self):
            self.bench = Bench(sensor, calibration, self.held, settings=self.paths)
            self.server = serve(self.bench.state, queues=self.bench.queues)

        def shown(self, part):
            return self.bench.state.since(self.bench.state.begin())[1].get(part)

        def send(self, name, message, **options):
            options = {"token": token_of(self.server)} | options
            body = message if isinstance(message, (bytes, str)) else json.dumps(message)
            return post(self.server, body, path=name, **options)

        def save(self, name, text):
            return self.send(name, {"do": "save", "text": text, "base": self.shown(name)["base"]})

        def connected(self):
            end_s = time.monotonic() + 60
            while any(self.shown(name)["stored"] is None for name in KINDS):
                assert time.monotonic() < end_s
                time.sleep(0.02)

    made = Desk()
    yield made
    made.bench.close()


def open_panel(page, name):
    click_opener(page, f"#edit-{name}")
    expect(page.locator(f"#{name} .tune").first).to_be_visible(timeout=LONG_MS)


def state(page, name="controller"):
    return page.locator(f"#{name} .state")


def slide(page, words, value):
    """Move a slider close to a value with the mouse, and exactly to it with the arrow keys."""
    slider = page.get_by_label(f"{words}, slider", exact=True)
    box = slider.bounding_box()
    if box["y"] > 800 or box["y"] < 60:
        slider.scroll_into_view_if_needed()
        box = slider.bounding_box()
    low, high = (float(slider.get_attribute(name)) for name in ("min", "max"))
    knob = 16
    x = box["x"] + knob / 2 + (value - low) / (high - low) * (box["width"] - knob)
    page.mouse.move(max(x - 30, box["x"] + knob / 2), box["y"] + box["height"] / 2)
    page.mouse.down()
    page.mouse.move(x, box["y"] + box["height"] / 2, steps=4)
    page.mouse.up()
    for _ in range(400):
        now = float(slider.input_value())
        if abs(now - value) < 1e-6:
            return
        page.keyboard.press("ArrowRight" if now < value else "ArrowLeft")
    raise AssertionError(f"{words}: {now} instead of {value}")


def test_the_settings_of_a_controller_are_found_by_sliders_only(desk, open_page):
    page = open_page(desk.server.url, **DESK)
    open_panel(page, "controller")
    slide(page, "X: Rest", 40)
    slide(page, "X: Low end", 10)
    slide(page, "X: High end", 80)
    slide(page, "X: Deadband", 0.2)
    slide(page, "X: Expo, finer near rest", 0)
    slide(page, "X: Filter: cutoff at rest", 5)
    slide(page, "Z: Full deflection from", 4000)
    slide(page, "Button 1: Press from", 3000)
    slide(page, "Button 1: Release below", 2000)
    expect(state(page)).to_have_text("not in controller.toml yet")
    # The finger moves the dot on the curve of the draft, before it is saved.
    desk.held.press = Press(0.8 * 85 - 0.1, 2000, 4.0)
    curve = page.get_by_role("img", name=re.compile(r"^Curve of axis X, now (1\.00|0\.9\d)"))
    expect(curve).to_be_visible(timeout=LONG_MS)
    page.locator("#controller").get_by_role("button", name="Save").click()
    expect(state(page)).to_have_text("saved in controller.toml", timeout=LONG_MS)
    made = load(desk.paths["controller"])
    assert (made.x.rest_percent, made.x.min_percent, made.x.max_percent) == (40, 10, 80)
    assert (made.x.deadband, made.x.expo, made.x.smooth.min_cutoff_hz) == (0.2, 0, 5)
    assert made.z.max_mN == 4000
    assert (made.button[0].press_mN, made.button[0].release_mN) == (3000, 2000)
    # The file still has all its comments, and the other lines are unchanged.
    text = desk.paths["controller"].read_text(encoding="utf-8")
    before = TEXTS["controller"].splitlines()
    assert [line.partition("#")[2] for line in text.splitlines()] == [
        line.partition("#")[2] for line in before
    ]
    assert sum(a != b for a, b in zip(text.splitlines(), before)) == 9
    # The gamepad on the page has the new settings without a restart.
    eventually(lambda: (desk.shown("stick") or {}).get("x", 0) > 0.97)
    desk.held.press = Press(0.45 * 85, 2000, 4.0)  # inside the new dead zone
    eventually(lambda: (desk.shown("stick") or {}).get("x") == 0)
    page.reload()
    expect(state(page)).to_have_text("saved in controller.toml", timeout=LONG_MS)


def test_axes_and_buttons_are_added_and_removed_and_undone(desk, open_page):
    page = open_page(desk.server.url, **DESK)
    open_panel(page, "controller")
    page.get_by_label("Y: follows").select_option("force")
    page.get_by_role("button", name="Add a button").click()
    page.get_by_label("Button 4: pressed by").select_option("tapped")
    page.get_by_role("button", name="Remove button 2").click()
    slide(page, "Y: Full deflection from", 5000)
    page.get_by_label("Y: Invert").check()
    page.get_by_label("X: follows").select_option("")
    save = page.locator("#controller").get_by_role("button", name="Save")
    # Before comments of removed lines are lost, the page asks the user.
    save.click()
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("comments of the file will be lost", timeout=LONG_MS)
    dialog.get_by_role("button", name="Cancel").click()
    assert not desk.paths["controller"].exists()
    for _ in range(10):
        if page.get_by_label("X: follows").input_value():
            break
        page.get_by_role("button", name="Undo").first.click()
    save.click()
    # The dialog is about the comments of the removed gamepad button.
    dialog.get_by_role("button", name="Save").click(timeout=LONG_MS)
    expect(state(page)).to_have_text("saved in controller.toml", timeout=LONG_MS)
    made = load(desk.paths["controller"])
    assert made.x.rest_percent == 50
    assert (made.y.max_mN, made.y.invert) == (5000, True)
    kinds = [(one.number, type(one).__name__) for one in made.button]
    assert kinds == [(1, "Pressed"), (3, "Tapped"), (4, "Tapped")]
    text = desk.paths["controller"].read_text(encoding="utf-8")
    assert "# 1-Euro filter; tune" in text
    eventually(lambda: len((desk.shown("stick") or {}).get("buttons", [])) == 4)


def test_a_wrong_setting_is_a_sentence_and_cannot_be_saved(desk, open_page):
    page = open_page(desk.server.url, **DESK)
    open_panel(page, "controller")
    slide(page, "X: Rest", 99)
    expect(state(page)).to_contain_text(
        "rest_percent must be above min_percent and below max_percent", timeout=LONG_MS
    )
    expect(page.locator("#controller").get_by_role("button", name="Save")).to_be_disabled()
    page.locator("#controller").get_by_role("button", name="Undo").click()
    expect(state(page)).not_to_contain_text("rest_percent", timeout=LONG_MS)


SLOW_NAMES = """() => {
  const now = window.fetch;
  window.fetch = async (...request) => {
    if (String(request[0]).endsWith("usages.txt")) await new Promise((go) => setTimeout(go, 1000));
    return now(...request);
  };
}"""


def test_an_action_typed_before_the_names_of_keys_arrive_is_not_lost(desk, open_page):
    page = open_page(desk.server.url, **DESK)
    page.evaluate(SLOW_NAMES)
    open_panel(page, "gestures")
    hold = page.get_by_role("combobox", name="hold", exact=True)
    expect(hold).to_have_value("SCAN_PREVIOUS_TRACK")
    hold.fill("vol")
    hold.press("Enter")
    expect(hold).to_have_value(re.compile("^VOLUME"))
    expect(state(page, "gestures")).to_have_text("not in gestures.toml yet")


def test_gestures_show_their_confidence_and_get_keys(desk, open_page):
    page = open_page(desk.server.url, **DESK)
    open_panel(page, "gestures")
    hold = page.get_by_role("combobox", name="hold", exact=True)
    hold.fill("vol")
    hold.press("Enter")
    until(page, "drawn.length > 5")
    desk.held.press = Press(40.0, 3000, 4.0)
    said = page.locator("#gestures .place")
    expect(said).to_have_text(re.compile(r"^hold, \d+ % sure: presses VOLUME"), timeout=LONG_MS)
    meter = page.get_by_role("meter", name="Confidence of the last hold")
    assert float(meter.get_attribute("aria-valuenow")) > 60
    desk.held.press = None
    slide(page, "Least confidence that presses a key", 1)
    page.locator("#gestures").get_by_role("button", name="Save").click()
    expect(state(page, "gestures")).to_have_text("saved in gestures.toml", timeout=LONG_MS)
    made = wearable.Mapping(desk.paths["gestures"])
    assert made.least_confidence == 1
    assert made.names["hold"].startswith("VOLUME")
    assert desk.paths["gestures"].read_text(encoding="utf-8").startswith("# Keys of the gestures")
    # A finger that touches while the settings change must lift first.
    until_s = desk.bench.link.now_s() + 1.0
    eventually(lambda: desk.bench.link.now_s() > until_s)
    desk.held.press = Press(40.0, 3000, 4.0)
    expect(said).to_have_text(re.compile(r"^hold, .* presses nothing"), timeout=LONG_MS)


def test_one_editor_is_open_at_a_time(desk, open_page):
    page = open_page(desk.server.url, **DESK)
    for name in ("controller", "gestures"):
        with page.expect_response(re.compile(f"/{name}$")):  # the answer to the check of the draft
            open_panel(page, name)
    expect(page.locator("#controller")).to_be_hidden()
    page.reload()
    expect(page.locator("#gestures")).to_be_visible(timeout=LONG_MS)
    expect(page.locator("#controller")).to_be_hidden()


SHAPE = """async ([axis, values]) => {
  const { deflection, shaped, oneEuro } = await import("/static/settings/axis.js");
  const filter = oneEuro();
  return values.map(([value, dt_s]) => {
    const u = deflection(value, axis.rest, axis.low ?? -Infinity, axis.high);
    return [u, shaped(u, axis), filter.take(u, dt_s, axis.smooth)];
  });
}"""


@pytest.mark.parametrize("low", [-20.0, None])
def test_the_page_shapes_a_signal_as_the_controller_does(serve, open_page, low):
    page = open_page(serve(PageState()).url)
    choice = random.Random(1)
    axis = {"rest": 3.0, "low": low, "high": 30.0, "deadband": 0.13, "expo": 0.4, "invert": True}
    axis["smooth"] = {"min_cutoff_hz": 2.5, "beta": 7.0, "derivative_cutoff_hz": 9.0}
    values = [(choice.uniform(-40, 60), choice.uniform(-0.001, 0.1)) for _ in range(200)]
    found = page.evaluate(SHAPE, [axis, values])
    filtered = OneEuro(2.5, 7.0, 9.0)
    for (value, dt_s), (u, out, smooth) in zip(values, found):
        wanted = deflection(value, 3.0, -math.inf if low is None else low, 30.0)
        assert u == pytest.approx(wanted, abs=1e-12)
        assert out == pytest.approx(shaped(wanted, 0.13, 0.4, True), abs=1e-12)
        assert smooth == pytest.approx(filtered.take(wanted, dt_s), abs=1e-12)


MESSAGES = {"do": "check"}, {"do": "save", "base": ""}


@pytest.mark.parametrize("name", KINDS)
def test_only_the_token_saves_settings(desk, name, tmp_path):
    desk.connected()
    before = desk.shown(name)
    other = {name: SettingsEditor(name, tmp_path / "b.toml", PageState())}
    old = Serving(PageState(), queues=other)
    stale = token_of(old)
    old.stop()
    for message in MESSAGES:
        message = message | {"text": TEXTS[name]}
        message |= {"base": before["base"]} if "base" in message else {}
        for token in (None, "", "wrong", stale, token_of(desk.server)[:-1]):
            assert desk.send(name, message, token=token)[0] == 403
        for origin in ("http://evil.example", "null", f"https://127.0.0.1:{desk.server.port}"):
            assert desk.send(name, message, Origin=origin)[0] == 403
        assert desk.send(name, message, Host="evil.example")[0] == 403
    assert desk.shown(name) == before
    assert not desk.paths[name].exists()
    assert desk.save(name, TEXTS[name])[0] == 204
    assert desk.paths[name].read_text(encoding="utf-8") == TEXTS[name]


def test_a_page_of_another_site_saves_no_settings(desk, browser, other_site):
    desk.connected()
    for name in KINDS:
        before = desk.shown(name)
        message = {"do": "save", "text": TEXTS[name], "base": before["base"]}
        send_from_other_site(browser, desk.server, other_site, name, json.dumps(message))
        assert desk.shown(name) == before
        assert not desk.paths[name].exists()


def test_a_second_browser_overwrites_no_settings(desk):
    desk.connected()
    base = desk.shown("controller")["base"]
    changed = TEXTS["controller"].replace("rate_hz = 125", "rate_hz = 250")
    assert desk.save("controller", changed)[0] == 204
    text = TEXTS["controller"]
    status, why = desk.send("controller", {"do": "save", "text": text, "base": base})
    assert (status, "another browser" in why) == (409, True)
    assert desk.paths["controller"].read_text(encoding="utf-8") == changed


BAD_TEXTS = {
    "controller": ("rate_hz = 5", "hold_ms = nan", "[x]\nfrom = 'smell'", "path = '/etc/passwd'"),
    "gestures": ("", "[gestures]\ntap = 'NO_SUCH'", "least_confidence = 2\n[gestures]"),
}
BAD = (
    b"",
    b"\xff\xfe",
    b"null",
    b'{"do":"save"}',
    b'{"do":"push","text":"","base":"","loses":[]}',
    b'{"do":"save","text":"","base":"","path":"/etc/passwd"}',
    b'{"do":"save","text":"","base":"123456789"}',
    b'{"do":"check","text":"\\ud800"}',
    b'{"do":"check","text":"' + b"x" * 32_769 + b'"}',
    b"[" * 1000,
)


@pytest.mark.board
@pytest.mark.parametrize("name", KINDS)
def test_a_wrong_message_of_settings_is_refused(desk, caplog, name):
    desk.connected()
    for body in BAD:
        assert desk.send(name, body)[0] == 400
    assert desk.send(name, b" " * 70_000)[0] == 413
    for text in BAD_TEXTS[name]:
        status, why = desk.save(name, text)
        assert (status, f"file {name}.toml" in why) == (409, True), why
    assert caplog.records == []
    assert not desk.paths[name].exists()


@pytest.mark.parametrize("name", KINDS)
def test_fuzzed_messages_change_no_settings(tmp_path, name):
    shown = PageState()
    editor = SettingsEditor(name, tmp_path / "mine.toml", shown)
    bodies = [json.dumps(message | {"text": TEXTS[name]}) for message in MESSAGES]
    fuzz_change_nothing(editor, shown, tmp_path, bodies)
