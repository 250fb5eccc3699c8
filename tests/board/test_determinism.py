"""Simulated time: one sensor, scenario and seed give the same bytes every time."""

import json

import pytest

from spots.cli import main


def figures(capsys, *arguments):
    assert main(["demo", "--fast", "--seconds", "5", "--json", *arguments]) == 0
    return json.loads(capsys.readouterr().out.splitlines()[-1])


def test_the_same_seed_gives_the_same_stream_and_another_one_another(capsys):
    first, second = figures(capsys), figures(capsys)
    other = figures(capsys, "--seed", "1")
    assert first == second
    assert first["stream_sha256"] != other["stream_sha256"]


def test_the_demo_meets_its_figures(capsys):
    run = figures(capsys)
    assert run["runtime"].startswith("micropython")
    assert run["rate_hz"] >= 95
    assert run["lost"] == run["bad_crc"] == 0
    assert run["touches"] >= 3
    assert run["position_rmse_um"] <= 150
    assert run["latency_ms"]["p50"] == pytest.approx(5.6, abs=0.6)  # half an exposure and the bus
