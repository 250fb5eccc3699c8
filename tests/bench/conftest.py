"""Runs the benchmark one time for all tests of its results."""

from __future__ import annotations

import json
import shutil

import pytest

import bench
from bench import firmware, host, linkage, space

# A test needs fewer rounds than a report: numbers of bytes do not depend on the rounds. The arrays
# have all rounds, because the ratio of their rate to that of JSON is near the test's limit.
SHORT = {
    (firmware, "_ROUNDS"): 5,
    (host, "_ROUNDS"): 3,
    (linkage, "_CALLS"): 200,
    (linkage, "_LOOPS"): 2000,
    (linkage, "_ROUNDS"): 3,
}


def _run(path, built):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(
            space, "build", lambda board, root: shutil.copytree(built(board), root / board)
        )
        for (module, name), value in SHORT.items():
            patch.setattr(module, name, value)
        path.write_text(json.dumps(bench.run()))


@pytest.fixture(scope="session")
def results(once, built):
    """Results of one short run, which all worker processes of a test run share."""
    return json.loads(once("bench.json", lambda path: _run(path, built)).read_text())
