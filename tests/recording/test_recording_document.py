"""docs/program/recording-format.md: its statements about the file format are correct."""

import configparser
import re
import shlex
import subprocess
from pathlib import Path

import msgspec
import pytest
from bench import recording as bench

from spots import cli
from spots.link.decoder import Decoder, note
from spots.link.frames import Note
from spots.recording.arrays import _TABLES
from spots.recording.header import Header

DOCS = Path(__file__).parents[2] / "docs"
DOCUMENT = (DOCS / "program" / "recording-format.md").read_text(encoding="utf-8")


def test_the_note_that_is_taken_apart_is_one():
    told = bytes.fromhex(re.search(r"\n`((?:[0-9a-f]{2} )+[0-9a-f]{2})`\n", DOCUMENT)[1])
    assert told == note(12_345_678)
    assert Decoder().feed(told) == [Note(12_345_678, {})]
    rows = DOCUMENT.partition("| bytes | meaning |")[2].partition("\n\n")[0]
    pieces = re.findall(r"`([0-9a-f ]+)`", rows)
    assert bytes.fromhex("".join(pieces)) == told


def test_every_column_of_the_arrays_is_in_the_table():
    table = DOCUMENT.partition("| column | type | meaning |")[2].partition("\n\n")[0]
    named = set(re.findall(r"`(\w+)`", table))
    assert named == {name for kind in _TABLES.values() for name in kind.dtype.names}


def test_every_key_of_the_header_is_in_the_table():
    table = DOCUMENT.partition("| key | meaning |")[2].partition("\n\n")[0]
    keys = [key for row in re.findall(r"^\| (`.*?) \|", table, re.M) for key in row.split(", ")]
    assert sorted(key.strip("`") for key in keys) == sorted(
        field.name for field in msgspec.structs.fields(Header)
    )


@pytest.mark.board
def test_the_bytes_a_frame_are_those_that_are_measured(tmp_path):
    measured = bench._overhead(tmp_path)
    for what in ("touch", "touch spectrum"):
        row = re.search(rf"^\| `stream {what}` \| (.*) \|$", DOCUMENT, re.M)[1]
        told = [float(cell) for cell in row.split("|")]
        found = [measured[f"{what} at {rate} Hz"] for rate in (100, 360, 1000)]
        assert told == pytest.approx(found, abs=0.011)  # the header has a time, of some digits


def test_the_times_are_ratios_to_plain_decoding(tmp_path, monkeypatch):
    monkeypatch.setattr(bench, "_READINGS", 50)
    ratios = bench._times(tmp_path)
    assert set(ratios) > {"record", "read", "replay", "export mcap"}
    assert all(ratio > 0 for ratio in ratios.values())


@pytest.mark.board
def test_the_unit_for_systemd_runs_a_command_that_exists():
    page = (DOCS / "operate" / "services.md").read_text(encoding="utf-8")
    (text,) = re.findall(r"```ini\n(.*?)```", page, re.DOTALL)
    unit = configparser.ConfigParser(interpolation=None)
    unit.optionxform = str
    unit.read_string(text)
    assert set(unit.sections()) == {"Unit", "Service", "Install"}
    shell, option, script = shlex.split(unit["Service"]["ExecStart"].replace("%%", "%"))
    assert (shell, option) == ("/bin/sh", "-c")
    begin, program, command = script.split(None, 2)
    assert (begin, program.rpartition("/")[2]) == ("exec", "spots")
    echoed = subprocess.run([shell, option, f"echo {command}"], capture_output=True, text=True)
    options = cli._parser().parse_args(echoed.stdout.split())
    assert options.wait
    assert re.fullmatch(r"run-\d{8}-\d{6}\.spots", options.file)
