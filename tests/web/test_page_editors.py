"""The editors of the web UI lose nothing: of other programs, on a full disk, or after an error."""

from __future__ import annotations

import codecs
import errno
import json
import os
import re

import pytest
from playwright.sync_api import expect
from support.browsing import click_opener
from support.refusals import refusal
from support.serving import Bench, apart, eventually, post, token_of

from spots.cli import main
from spots.controller import controller_settings
from spots.errors import BoardError, ChangedError, FileError, NoReplyError
from spots.keyboard import keys
from spots.keyboard.layout import load
from spots.link.board import Board
from spots_device.board.settings import checksum
from spots_sim.strip.scenario import Held
from spots_web import user_file
from spots_web.editors import LayoutEditor, SettingsEditor
from spots_web.state import PageState

LONG_MS = 60_000
DIGITS, MINI = load("digits"), load("mini")
SETTINGS = controller_settings.DEFAULT.read_text(encoding="utf-8")
HAND = "# an hour of work by hand\n"
KINDS = ("layout", "controller", "gestures")


@pytest.fixture
def desk(sensor, calibration, serve, tmp_path):
    """A board, and its web server with all three editors."""

    class Desk:
        paths = {name: tmp_path / f"{name}.toml" for name in KINDS}

        def __init__(self):
            settings = {name: self.paths[name] for name in KINDS[1:]}
            self.bench = Bench(
                sensor, calibration, Held(), edit=self.paths["layout"], settings=settings
            )
            self.server = serve(self.bench.state, queues=self.bench.queues)
            eventually(lambda: self.shown("layout")["stored"] is not None)

        def shown(self, name):
            part = "editor" if name == "layout" else name
            return self.bench.state.since(self.bench.state.begin())[1][part]

        def store(self, name, text, loses=None):
            """Store a text; agree to lose actions, unless `loses` lists those that may be lost."""
            message = {"do": "save", "text": text, "base": self.shown(name)["base"]}
            if name == "layout":
                message |= {"do": "push", "loses": loses or []}
            status, answer = self.send(name, message)
            if status == 200 and json.loads(answer)["loses"] and loses is None:
                return self.store(name, text, json.loads(answer)["loses"])
            return status, answer

        def send(self, name, message):
            return post(self.server, json.dumps(message), path=name, token=token_of(self.server))

        def on_board(self):
            return apart(lambda: self.bench.board.command("hello")["layout"])

    made = Desk()
    yield made
    made.bench.close()


@pytest.mark.board
@pytest.mark.parametrize("name", KINDS)
def test_a_change_by_hand_is_never_overwritten_unseen(desk, name):
    path, text = desk.paths[name], desk.shown(name)["text"]
    assert desk.store(name, text)[0] in (200, 204)
    stored = desk.on_board()
    path.write_text(text + HAND)
    status, why = desk.store(name, text + "# of the page\n")
    assert (status, f"another program has changed {name}.toml" in why) == (409, True), why
    assert path.read_text() == text + HAND
    assert desk.on_board() == stored
    assert desk.shown(name)["text"] == text + HAND
    # The web UI shows the change now, so the next request replaces it.
    assert desk.store(name, text + "# of the page\n")[0] in (200, 204)
    assert path.read_text() == text + "# of the page\n"


@pytest.mark.parametrize("name", KINDS)
def test_a_file_that_appears_disappears_or_is_spoiled_by_hand(desk, name):
    path, text = desk.paths[name], desk.shown(name)["text"]
    path.write_text(text + HAND)  # there was no file
    assert desk.store(name, text)[0] == 409
    assert path.read_text() == text + HAND
    path.write_text("name = \n")
    status, why = desk.store(name, text)
    assert (status, f"changed {name}.toml, and it cannot be used now" in why) == (409, True)
    assert path.read_text() == "name = \n"
    path.unlink()
    assert desk.store(name, text)[0] in (200, 204)
    assert path.read_text() == text


def test_two_servers_do_not_overwrite_each_other(desk, tmp_path):
    other = SettingsEditor("controller", desk.paths["controller"], PageState())
    assert desk.store("controller", SETTINGS + "# first\n")[0] == 204
    request = {"do": "save", "text": SETTINGS + "# second\n", "base": other.base}
    with refusal(ChangedError, file="controller.toml"):
        other._handle(desk.bench.board, other.decode(json.dumps(request).encode()))
    assert desk.paths["controller"].read_text() == SETTINGS + "# first\n"


@pytest.mark.parametrize("name", KINDS)
def test_a_change_at_the_last_moment_survives(desk, name, monkeypatch):
    path, text = desk.paths[name], desk.shown(name)["text"]
    assert desk.store(name, text)[0] in (200, 204)
    sync = user_file.atomic.sync

    def late(file):
        sync(file)
        path.write_text(text + HAND)

    monkeypatch.setattr(user_file.atomic, "sync", late)
    new = MINI.text if name == "layout" else text + "# of the page\n"
    status, why = desk.store(name, new)
    assert (status, "another program has changed" in why) == (409, True)
    assert path.read_text() == text + HAND
    assert desk.shown(name)["text"] == text + HAND
    if name == "layout":  # the board was changed before
        assert why.startswith("the board has the new layout, but layout.toml is unchanged: ")
        assert desk.on_board() == checksum(MINI.lines)


def test_the_page_shows_a_change_by_hand_and_undo_brings_the_draft_back(desk, open_page):
    desk.store("controller", SETTINGS)
    page = open_page(desk.server.url)
    click_opener(page, "#edit-controller")
    state = page.locator("#controller .state")
    rate = page.get_by_label("States per second, Hz")
    expect(rate).to_have_value("125", timeout=LONG_MS)
    rate.fill("200")
    rate.press("Enter")
    hand = SETTINGS.replace("hold_ms = 100", "hold_ms = 150") + HAND
    assert hand != SETTINGS + HAND
    desk.paths["controller"].write_text(hand)
    save = page.locator("#controller").get_by_role("button", name="Save")
    save.click()
    expect(state).to_have_text(
        re.compile("changed.*; Undo brings your draft back"), timeout=LONG_MS
    )
    expect(page.get_by_label("Without readings, keep the last state for, ms")).to_have_value("150")
    assert desk.paths["controller"].read_text() == hand
    page.locator("#controller").get_by_role("button", name="Undo").click()
    expect(rate).to_have_value("200")
    save.click()
    expect(state).to_have_text("saved in controller.toml", timeout=LONG_MS)
    text = desk.paths["controller"].read_text()
    assert text == SETTINGS.replace("rate_hz = 125", "rate_hz = 200") + HAND


NO_SPACE = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


@pytest.mark.board
@pytest.mark.parametrize("name", KINDS)
def test_on_a_full_disk_nothing_changes_and_the_reason_is_shown(desk, name, monkeypatch):
    path, text = desk.paths[name], desk.shown(name)["text"]
    assert desk.store(name, text)[0] in (200, 204)
    shown, stored = desk.shown(name), desk.on_board()

    def full(file):
        raise NO_SPACE

    with monkeypatch.context() as patch:
        patch.setattr(user_file.atomic, "sync", full)
        new = MINI.text if name == "layout" else text + "# of the page\n"
        status, why = desk.store(name, new)
    assert (status, "No space left on device" in why) == (409, True)
    words = "on the board are unchanged" if name == "layout" else "controller.toml is unchanged"
    assert words.replace("controller", name) in why
    assert (desk.shown(name), desk.on_board(), path.read_text()) == (shown, stored, text)
    assert [one.name for one in path.parent.iterdir() if one.name.startswith(".")] == []
    assert desk.store(name, new)[0] in (200, 204)


def test_a_file_that_fails_after_the_board_can_be_stored_again(desk, open_page, monkeypatch):
    assert desk.store("layout", DIGITS.text)[0] == 200
    page = open_page(desk.server.url)
    click_opener(page, "#edit")
    page.get_by_label("Name of the layout").fill("Mine")
    page.get_by_label("Name of the layout").press("Enter")
    page.locator("#editor").get_by_role("button", name="Add a zone").click()
    place = user_file.atomic.os.replace

    def full(*arguments):
        raise NO_SPACE

    monkeypatch.setattr(user_file.atomic.os, "replace", full)
    push, state = (
        page.get_by_role("button", name="Put on the board"),
        page.locator("#editor .state"),
    )
    push.click()
    expect(state).to_have_text(
        re.compile("^the board has the new layout, but layout.toml is unchanged: .*No space left"),
        timeout=LONG_MS,
    )
    assert desk.paths["layout"].read_text() == DIGITS.text
    expect(push).to_be_enabled()
    monkeypatch.setattr(user_file.atomic.os, "replace", place)
    push.click()
    expect(state).to_have_text(re.compile("^on the board"), timeout=LONG_MS)
    assert 'name = "Mine"' in desk.paths["layout"].read_text()


def failing(monkeypatch, begin, error):
    """Let the board execute a command, but raise an error instead of returning its reply."""
    command = Board.command

    def fail(board, line, timeout_s=None):
        reply = command(board, line, timeout_s)
        if line.startswith(begin):
            raise error
        return reply

    monkeypatch.setattr(Board, "command", fail)


LOST = NoReplyError("no reply")


@pytest.mark.board
def test_a_push_of_unknown_outcome_shows_what_the_board_has(desk, monkeypatch):
    assert desk.store("layout", DIGITS.text)[0] == 200
    with monkeypatch.context() as patch:
        failing(patch, "save", LOST)
        status, why = desk.store("layout", MINI.text)
    assert status == 409
    assert "no reply; the board has the new layout, perhaps only until it restarts" in why
    assert desk.on_board() == checksum(MINI.lines)
    assert (desk.shown("layout")["stored"], desk.shown("layout")["text"]) == ("other", DIGITS.text)
    assert desk.paths["layout"].read_text() == DIGITS.text
    # This program knows the layout, so it does not ask about unknown keys.
    lost = [keys.say(DIGITS, one) for one in DIGITS.typed - MINI.typed]
    assert json.loads(desk.store("layout", MINI.text, lost or ["x"])[1])["loses"] == []
    assert desk.shown("layout")["stored"] == "this"


def test_a_push_that_the_board_refuses_changes_nothing(desk, monkeypatch):
    assert desk.store("layout", DIGITS.text)[0] == 200
    shown = desk.shown("layout")

    def refuse(board, layout, expose):
        raise BoardError("the board refuses 'layout end': no memory")

    monkeypatch.setattr(keys, "push", refuse)
    status, why = desk.store("layout", MINI.text)
    assert (status, "on the board are unchanged" in why) == (409, True)
    assert desk.shown("layout") == shown
    assert desk.paths["layout"].read_text() == DIGITS.text


def test_after_the_default_keys_the_file_is_the_reference(desk):
    assert desk.store("layout", MINI.text)[0] == 200
    assert desk.send("layout", {"do": "clear"})[0] == 204
    assert (desk.on_board(), desk.shown("layout")["stored"]) == (None, "default")
    assert desk.shown("layout")["text"] == MINI.text
    loses = json.loads(desk.store("layout", DIGITS.text, ["x"])[1])["loses"]
    assert "E" in loses
    assert desk.paths["layout"].read_text() == MINI.text


@pytest.mark.board
def test_a_lost_reply_to_the_default_keys_is_shown(desk, monkeypatch):
    assert desk.store("layout", MINI.text)[0] == 200
    with monkeypatch.context() as patch:
        failing(patch, "save", LOST)
        assert desk.send("layout", {"do": "clear"})[0] == 409
    assert desk.shown("layout")["stored"] == "default"


@pytest.mark.parametrize("mark", [b"", codecs.BOM_UTF8, codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE])
def test_the_encoding_and_the_line_ends_of_a_file_are_kept(desk, tmp_path, mark):
    encoding = {codecs.BOM_UTF16_LE: "utf-16-le", codecs.BOM_UTF16_BE: "utf-16-be"}.get(mark)
    encode = lambda text: mark + text.encode(encoding or "utf-8")  # noqa: E731
    text = SETTINGS.replace("\n", "\r\n")
    path = tmp_path / "mine.toml"
    path.write_bytes(encode(text))
    one = SettingsEditor("controller", path, PageState())
    new = one.text.replace("rate_hz = 125", "rate_hz = 200")
    request = {"do": "save", "text": new, "base": one.base}
    one._handle(desk.bench.board, one.decode(json.dumps(request).encode()))
    assert path.read_bytes() == encode(text.replace("rate_hz = 125", "rate_hz = 200"))


@pytest.mark.parametrize(
    "arguments",
    [
        ["--edit", "no/mine.toml"],
        ["--edit-controller", "no/c.toml"],
        ["--edit-gestures", "no/g.toml"],
        ["--session", "no/a.jsonl"],
    ],
)
def test_a_folder_that_is_not_there_is_reported_at_the_start(
    arguments, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert apart(main, ["serve", "--http-port", "0", *arguments]) == 2
    assert "there is no folder no: make it first" in capsys.readouterr().err


def test_a_folder_that_cannot_be_written_is_reported_at_the_start(tmp_path, monkeypatch):
    def refuse(*arguments, **options):
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(user_file.atomic.tempfile, "NamedTemporaryFile", refuse)
    with refusal(FileError, file="mine.toml"):
        LayoutEditor(tmp_path / "mine.toml", DIGITS, PageState())
    assert not list(tmp_path.iterdir())
