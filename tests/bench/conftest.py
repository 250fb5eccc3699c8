"""One run of the benchmark for all that is said about it."""

from __future__ import annotations

import json

import pytest

import bench


@pytest.fixture(scope="session")
def results(once):
    """The figures of one run, which the workers of a test run share."""
    path = once("bench.json", lambda path: path.write_text(json.dumps(bench.run())))
    return json.loads(path.read_text())
