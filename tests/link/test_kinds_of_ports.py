"""Kinds of ports: what the name of an entry point says of a port whose module is not loaded."""

from importlib.metadata import EntryPoint, EntryPoints

import pytest

from spots.link import ports

NAMES = "tape.FILE.read-only", "radio.ADDRESS.comes-and-goes", "model"


@pytest.fixture(autouse=True)
def installed(monkeypatch):
    entries = EntryPoints(EntryPoint(name, "not_there:open_port", ports.GROUP) for name in NAMES)
    monkeypatch.setattr(ports, "entry_points", lambda group: entries.select(group=group))


def test_the_help_shows_how_each_kind_of_port_is_written():
    assert ports.known() == "'model', radio:ADDRESS or tape:FILE"
    assert ports.known(without=["model", "tape"]) == "radio:ADDRESS"


def test_a_misspelt_kind_is_suggested_as_it_is_written():
    assert ports.no_port("radoi:7") == "there is no port radoi:7: did you mean radio:ADDRESS?"


def test_a_fact_holds_for_the_kinds_that_name_it():
    assert ports.schemes("read-only") == ["tape"]
    assert all(map(ports.comes_and_goes, ("radio:7", "COM3", None)))
    assert not any(map(ports.comes_and_goes, ("tape:a", "model")))
