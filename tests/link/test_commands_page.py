"""docs/extend/commands.md and files-on-the-board.md: compared with the firmware."""

from __future__ import annotations

import re

import pytest
from support.documents import ROOT

import spots
from spots_device.board.command import Commands
from spots_device.board.settings import LIMITS
from spots_device.keys import layout
from spots_device.reading import calibration_lines

EXTEND = ROOT / "docs" / "extend"
PAGE = (EXTEND / "commands.md").read_text(encoding="utf-8")
FILES = (EXTEND / "files-on-the-board.md").read_text(encoding="utf-8")


def section(page, heading):
    return page.partition(f"\n## {heading}\n")[2].partition("\n## ")[0]


def rows(text):
    """Return the cells of the rows of the tables in a text, without heads."""
    found = [line[2:-2].split(" | ") for line in text.splitlines() if line.startswith("| ")]
    return [row for row in found if row[0].startswith(("`", "["))]


def named(cells):
    """Return the first words of the spans of code in texts."""
    return {span.split()[0] for cell in cells for span in re.findall(r"`([^`]+)`", cell)}


def test_each_command_has_a_row():
    table = PAGE.partition("\n## ")[0]
    assert named(row[0] for row in rows(table)) == {*Commands._TABLE}


def test_each_setting_has_a_row_with_its_limits():
    table = {row[0]: row[1:] for row in rows(section(PAGE, "Settings"))}
    assert named(table) == {*LIMITS, "led", "radio", "channels"}
    for name, (low, high, default) in LIMITS.items():
        if f"`{name}`" in table:
            values, stated, _ = table[f"`{name}`"]
            numbers = [int(one.replace(",", "")) for one in re.findall(r"\d[\d,]*\d|\d", values)]
            assert (min(numbers), max(numbers)) == (low, high), name
            assert int(stated.replace(",", "")) == default, name


@pytest.mark.board
def test_each_field_of_a_reply_has_a_row():
    with spots.open("virtual") as board:
        for command in ("hello", "get"):
            table = section(PAGE, f"The reply to {command}")
            fields = {*board.command(command)} - {"re", *LIMITS, "led", "radio", "channels"}
            assert named(row[0] for row in rows(table)) == fields


def test_each_line_of_a_calibration_has_a_row():
    table = {row[0].strip("`"): row[1] for row in rows(section(FILES, "Lines of a calibration"))}
    counts = calibration_lines._ONCE | calibration_lines._MANY | calibration_lines._FOR_HOST
    others = {"board", "plan", "relative", "presser", "strain", "from", "x"}
    assert {*table} == {*counts, *others}
    for name, count in counts.items():
        assert table[name].split(",")[0] == str(count), name


def test_each_setting_and_behaviour_of_a_layout_is_named():
    text = section(FILES, "Lines of a layout")
    assert {*layout.LIMITS} <= named([text])
    table = text.partition("| kind of behaviour |")[2]
    kinds = {int(one) for one in re.findall(r"(?:^\| |, )(\d) [a-z]", table, re.MULTILINE)}
    assert kinds == {*layout._SHAPES}
    maxima = layout.KEYS_MAX, layout.LAYERS_MAX, layout.BEHAVIOURS_MAX, layout.STEPS_MAX
    assert "at most {} keys, {} layers, {} behaviours and {:,} steps".format(*maxima) in text
