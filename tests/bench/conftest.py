"""Runs the benchmark once for all tests of its results."""

from __future__ import annotations

import json

import pytest

import bench


@pytest.fixture(scope="session")
def results(once):
    """Results of one run, which all worker processes of a test run share."""
    path = once("bench.json", lambda path: path.write_text(json.dumps(bench.run())))
    return json.loads(path.read_text())
