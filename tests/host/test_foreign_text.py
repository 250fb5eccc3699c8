"""Text that devices, files and other machines chose does nothing to a terminal."""

import re
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console

from spots.cli import main
from spots.controller import stick
from spots.keyboard import layout
from spots.link import serial_link as link
from spots.link.frames import LinkStats
from spots.linkage import twin_view
from spots.outputs.devices import REST
from spots.terminal.view import StripView

EVIL = "a\x1b]0;x\x07\x1b[31m\x9b2J\r\n\u202eb\u2066\u200f[red]r[/red][link=http://x]y[/link]\x7f"
DANGER = re.compile(r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]")


def harmless(text, lines=1):
    """Whether no character of a foreign text acts on a terminal, and markup is shown as it is."""
    return not DANGER.search(text) and text.count("\n") <= lines


@pytest.fixture
def evil_usb(monkeypatch):
    """A USB device whose descriptors are written by somebody else."""
    usb = SimpleNamespace(
        device="/dev/tty" + EVIL, description=EVIL, product=EVIL, manufacturer=EVIL,
        serial_number=EVIL, vid=1, pid=2, location="1-1", interface=EVIL, hwid=EVIL, name=EVIL,
    )  # fmt: skip
    monkeypatch.setattr(link.list_ports, "comports", lambda *_: [usb])
    return usb


def test_ports_prints_no_descriptor_raw(evil_usb, capsys):
    assert main(["ports"]) == 0
    told = capsys.readouterr()
    assert "[red]r[/red][link=http://x]y[/link]" in told.out
    assert harmless(told.out)
    assert harmless(told.err)


@pytest.mark.parametrize(
    "arguments",
    [["ports", "--json"], ["doctor"], ["command", "hello"], ["flash", "pico"], ["monitor"]],
)
def test_a_hostile_device_writes_nothing_raw(evil_usb, capsys, arguments):
    main(arguments)
    told = capsys.readouterr()
    assert harmless(told.out, lines=9)
    assert harmless(told.err)


@pytest.mark.parametrize(
    "arguments",
    [
        ["info", "{}"],
        ["replay", "{}"],
        ["export", "{}", "--to", "csv"],
        ["keys", "check", "{}.toml"],
        ["keys", "show", "{}.toml"],
        ["serve", "--layout", "{}.toml"],
        ["monitor", "--port", "{}"],
        ["monitor", "--port", "recording:{}"],
        ["monitor", "--port", "zenoh:{}"],
        ["demo", "--sensor", "{}.toml"],
        ["demo", "--scenario", "{}.toml"],
    ],
)
@pytest.mark.parametrize("content", [b"", f'{EVIL!r} = 1\n"{EVIL!a}" = 2\n'.encode()])
def test_hostile_names_and_values_of_files_are_not_printed_raw(
    tmp_path, capsys, arguments, content
):
    for end in ("", ".toml"):
        (tmp_path / (EVIL.replace("/", "") + end)).write_bytes(content)
    path = str(tmp_path / EVIL.replace("/", ""))
    assert main([one.replace("{}", path) for one in arguments]) == 2
    told = capsys.readouterr()
    assert harmless(told.out)
    assert harmless(told.err)


def test_a_layout_of_a_hostile_name_is_checked_and_shown_harmlessly(tmp_path, capsys):
    path = tmp_path / (EVIL.replace("/", "") + ".toml")
    path.write_bytes((Path(layout.__file__).parent / "layouts" / "mini.toml").read_bytes())
    for what in ("check", "show"):
        assert main(["keys", what, str(path)]) == 0
        assert harmless(capsys.readouterr().out, lines=99)


PICTURES = {
    "monitor": lambda: StripView({"board": "b", "runtime": "r", "plan": []}, EVIL).picture(
        LinkStats()
    ),
    "controller": lambda: stick.picture(REST, title=EVIL),
    "twin": lambda: twin_view.TwinView(
        SimpleNamespace(trail=[], silence=lambda now_s: ""), [EVIL]
    ).picture([], 0.0),
}


@pytest.mark.parametrize("picture", PICTURES.values(), ids=PICTURES)
def test_a_picture_shows_foreign_text_as_it_is_written(picture, capsys):
    Console(width=200).print(picture())
    told = capsys.readouterr().out
    assert harmless(told, lines=99)
    assert "[red]r" in told or "[re" in told
