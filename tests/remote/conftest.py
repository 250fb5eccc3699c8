"""A network for each test; what is opened by name calls its hub."""

import pytest

from net import Net


@pytest.fixture
def net(tmp_path, monkeypatch):
    made = Net(tmp_path)
    monkeypatch.setenv("ZENOH_CONFIG", str(made.leaf))
    return made
