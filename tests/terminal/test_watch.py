"""Output in a terminal: picture and lines of readings, score of a demo, list of `spots ports`."""

import io

import pytest
from rich.console import Console
from support.refusals import refusal

from spots import cli
from spots.errors import PortError
from spots.link import connect
from spots.link import serial_link as link
from spots.link.frames import LinkStats, Spectrum, Touch
from spots.terminal.view import StripView, plain
from spots_sim.measure.score import Score
from spots_sim.strip.files import Finger, ScenarioFile
from spots_sim.strip.scenario import Scenario

INFO = {"board": "b", "runtime": "r", "channels": ["F3", "F4"], "length_um": 50_000}


def reading(flags=1, position_um=25_000, force_mN=2500, time_s=3.5):
    return Touch(0, 0, 0, flags, 0, 0, position_um, force_mN, time_s)


def text(view, score=None):
    console = Console(file=io.StringIO(), width=100)
    console.print(view.picture(LinkStats(frames=7, lost=2), score))
    return console.file.getvalue()


def test_the_picture_tells_place_force_counts_and_link():
    view = StripView(INFO, "/dev/x")
    view.take(reading())
    view.take(Spectrum(0, 0, 0, 1, 9, (500, 1000)))
    drawn = text(view)
    for part in ("25.000 mm", "2.500 N", "500 ct", "1000 ct", "50 mm", "lost 2", "/dev/x"):
        assert part in drawn


def test_without_a_touch_the_picture_claims_none():
    view = StripView(INFO, "/dev/x")
    assert "mm " not in text(view).split("position")[1].splitlines()[0]
    view.take(reading(flags=1 << 6))
    assert "not calibrated" in text(view)


def test_a_plain_line_has_time_place_force_and_doubts():
    assert plain(reading(), 1.0).split() == ["2.500", "s", "25.000", "mm", "2.500", "N"]
    assert plain(reading(flags=3), 1.0).endswith("saturated")
    assert "no touch" in plain(reading(flags=4), 1.0)


def test_a_score_compares_trusted_readings_under_one_finger_and_no_others():
    finger = Finger(points=[(0.0, 25.0, 2000), (10.0, 25.0, 2000)])
    score = Score(Scenario(ScenarioFile(seconds=20.0, touch=[finger])), 0.0)
    score.take(reading(position_um=25_030, force_mN=2000), 3.51)
    score.take(reading(position_um=24_960, force_mN=2010, time_s=3.6), 3.61)
    score.take(reading(flags=0, position_um=0, time_s=3.7), 3.71)  # no touch
    score.take(reading(flags=3, position_um=0, time_s=3.8), 3.81)  # saturated
    score.take(reading(position_um=0, time_s=15.0), 15.01)  # the scenario has no finger then
    assert score.position_rmse_um == pytest.approx(((30**2 + 40**2) / 2) ** 0.5, abs=0.01)
    assert score.position_median_um == pytest.approx(35)
    assert score.trusted_percent == pytest.approx(200 / 3, abs=0.01)
    assert score.force_rmse_mN == pytest.approx((10**2 / 2) ** 0.5, abs=0.01)
    assert score.touches == 2
    assert score.latency_ms(50) == pytest.approx(10, abs=0.1)


class Port:
    device, description, serial_number = "/dev/ttyNONE", "a device", None


def test_ports_says_what_answered_on_each(monkeypatch, capsys):
    monkeypatch.setattr(connect, "usb_ports", lambda: [Port])
    assert cli.main(["ports"]) == 0
    assert capsys.readouterr().out.startswith("/dev/ttyNONE  a device  there is no port")


def test_no_board_found_says_why_each_port_was_none(monkeypatch):
    monkeypatch.setattr(link, "usb_ports", lambda: [Port])
    with refusal(PortError):
        connect.open()
