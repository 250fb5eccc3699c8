"""One run of the benchmark for all that is said about it."""

from __future__ import annotations

import pytest

import bench


@pytest.fixture(scope="session")
def results():
    return bench.run()
