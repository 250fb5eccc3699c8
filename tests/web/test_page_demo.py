"""The demo opens the web UI on a computer with a screen; otherwise it uses the terminal."""

from __future__ import annotations

import re
import webbrowser
from types import SimpleNamespace

import pytest
from support.serving import apart

import spots_sim.demo.demo
from spots.cli import main
from spots.errors import SpotsError
from spots.keyboard.layout import load
from spots_sim.demo import browser
from spots_web import serve


@pytest.fixture
def at_a_screen(monkeypatch):
    """Pretend that the demo runs in a terminal on a computer with a screen."""
    terminal = SimpleNamespace(isatty=lambda: True)
    monkeypatch.setattr(browser, "sys", SimpleNamespace(platform="linux", stdout=terminal))
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)


@pytest.fixture
def shown(monkeypatch):
    """List of what the demo has opened: ``page`` (the web UI) or ``terminal``."""
    shown = []
    monkeypatch.setattr(spots_sim.demo.demo, "show_page", lambda *_: shown.append("page"))
    monkeypatch.setattr(spots_sim.demo.demo, "demo", lambda *_: shown.append("terminal") or {})
    return shown


def no_board(board_id):
    raise SpotsError("no board found")


@pytest.mark.board
def test_the_page_is_opened(at_a_screen, monkeypatch, capsys):
    opened = []

    def look(url):
        opened.append(url)
        raise KeyboardInterrupt

    monkeypatch.setattr(webbrowser, "open", look)
    monkeypatch.setattr(serve, "finder", lambda *_: no_board)
    assert apart(main, ["demo"]) == 0
    (url,) = opened
    assert re.fullmatch(r"http://127\.0\.0\.1:\d+/", url)
    assert url in capsys.readouterr().out


def test_the_demo_of_a_person_at_a_screen_is_the_page(at_a_screen, shown):
    assert main(["demo"]) == main(["demo", "--seed", "3", "--sensor", "noisy"]) == 0
    assert shown == ["page", "page"]


@pytest.mark.parametrize(
    "arguments",
    [["--json"], ["--seconds", "5"], ["--use", "strip"], ["--use", "keyboard"], ["--fast"]],
)
def test_who_asks_for_the_terminal_gets_it(at_a_screen, shown, arguments):
    assert main(["demo", *arguments]) == 0
    assert shown == ["terminal"]


def test_an_unknown_application_has_no_page(monkeypatch, capsys):
    monkeypatch.setattr("spots_web.serve.serve", lambda *_: pytest.fail("served"))
    assert apart(main, ["demo", "--page", "--use", "keybord"]) == 2
    assert "there is no demo of 'keybord'" in capsys.readouterr().err
    assert apart(main, ["demo", "--page", "--use", "keyboard", "--layout", "nowhere"]) == 2
    assert "cannot read the layout" in capsys.readouterr().err


def test_the_page_of_the_keyboard_shows_the_layout_that_was_named(monkeypatch):
    layouts = []
    monkeypatch.setattr("spots_web.serve.serve", lambda *_: None)
    monkeypatch.setattr(
        spots_sim.demo.demo, "BoardReader", lambda open_board, layout, state: layouts.append(layout)
    )
    for more in ([], ["--layout", "mini"]):
        assert apart(main, ["demo", "--page", "--use", "keyboard", *more]) == 0
    assert [layout.name for layout in layouts] == [load("digits").name, load("mini").name]


def test_without_a_display_it_is_the_terminal(at_a_screen, shown, monkeypatch):
    monkeypatch.delenv("DISPLAY")
    assert main(["demo"]) == 0
    assert shown == ["terminal"]


def test_off_a_terminal_it_is_the_terminal(at_a_screen, shown, monkeypatch):
    monkeypatch.setattr(browser.sys.stdout, "isatty", lambda: False)
    assert main(["demo"]) == 0
    assert shown == ["terminal"]


def test_the_page_may_be_asked_for_anywhere(shown):
    assert main(["demo", "--page"]) == 0
    assert shown == ["page"]
