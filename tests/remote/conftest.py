"""Fixture: a Zenoh network for each test, which ``spots.open("zenoh:…")`` uses."""

import pytest
from support.net import DEADLINE_S, Net

from spots_net import zenoh_session as session


@pytest.fixture
def net(tmp_path, monkeypatch):
    made = Net(tmp_path)
    monkeypatch.setattr(session, "_PATIENCE_S", DEADLINE_S)
    monkeypatch.setenv("ZENOH_CONFIG", str(made.leaf))
    return made
