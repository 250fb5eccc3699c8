"""The page `live` with a board on USB: a virtual board's PTY behind `navigator.serial`."""

from __future__ import annotations

import json
import re
import shutil

import pytest
from playwright.sync_api import expect
from support.boards import running
from support.frames import encoded

import spots
from spots.link.connect import prepare
from spots.link.decoder import Decoder
from spots_device import PROTOCOL

CONNECTED = "#board[data-state=connected]"


@pytest.fixture(scope="module")
def board(tmp_path_factory, built, calibration):
    """Return the port of a calibrated virtual board, which a simulated finger presses."""
    folder = tmp_path_factory.mktemp("board") / "files"
    shutil.copytree(built("virtual"), folder)
    with running(folder) as start:
        with spots.open(start["port"]) as opened:
            prepare(opened, calibration)
            opened.command("save")
        yield start["port"]


@pytest.fixture
def page(bridge, board, serial_page):
    """Return the page when it reads the board."""
    bridge.port = board
    opened = serial_page()
    expect(opened.locator(CONNECTED)).to_be_visible()
    opened.locator("#connect").click()
    expect(opened.locator("#board")).to_contain_text("on USB")
    return opened


def test_page_reads_changes_and_records_a_board(page, bridge, tmp_path):
    # Fails if readings, settings, layouts or the recording of a board differ from what it sends.
    expect(page.locator("#strip .press.on")).to_have_count(1)
    page.locator("#average").fill("2")
    page.locator("#average").press("Enter")
    expect(page.locator("#link")).to_contain_text(re.compile("rate(49|50|51)[.]"))
    page.locator("#keys-on").check()
    key = page.locator("#keyboard .tape span").first
    expect(key).to_have_text(re.compile("^é[0-9]$"))  # what this computer's layout types
    page.locator("#choose-layout").select_option("mini")
    expect(page.locator("#keyboard h2")).to_contain_text("Mini keyboard")
    page.locator("#recording").click()
    expect(page.locator("#recorded")).to_contain_text(re.compile("[2-9]\\.. s"))
    page.keyboard.press("m")
    with page.expect_download() as download:
        page.locator("#recording").click()
    path = tmp_path / "run.spots"
    download.value.save_as(path)

    arrays = spots.read_arrays(path)
    touches = arrays.touches
    assert [mark.text for mark in arrays.marks] == ["mark 1"]
    sent = [frame for frame in Decoder().feed(bytes(bridge.seen)) if isinstance(frame, spots.Touch)]
    numbers = [(frame.sequence, frame.t_us) for frame in sent]
    first = numbers.index((touches["sequence"][0], touches["t_us"][0]))
    recorded = list(zip(touches["sequence"].tolist(), touches["t_us"].tolist()))
    assert len(recorded) > 80
    assert recorded == numbers[first : first + len(recorded)]

    page.locator("#recording-file").set_input_files(path)
    expect(page.locator("#board")).to_contain_text("run.spots")
    expect(page.locator("#strip .press.on")).to_have_count(1)


def test_states_of_the_link(page, bridge, board, serial_page):
    # Fails if a lost, taken or foreign board is not shown, or is not read again by itself.
    bridge.unplug()
    expect(page.locator("#board")).to_have_attribute("data-state", "lost")
    bridge.port = board
    expect(page.locator(CONNECTED)).to_be_visible()
    page.reload()
    expect(page.locator("#board")).to_contain_text("on USB")
    second = page.context.new_page()
    second.goto(bridge.url)
    expect(second.locator(CONNECTED)).to_be_visible()
    second.locator("#connect").click()
    expect(second.locator("#next")).to_contain_text("another tab reads the board")
    second.close()
    bridge.taken = True
    bridge.unplug()
    bridge.port = board
    expect(page.locator("#next")).to_contain_text("close the program that uses it")
    bridge.taken = False
    expect(page.locator(CONNECTED)).to_be_visible()
    page.locator("#connect").click()
    expect(page.locator("#board")).to_contain_text("this tab")
    with spots.open(board) as opened:  # the port is free again
        assert opened.info["length_um"] == 85_000


def test_other_devices_are_refused(bridge, serial_page):
    page = serial_page()
    expect(page.locator(CONNECTED)).to_be_visible()
    for said, sentence in (
        (b">>> ", "at its Python prompt"),
        (b"", "does not answer as a SPOTS board"),
        ({"re": "hello", "protocol": PROTOCOL + 1}, f"protocol {PROTOCOL + 1}"),
    ):
        content = json.dumps(said).encode() if isinstance(said, dict) else None
        bridge.answers = (content and encoded(b"\3" + bytes(6) + content)) or said
        page.locator("#connect").click()
        expect(page.locator("#board")).to_contain_text(sentence)
        page.locator("#connect").click()
        expect(page.locator("#board")).to_contain_text("this tab")


def test_bad_files_are_refused(bridge, open_page, tmp_path):
    page = open_page(bridge.url)
    expect(page.locator(CONNECTED)).to_be_visible()
    for name, content, control in (
        ("noise.spots", b"\xa5\0" * 100_000, "#recording-file"),
        ("empty.spots", b"", "#recording-file"),
        ("letter.toml", b"dear board", "#calibration-file"),
    ):
        path = tmp_path / name
        path.write_bytes(content)
        page.locator(control).set_input_files(path)
        expect(page.locator("#live-note")).to_contain_text(name)
        expect(page.locator("#live-note")).to_contain_text("next:")
        expect(page.locator("#board")).to_contain_text("this tab")
