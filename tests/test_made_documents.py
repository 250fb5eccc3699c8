"""The programs that write pages and pictures of the documents run, in a short form.

tests/calibrate/test_figures.py runs the one for paper.md, and tests/linkage/test_maps.py the one
for linkage.md.
"""

import asyncio
import re
from functools import partial
from pathlib import Path

import pytest
from make import (
    applications_page,
    battery_page,
    cheapest_page,
    link_states,
    parts_page,
    pictures,
    press,
    screenshots,
    timings,
)

from evidence import effects

pytestmark = pytest.mark.board

PICTURES = Path(__file__).parents[1] / "docs" / "pictures"


def test_the_page_of_the_applications(tmp_path, monkeypatch):
    for name, value in (
        ("STRIPS", applications_page.STRIPS[:1]),
        ("WORDS_PER_MIN", (100,)),
        ("HEADLINES", (100, "people")),
        ("HEADLINE_SEEDS", 2),
        ("SEEDS", 1),
        ("TOUCHES", 4),
        ("_SECONDS", 1.0),
    ):
        monkeypatch.setattr(applications_page, name, value)
    applications_page.main(tmp_path)
    text = (tmp_path / "evidence" / "applications.md").read_text(encoding="utf-8")
    assert "| 100 words a minute: errors, no finger | " in text
    assert "| controller: states sent | " in text


def test_the_pictures(tmp_path, monkeypatch, capsys):
    (tmp_path / "linkage").mkdir()
    for name, value in (
        ("_PICTURES", tmp_path),
        ("MOMENT_S", 0.2),
        ("HARD_S", 0.2),
        ("WORN_S", 0.2),
        ("WROTE_S", 0.5),
        ("TYPED", "h"),
    ):
        monkeypatch.setattr(pictures, name, value)
    monkeypatch.setattr(pictures, "wirings", partial(pictures.wirings, tmp_path))
    pictures.main()
    timings.main(tmp_path)
    press.main(tmp_path)
    link_states.main(tmp_path)
    printed = {Path(line) for line in capsys.readouterr().out.splitlines()}
    assert printed == {*tmp_path.rglob("*.svg")}
    assert {path.relative_to(tmp_path) for path in printed} == {
        path.relative_to(PICTURES) for path in PICTURES.rglob("*.svg")
    }


def test_the_picture_of_the_link_has_the_states_and_times_of_the_host():
    assert (PICTURES / "link_states.svg").read_text(encoding="utf-8") == link_states.document()


def test_the_parts_and_costs_of_all_pages_are_those_of_one_list():
    """Fails if a page, the README or the CSV has another part, amount or price."""
    for path, text in parts_page.documents().items():
        assert path.read_text(encoding="utf-8") == text, path


def test_how_long_a_battery_lasts_is_what_is_computed():
    assert battery_page._PAGE.read_text(encoding="utf-8") == battery_page.document()


def test_the_page_of_the_cheapest_strip(tmp_path, monkeypatch):
    """Fails if an option of a row is unknown, or the rows do not fit the table of the page."""
    page = tmp_path / "cheapest.md"
    page.write_text(cheapest_page._PAGE.read_text(encoding="utf-8"), encoding="utf-8")
    errors = [effects.Errors(force_N, 0.12, 0.34, 0, 0, 1, 0, 0) for force_N in (1.0, 3.0)]
    monkeypatch.setattr(cheapest_page, "_PAGE", page)
    monkeypatch.setattr(effects, "measured", lambda options: errors)
    cheapest_page.main()
    rows = re.findall(r"^\| (.*) \| 0.12/0.34 \| 0.12/0.34 \|$", page.read_text(), re.MULTILINE)
    assert rows == list(cheapest_page._WITHOUT)


def test_the_screenshots(tmp_path, monkeypatch):
    for name, value in (("_FOLDER", tmp_path), ("_AFTER_S", 0), ("_HARD_N", 0), ("_SIGNAL_S", 0)):
        monkeypatch.setattr(screenshots, name, value)
    asyncio.run(screenshots.main())
    made = {path.name for path in tmp_path.iterdir()}
    assert made == {path.name for path in PICTURES.glob("page-*.png")}
