"""Results of the linkage benchmark: arrays are fast, and all ways give the same end points."""

from __future__ import annotations

import pytest

from bench import linkage
from bench.report import _linkage, _text


@pytest.fixture
def small(monkeypatch):
    monkeypatch.setattr(linkage, "_CALLS", 200)
    monkeypatch.setattr(linkage, "_LOOPS", 2000)
    monkeypatch.setattr(linkage, "_ROUNDS", 3)


@pytest.mark.board
def test_a_million_at_once_are_fifty_times_faster_than_one_by_one(small):
    figures = linkage.measure()
    assert linkage._SAMPLES == 10**6
    assert figures["rate_ratio_over_calls"] > 50


def test_another_formula_gets_no_rate(small, monkeypatch):
    monkeypatch.setattr(linkage, "_SAMPLES", 4000)
    monkeypatch.setattr(linkage, "_by_math", lambda theta1, theta2: (theta1, theta2))
    with pytest.raises(AssertionError, match="'math' differ"):
        linkage.measure()


@pytest.mark.board
def test_its_table_shows_every_way(small):
    figures = linkage.measure()
    text = _text(_linkage(figures))
    for name in ("array", "calls", "math"):
        assert f"{figures[name]['terminals_per_s']:,}" in text
    assert f"{figures['rate_ratio_over_math']:.0f} times that of the bare formula" in text
    assert max(map(len, text.splitlines())) <= 100
