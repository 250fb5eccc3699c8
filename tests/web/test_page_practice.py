"""Practice of a calibration in the web UI: the page shows a simulated ruler and scale."""

from __future__ import annotations

import re

import pytest
from playwright.sync_api import expect
from support.person import Person
from support.serving import Bench

from spots.cli import main
from spots_sim.strip.scenario import Held

SHOWN = re.compile(r"ruler: finger at ([\d.]+) mm(?:, scale: (\d+) g)?|scale: (\d+) g")


@pytest.fixture
def practice(sensor, serve):
    bench = Bench(sensor, None, Held(), practice="default")
    yield serve(bench.state, queues=bench.queues)
    bench.close()


class Reader(Person):
    """A person who types what the page shows; the simulated finger presses by itself."""

    def press(self, seen):
        pass

    def answer(self, seen):
        instruments = self.page.locator("#calibration .reading")
        expect(instruments).to_be_visible()
        place_mm, *grams = SHOWN.fullmatch(instruments.get_attribute("aria-label")).groups()
        if place_mm:
            self.page.get_by_label("Position in mm").fill(place_mm)
        if any(grams):
            self.page.get_by_label("Force").first.fill(next(filter(None, grams)))
        self.page.locator("#calibration .main").click()


def test_a_person_practises_in_the_page(practice, open_page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    page = open_page(practice.url, viewport={"width": 390, "height": 844})
    reader = Reader(page, Held(), 85.0)
    panel = page.locator("#calibration")
    expect(panel).to_contain_text("Practise a calibration")
    expect(panel.get_by_role("button", name="Re-zero")).to_be_hidden()
    reader.start("rough")
    reader.go_on(lambda seen: seen["asks"])
    expect(panel.locator(".reading canvas")).to_be_visible()
    seen = reader.go_on()
    assert seen["todo"] == "The practice is done"
    score = re.search(r"score: position (\S+) mm rms, .*differ by (\S+) mm rms", seen["said"])
    assert float(score[1]) < 0.3
    assert float(score[2]) < 0.1
    assert "strip and board were simulated, and their files are removed" in seen["said"]
    assert list(tmp_path.iterdir()) == []
    expect(panel.locator(".reading")).to_be_hidden()


def test_practice_can_be_stopped_and_stores_nothing(practice, open_page):
    page = open_page(practice.url)
    reader = Reader(page, Held(), 85.0)
    reader.start("fine")
    reader.go_on(lambda seen: seen["asks"])
    page.get_by_role("button", name="Stop").click()
    seen = reader.wait(lambda seen: seen["starts"])
    assert seen["todo"] == "The practice is stopped"
    assert seen["note"] == "stopped: practice stores no presses"


@pytest.mark.parametrize(
    "more", ["--port /dev/x", "--session a.jsonl", "--record-to .", "--linkage x"]
)
def test_practice_is_for_a_simulated_strip_alone(more, capsys):
    assert main(["serve", "--practice", *more.split()]) == 2
    assert "--practice shows a simulated strip: leave out" in capsys.readouterr().err
