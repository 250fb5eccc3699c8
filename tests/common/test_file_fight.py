"""Programs, a text editor and a failing disk fight over each kind of file: nothing is lost."""

import pytest

from soak import file_fight

pytestmark = pytest.mark.board


@pytest.mark.parametrize("kind", file_fight.KINDS, ids=lambda kind: kind.name)
def test_nobody_loses_what_is_in_a_file(kind, tmp_path):
    found = file_fight.Counter()
    for seed in range(10):
        folder = tmp_path / str(seed)
        folder.mkdir()
        found += file_fight.run(kind, seed, folder)
    assert found["done"] > 0 < found["disk"]
    assert found["refused"] > 0 or kind is file_fight.Points  # each program waits for the other
