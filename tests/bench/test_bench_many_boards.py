"""The benchmark of many boards reads real pseudo-terminals, and loses nothing."""

import pytest

from bench import many_boards

pytestmark = pytest.mark.board


def test_a_few_boards_lose_nothing():
    row = many_boards.measure(3, 0.5)
    assert row["lost"] == 0
    assert row["rate_hz"] > 0
    assert 0 < row["p50_ms"] <= row["p99_ms"]
