"""A browser with the access token edits the key layout; other clients cannot."""

from __future__ import annotations

import json
import re
import time

import pytest
from playwright.sync_api import expect
from support.fuzzing import fuzz_change_nothing
from support.serving import (
    Bench,
    Serving,
    apart,
    eventually,
    post,
    send_from_other_site,
    token_of,
    until,
)

from spots.errors import SpotsError
from spots.keyboard.layout import compiled, load
from spots_device.board.settings import checksum
from spots_sim.strip.scenario import Held, Press
from spots_web.editors import LayoutEditor
from spots_web.state import PageState

LONG_MS = 60_000
SPEED = 0.3  # of the board's time, so slow that a tap on a slow machine does not become a hold
TAP_S = 0.08  # duration of a tap in the board's time
ON_BOARD = re.compile("^on the board")
MINI = load("mini")
DIGITS = load("digits")
SLOTS = {"tap": "tap", "firm": "firm press", "hold": "hold"}


@pytest.fixture
def desk(sensor, calibration, serve, tmp_path):
    """A board, its web server with a layout editor, and the simulated finger."""

    class Desk:
        held = Held()
        path = tmp_path / "mine.toml"

        def __init__(self):
            self.bench = Bench(sensor, calibration, self.held, edit=self.path, speed=SPEED)
            self.editor = self.bench.queues["layout"]
            self.server = serve(self.bench.state, queues=self.bench.queues)

        def shown(self, part="editor"):
            return self.bench.state.since(self.bench.state.begin())[1].get(part)

        def send(self, message, **options):
            options = {"token": token_of(self.server)} | options
            body = message if isinstance(message, (bytes, str)) else json.dumps(message)
            return post(self.server, body, path="layout", **options)

        def push(self, layout, loses=()):
            message = {"text": layout.text, "base": self.shown()["base"], "loses": list(loses)}
            return self.send({"do": "push", **message})

        def connected(self):
            end_s = time.monotonic() + 60
            while self.shown()["stored"] is None:
                assert time.monotonic() < end_s
                time.sleep(0.02)

        def on_board(self):
            return apart(lambda: self.bench.board.command("hello")["layout"])

    made = Desk()
    yield made
    made.bench.close()


def open_editor(page):
    page.locator("#edit").click(timeout=LONG_MS)
    expect(page.locator("#editor .zone").first).to_be_visible(timeout=LONG_MS)


def choose(page, name, typed):
    """Search for an action in the field `name`, and choose it with the keyboard."""
    field = page.get_by_role("combobox", name=name, exact=True)
    field.fill(typed)
    field.press("Enter")


def fill_keys(page, keys):
    """Add a zone for each key of a layer in a layout file, and set its actions and its text."""
    for _ in keys[1:]:
        page.get_by_role("button", name="Add a zone").click()
    for i, key in enumerate(keys):
        page.locator("#editor .zone").nth(i).click()
        key = {"tap": key} if isinstance(key, str) else key
        for slot, words in SLOTS.items():
            if slot in key:
                choose(page, words, key[slot])
        if "label" in key:
            page.get_by_label("Text on the key").fill(key["label"])
            page.get_by_label("Text on the key").press("Enter")


def state(page):
    return page.locator("#editor .state")


def tap(desk, page, share, key, force_mN=3000):
    """Tap the strip at a share of its length; wait until the page shows the typed `key`."""
    tape = page.locator(".tape .key-event")
    for press in (Press(85.0 * share, force_mN, 4.0), None):
        until_s = desk.bench.link.now_s() + TAP_S
        desk.held.press = press
        eventually(lambda until_s=until_s: desk.bench.link.now_s() > until_s, every_s=0.005)
    expect(tape.last).to_have_text(key, timeout=LONG_MS)


def test_mini_from_nothing_is_typed_on_undone_and_survives_a_reload(desk, open_page):
    page = open_page(desk.server.url)
    open_editor(page)
    page.get_by_role("button", name="New").click()
    page.get_by_label("Name of the layout").fill(MINI.name)
    page.get_by_role("button", name="Add a layer").click()
    page.get_by_label("Name of the layer").fill("more")
    page.get_by_label("Name of the layer").press("Enter")
    fill_keys(page, MINI.content["layer"][1]["keys"])
    page.get_by_role("button", name="keys", exact=True).click()
    page.get_by_label("Name of the layer").fill("letters")
    page.get_by_label("Name of the layer").press("Enter")
    fill_keys(page, MINI.content["layer"][0]["keys"])
    page.get_by_text("Tuning").click()
    page.get_by_label("A longer touch is a hold, ms").fill("250")
    page.get_by_label("A longer touch is a hold, ms").press("Enter")
    expect(state(page)).to_have_text("not on the board yet", timeout=LONG_MS)
    page.get_by_role("button", name="Put on the board").click()
    expect(state(page)).to_have_text(ON_BOARD, timeout=LONG_MS)
    pushed_s = desk.bench.link.now_s()
    made = load(desk.path)
    assert made.lines == MINI.lines
    assert made.content["layer"] == MINI.content["layer"]
    # The board types with the new layout, without a restart.
    eventually(lambda: desk.shown("board")["layout"]["name"] == MINI.name)
    until(page, "drawn.length > 5")
    # The new exposure needs a new dark frame, before which no touch is a key.
    eventually(lambda: desk.bench.link.now_s() > pushed_s + 2.0)
    tap(desk, page, 0.5 / 9, "E")
    tap(desk, page, 6.5 / 9, "S")
    # After an undo, the page shows a draft, and the layout of the board does not change.
    page.get_by_role("button", name="Undo").click()
    expect(state(page)).to_have_text("not on the board yet", timeout=LONG_MS)
    page.reload()
    expect(state(page)).to_have_text("not on the board yet", timeout=LONG_MS)
    page.get_by_role("button", name="Redo").click()
    expect(state(page)).to_have_text(ON_BOARD, timeout=LONG_MS)
    assert load(desk.path).lines == MINI.lines
    tap(desk, page, 3.5 / 9, "O")


def test_a_board_that_returns_does_not_move_the_page_under_a_click(desk, open_page):
    page = open_page(desk.server.url)
    open_editor(page)
    expect(page.locator(".key")).to_have_count(10, timeout=LONG_MS)
    until(page, "drawn.length > 0")
    desk.bench.unplug()
    expect(page.locator("#next")).to_be_visible()
    page.evaluate("scrollTo(0, document.body.scrollHeight)")
    box = page.get_by_text("Tuning").bounding_box()
    page.mouse.move(box["x"] + 30, box["y"] + box["height"] / 2)
    page.mouse.down()
    desk.bench.replug()
    expect(page.locator("#next")).to_be_hidden()
    page.mouse.up()
    expect(page.get_by_label("A longer touch is a hold, ms")).to_be_visible()


def test_a_border_is_dragged_and_moved_by_keys(desk, open_page):
    page = open_page(desk.server.url, viewport={"width": 1440, "height": 900})
    open_editor(page)
    border = page.get_by_role("separator", name="Border between zones 1 and 2")
    row = page.locator("#editor .zones").bounding_box()
    y = row["y"] + row["height"] / 2
    page.mouse.move(row["x"] + 0.1 * row["width"], y)
    page.mouse.down()
    for share in (0.11, 0.12, 0.13, 0.15):
        page.mouse.move(row["x"] + share * row["width"], y)
    page.mouse.up()
    assert float(border.get_attribute("aria-valuenow")) == pytest.approx(0.15 * 85, abs=0.15)
    border.focus()
    page.keyboard.press("ArrowLeft")
    assert float(border.get_attribute("aria-valuenow")) == pytest.approx(0.15 * 85 - 0.5, abs=0.15)
    page.get_by_role("button", name="Put on the board").click()
    expect(state(page)).to_have_text(ON_BOARD, timeout=LONG_MS)
    first, second, *others = load(desk.path).layers["digits"]
    assert first.high == second.low == pytest.approx(0.15 - 0.5 / 85, abs=0.001)
    assert [key.low for key in others] == pytest.approx([i / 10 for i in range(2, 10)], abs=1e-4)
    # One undo reverses the whole drag.
    page.get_by_role("button", name="Undo").click()
    page.get_by_role("button", name="Undo").click()
    assert float(border.get_attribute("aria-valuenow")) == 8.5
    expect(page.get_by_role("button", name="Undo")).to_be_disabled()


def test_a_draft_is_tried_before_it_is_pushed(desk, open_page):
    page = open_page(desk.server.url, viewport={"width": 1440, "height": 900})
    open_editor(page)
    page.get_by_text("Tuning").click()
    expect(page.get_by_role("img", name=re.compile("^Force of the last seconds"))).to_be_visible()
    page.locator("#editor .zone").nth(2).click()
    choose(page, "tap", "volume_inc")
    expect(state(page)).to_have_text(  # the server has checked this draft
        "not on the board yet; nothing will type THREE", timeout=LONG_MS
    )
    tried = page.locator("#editor .trial span")
    until(page, "drawn.length > 5")
    tap(desk, page, 0.25, "3")  # the layout of the board has not changed
    expect(tried.last).to_have_text("volume increment", timeout=LONG_MS)
    # A change of the forces and times has an effect on the next touch.
    with page.expect_response(re.compile("/layout$")):
        page.get_by_label("Force that begins a touch, mN").fill("9000")
        page.get_by_label("Force that begins a touch, mN").press("Enter")
    tap(desk, page, 0.35, "4")
    expect(tried).to_have_count(1)
    with page.expect_response(re.compile("/layout$")):
        for _ in range(2):
            page.locator("#editor").get_by_role("button", name="Undo").click()
    tap(desk, page, 0.45, "5")
    expect(tried.last).to_have_text("5", timeout=LONG_MS)  # the key of the board's layout
    assert desk.on_board() is None


def test_what_could_be_typed_is_lost_only_after_a_question(desk, open_page):
    page = open_page(desk.server.url)
    open_editor(page)
    page.locator("#editor .zone").nth(2).click()
    choose(page, "tap", "volume_inc")
    expect(state(page)).to_have_text(
        "not on the board yet; nothing will type THREE", timeout=LONG_MS
    )
    page.get_by_role("button", name="Put on the board").first.click()
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("With this layout, no key types: THREE.", timeout=LONG_MS)
    dialog.get_by_role("button", name="Cancel").click()
    assert not desk.path.exists()
    assert desk.on_board() is None
    page.get_by_role("button", name="Put on the board").first.click()
    dialog.get_by_role("button", name="Put it on the board").click()
    expect(state(page)).to_have_text(ON_BOARD, timeout=LONG_MS)
    assert desk.shown()["stored"] == "this"
    # One click restores the default keys on the board; the file and the draft do not change.
    page.get_by_role("button", name="default keys").click()
    expect(page.locator("#clear")).to_be_hidden(timeout=LONG_MS)
    assert desk.on_board() is None
    assert "VOLUME_INCREMENT" in desk.path.read_text()
    expect(page.locator("#editor .zone").nth(2)).to_contain_text("VOLUME")
    expect(state(page)).to_contain_text("the board has its default layout again")
    eventually(lambda: desk.shown("board")["layout"]["name"] == DIGITS.name)
    # A later layout is compared with the file, which it would replace.
    page.locator("#editor .zone").nth(2).click()
    choose(page, "tap", "F5")
    page.get_by_role("button", name="Put on the board").first.click()
    expect(dialog).to_contain_text("no key types: VOLUME_INCREMENT.", timeout=LONG_MS)
    dialog.get_by_role("button", name="Cancel").click()
    assert "VOLUME_INCREMENT" in desk.path.read_text()
    assert desk.on_board() is None


RULED = {
    "layer": [
        {
            "name": "keys",
            "keys": [
                {
                    "tap": "S",
                    "hold": "LEFT_SHIFT",
                    "flavor": "tap-preferred",
                    "tapping_term_ms": 300,
                    "retro_tap": True,
                },
                {"tap": "tap_dance twice", "slide_plus": "momentary more"},
                "mod_morph morph1",
                "key_repeat",
            ],
        },
        {"name": "more", "keys": ["caps_word"]},
    ],
    "tap_dance": {"twice": {"actions": ["A", "B", "sticky more"], "holds": ["", "LEFT_ALT"]}},
    "mod_morph": {
        "morph1": {
            "action": "BACKSPACE",
            "morphed": "DELETE",
            "mods": ["LEFT_SHIFT", "RIGHT_SHIFT"],
            "keep_mods": ["RIGHT_SHIFT"],
        }
    },
}


def test_rules_of_a_hold_tap_dances_and_mod_morphs_are_edited(desk, open_page):
    page = open_page(desk.server.url)
    open_editor(page)
    page.get_by_role("button", name="New").click()
    page.get_by_role("button", name="Add a layer").click()
    page.get_by_label("Name of the layer").fill("more")
    page.get_by_label("Name of the layer").press("Enter")
    choose(page, "tap", "caps_word")
    page.get_by_role("button", name="keys", exact=True).click()
    # The rule of a hold, with its picture.
    rule, picture = page.locator("#editor .hold-rule"), page.locator("#editor .timing title")
    expect(rule).to_be_hidden()
    choose(page, "tap", "S")
    choose(page, "hold", "LEFT_SHIFT")
    expect(picture).to_have_text("balanced")
    page.get_by_label("Decided by").select_option("tap-preferred")
    expect(picture).to_have_text("tap-preferred")
    expect(page.locator("#editor .timing .gets-tap")).to_have_count(3)
    page.get_by_label("Hold after, ms").fill("300")
    page.get_by_label("Hold after, ms").press("Enter")
    page.get_by_label("Without another key, always a tap").check()
    expect(picture).to_have_text("tap-preferred, retro_tap")
    # A tap dance gets a third tap, a hold, and another name; a removed one leaves no action.
    page.get_by_text("Tap dances and mod-morphs").click()
    page.get_by_role("button", name="Add a tap dance").click()
    page.get_by_role("button", name="One more tap").click()
    page.get_by_role("button", name="Add a zone").click()
    choose(page, "tap", "tap_dance dance1")
    for name, action in {
        "1 tap": "A",
        "2 taps": "B",
        "3 taps": "sticky more",
        "2 taps, the last one held": "LEFT_ALT",
        "slide away": "momentary more",
    }.items():
        choose(page, name, action)
    page.get_by_label("Name of the tap dance").fill("twice")
    page.get_by_label("Name of the tap dance").press("Enter")
    expect(page.get_by_role("combobox", name="tap", exact=True)).to_have_value("tap_dance twice")
    page.get_by_role("button", name="Add a mod-morph").click()
    page.get_by_role("button", name="Add a zone").click()
    choose(page, "tap", "mod_morph morph1")
    choose(page, "without the modifiers", "BACKSPACE")
    choose(page, "with one of them", "DELETE")
    page.get_by_role("group", name="Modifiers", exact=True).get_by_label("RIGHT_SHIFT").check()
    page.get_by_role("group", name="Modifiers that stay down").get_by_label("RIGHT_SHIFT").check()
    page.get_by_role("button", name="Add a mod-morph").click()
    page.get_by_role("button", name="Add a zone").click()
    choose(page, "tap", "mod_morph morph2")
    never = page.get_by_role("list", name="What can never be typed")
    expect(never).to_be_hidden()
    choose(page, "tap", "key_repeat")
    expect(never).to_contain_text("[mod_morph.morph2] can never be typed", timeout=LONG_MS)
    choose(page, "tap", "mod_morph morph2")
    page.get_by_role("button", name="Remove morph2").click()
    expect(never).to_be_hidden(timeout=LONG_MS)
    expect(page.get_by_role("combobox", name="tap", exact=True)).to_have_value("")
    choose(page, "tap", "key_repeat")
    page.get_by_role("button", name="Put on the board").click()
    dialog = page.get_by_role("dialog")
    dialog.get_by_role("button", name="Put it on the board").click(timeout=LONG_MS)
    expect(state(page)).to_have_text(ON_BOARD, timeout=LONG_MS)
    content = load(desk.path).content
    del content["name"]
    assert content == RULED
    # Without its hold, a key has no rule.
    page.locator("#editor .zone").first.click()
    choose(page, "hold", "")
    expect(rule).to_be_hidden()
    expect(state(page)).to_contain_text("not on the board yet", timeout=LONG_MS)


def test_characters_and_texts_of_the_computer_are_found_and_marked(desk, open_page):
    page = open_page(desk.server.url)
    open_editor(page)
    page.get_by_role("button", name="New").click()
    tap = page.get_by_role("combobox", name="tap", exact=True)
    options = page.get_by_role("option")
    # Names, their aliases and characters.
    tap.fill("vol_up")
    expect(options.first).to_contain_text("VOLUME_INCREMENT")
    # The Enter that ends a word of an input method chooses nothing.
    tap.dispatch_event("keydown", {"key": "Enter", "isComposing": True})
    expect(tap).to_have_value("vol_up")
    expect(options.first).to_be_visible()
    tap.fill("cmd+bspc")
    expect(options.first).to_contain_text("LEFT_GUI+BACKSPACE")
    tap.fill("ä")
    expect(options.first).to_have_text("ächoose the layout of your computer first")
    expect(options.first).to_be_disabled()
    tap.press("Escape")
    page.get_by_label("Keyboard layout of your computer").select_option("de")
    page.get_by_label("Operating system").select_option("linux")
    expect(state(page)).to_contain_text("nothing will type", timeout=LONG_MS)
    choose(page, "tap", "ä")
    choose(page, "hold", "ctrl+/")
    tap.fill("ж")
    expect(options.first).to_have_text("жnot on the host de")
    tap.press("Enter")
    tap.press("Escape")
    expect(tap).to_have_value("ä")
    # A text; what the computer does not type is marked while somebody writes.
    page.get_by_role("button", name="Add a zone").click()
    text = page.get_by_label("Text that a tap types")
    text.press_sequentially("Grüße, ж")
    note = page.locator("#editor .zone-form > .place")
    expect(note).to_have_text("the host de does not type: ж")
    expect(text).to_have_attribute("aria-invalid", "true")
    text.fill("Grüße,\n€ 5")
    expect(note).to_have_text("")
    text.blur()
    expect(page.locator("#editor .zone b").nth(1)).to_have_text("Grüße, € 5")
    page.get_by_role("button", name="Put on the board").click()
    dialog = page.get_by_role("dialog")
    dialog.get_by_role("button", name="Put it on the board").click(timeout=LONG_MS)
    expect(dialog).to_contain_text("A touch types each of these texts", timeout=LONG_MS)
    expect(dialog).to_contain_text("text Grüße,\\n€ 5")
    dialog.get_by_role("button", name="Put it on the board").click()
    expect(state(page)).to_have_text(ON_BOARD, timeout=LONG_MS)
    made = load(desk.path).content
    assert (made["host"], made["os"]) == ("de", "linux")
    keys = [{"tap": "ä", "hold": "LEFT_CONTROL+/"}, {"text": "Grüße,\n€ 5"}]
    assert made["layer"] == [{"name": "keys", "keys": keys}]
    # A tap in place of the text.
    choose(page, "tap", "del")
    expect(text).to_have_value("")
    expect(tap).to_have_value("DELETE")


COMMENTED = """# Mine.
# For the left hand.
name = "Mine"  # a good name

[[layer]]
name = "only"
keys = [
  "A",
  "C",  # C
  {tap = "B", label = "#"},
]
"""


def test_comments_survive_and_a_lost_one_is_asked_about(desk, open_page, tmp_path):
    page = open_page(desk.server.url)
    open_editor(page)
    given = tmp_path / "given.toml"
    given.write_text(COMMENTED)
    page.get_by_label("Layout file to import").set_input_files(given)
    expect(page.locator("#editor .zone b")).to_have_text(["A", "C", "#"], timeout=LONG_MS)
    page.get_by_label("Name of the layout").fill("Yours")
    page.get_by_label("Name of the layout").press("Enter")
    with page.expect_download() as got:
        page.get_by_role("button", name="Export").click()
    text = got.value.path().read_text(encoding="utf-8")
    assert text == COMMENTED.replace('name = "Mine"', 'name = "Yours"')
    # The comment of a removed zone is lost.
    page.locator("#editor .zone").nth(1).click()
    page.get_by_role("button", name="Remove the zone").click()
    page.get_by_role("button", name="Export").click()
    dialog = page.get_by_role("dialog")
    expect(dialog).to_contain_text("1 comment of the file will be lost.", timeout=LONG_MS)
    with page.expect_download() as got:
        dialog.get_by_role("button", name="Export").click()
    text = got.value.path().read_text(encoding="utf-8")
    assert "# For the left hand." in text
    assert "# C" not in text
    page.get_by_role("button", name="Undo").first.click()
    given.write_text("keys = 3")
    page.get_by_label("Layout file to import").set_input_files(given)
    expect(state(page)).to_contain_text("given.toml: layout mine.toml", timeout=LONG_MS)
    expect(page.locator("#editor .zone")).to_have_count(3)


def test_an_unchanged_file_keeps_all_its_comments(desk):
    desk.connected()
    layout = compiled(desk.path, COMMENTED)
    loses = json.loads(desk.push(layout)[1])["loses"]
    assert loses[:2] == ["ONE", "TWO"]
    assert not desk.path.exists()
    assert json.loads(desk.push(layout, loses[1:])[1])["loses"] == loses
    assert json.loads(desk.push(layout, loses)[1])["loses"] == []
    assert desk.path.read_text() == COMMENTED
    assert desk.shown()["stored"] == "this"


@pytest.mark.board
def test_a_layout_that_this_program_does_not_know_is_replaced_only_after_a_question(desk):
    desk.connected()
    apart(lambda: desk.bench.board.command("layout begin"))
    for line in MINI.lines:
        apart(lambda line=line: desk.bench.board.command("layout " + line))
    apart(lambda: desk.bench.board.command("layout end " + checksum(MINI.lines)))
    loses = json.loads(desk.push(DIGITS)[1])["loses"]
    assert len(loses) == 1
    assert "does not know" in loses[0]
    assert json.loads(desk.push(DIGITS, loses)[1])["loses"] == []


def test_a_board_that_is_a_keyboard_itself_lights_its_keys(desk, open_page):
    desk.connected()
    page = open_page(desk.server.url)
    apart(lambda: desk.push(MINI))
    expect(page.locator(".key")).to_have_count(9, timeout=LONG_MS)
    for count, name in ((9, "E"), (10, "1")):
        expect(page.locator(".key")).to_have_count(count, timeout=LONG_MS)
        until(page, "drawn.length > 5")
        until_s = desk.bench.link.now_s() + TAP_S
        eventually(lambda until_s=until_s: desk.bench.link.now_s() > until_s)
        desk.held.press = Press(3.0, 3000, 4.0)
        expect(page.locator(".key.lit")).to_contain_text(name[-1], timeout=LONG_MS)
        desk.held.press = None
        expect(page.locator(".key.lit")).to_have_count(0, timeout=LONG_MS)
        if count == 9:
            assert desk.send({"do": "clear"})[0] == 204


def test_a_second_browser_overwrites_nothing(desk):
    desk.connected()
    base = desk.shown()["base"]
    assert desk.push(MINI)[0] == 200
    status, text = desk.send({"do": "push", "text": DIGITS.text, "base": base, "loses": []})
    assert (status, "another browser" in text) == (409, True)
    assert desk.path.read_text() == MINI.text


def test_without_the_token_there_is_no_editor(desk, open_page):
    page = open_page(f"http://127.0.0.1:{desk.server.port}/")
    expect(page.locator(".key")).to_have_count(10, timeout=LONG_MS)
    for name in ("#edit", "#clear", "#editor"):
        expect(page.locator(name)).to_be_hidden()


MESSAGES = (
    {"do": "check", "text": MINI.text},
    {"do": "check", "text": MINI.text, "content": MINI.content},
    {"do": "check", "content": MINI.content},
    {"do": "push", "text": MINI.text, "base": "", "loses": []},
    {"do": "clear"},
)


@pytest.mark.board
def test_only_the_token_edits(desk, tmp_path):
    desk.connected()
    before, stored = desk.shown(), desk.on_board()
    other = {"layout": LayoutEditor(tmp_path / "b.toml", DIGITS, PageState())}
    old = Serving(PageState(), queues=other)
    stale = token_of(old)
    old.stop()
    for message in MESSAGES:
        message = message | ({"base": before["base"]} if "base" in message else {})
        for token in (None, "", "wrong", stale, token_of(desk.server)[:-1]):
            assert desk.send(message, token=token)[0] == 403
        for origin in ("http://evil.example", "null", f"https://127.0.0.1:{desk.server.port}"):
            assert desk.send(message, Origin=origin)[0] == 403
        assert desk.send(message, Host="evil.example")[0] == 403
    assert (desk.shown(), desk.on_board()) == (before, stored)
    assert not desk.path.exists()


def test_a_page_of_another_site_changes_no_layout(desk, browser, other_site):
    desk.connected()
    before = desk.shown()
    push = {"do": "push", "text": MINI.text, "base": before["base"], "loses": []}
    messages = json.dumps(push), json.dumps({"do": "clear"})
    send_from_other_site(browser, desk.server, other_site, "layout", *messages)
    assert desk.shown() == before
    assert not desk.path.exists()


BAD = (
    b"",
    b"clear",
    b"\xff\xfe",
    b"null",
    b"[]",
    b"{}",
    b'{"do":"push"}',
    b'{"do":"save"}',
    b'{"do":["clear"]}',
    b'{"do":"clear","path":"/etc/passwd"}',
    b'{"do":"check","text":3}',
    b'{"do":"check","content":[]}',
    b'{"do":"check","text":"\\ud800"}',
    b'{"do":"check","text":"' + b"x" * 32_769 + b'"}',
    b'{"do":"push","text":"","base":"123456789","loses":[]}',
    b'{"do":"push","text":"","base":"","loses":"all"}',
    b'{"do":"push","text":"","base":"","loses":[1]}',
    b"[" * 1000,
)


def test_the_characters_of_a_computer_are_returned_and_an_unknown_host_is_refused(desk):
    status, text = desk.send({"do": "characters", "host": "de", "os": "windows"})
    assert status == 200
    assert set("äß€z") <= set(json.loads(text)["characters"])
    assert "ä" not in json.loads(desk.send({"do": "characters"})[1])["characters"]
    status, text = desk.send({"do": "characters", "host": "xx"})
    assert (status, text[:26]) == (409, "there is no host 'xx': use")


def test_invalid_messages_are_refused(desk, caplog):
    for body in BAD:
        assert desk.send(body)[0] == 400, body
    assert caplog.records == []
    assert not desk.path.exists()


def test_long_messages_are_refused(desk):
    assert desk.send(b" " * 70_000)[0] == 413


@pytest.mark.board
def test_fuzzed_messages_change_nothing(tmp_path):
    state = PageState()
    editor = LayoutEditor(tmp_path / "mine.toml", DIGITS, state)
    fuzz_change_nothing(editor, state, tmp_path, [json.dumps(message) for message in MESSAGES])


@pytest.mark.parametrize(
    "text",
    [
        "a." * 16_000 + "b = 1",
        "[" * 30_000,
        "a = " + "[" * 30_000,
        'a = "' + "\\\\" * 15_000,
        "\n" * 32_000,
        'name = "x"\n' + '[[layer]]\nname = "a"\nkeys = ["A"]\n' * 800,
        'name = "x"\n[[layer]]\nname = "a"\nkeys = [' + '"A",' * 8000 + "]",
    ],
)
def test_the_longest_texts_are_refused(tmp_path, text):
    editor = LayoutEditor(tmp_path / "mine.toml", DIGITS, PageState())
    answer = editor.submit(editor.decode(json.dumps({"do": "check", "text": text}).encode()))
    assert isinstance(answer.exception(), SpotsError)
