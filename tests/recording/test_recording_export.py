"""`spots export`: MCAP, CSV and NumPy files contain the numbers of the recording."""

import csv
import json
import math
import struct
import sys

import msgspec
import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader
from support.frames import encoded, stream
from support.reels import INFO, clock, record
from support.refusals import refusal

import spots
from spots.cli import main
from spots.errors import FileError
from spots.link.frames import Contact, Key, Spectrum, Text, Touch
from spots.recording import export as exports
from spots.recording.table import described as described_by
from spots.recording.writer import Writer
from spots_device.reading.frame import TEXT_MAX

KINDS = {"touch": Touch, "spectrum": Spectrum, "key": Key, "contact": Contact, "text": Text}


@pytest.fixture(scope="module")
def truth(seen):
    """Expected rows of the exported tables: a list of dicts for each kind of frame."""
    recording = spots.Recording(seen.path)
    begun_s = recording.header.host_s
    tables = {name: [] for name in KINDS}
    for arrived_s, frame in recording:
        row = {"arrived_s": arrived_s - begun_s, **frame._asdict()}
        row["time_s"] = row.get("time_s", arrived_s) - begun_s
        for name in ("touching", "trusted", "contrast", "brightness"):
            if hasattr(frame, name):
                row[name] = getattr(frame, name)
        row |= {f"counts_{name}": one for name, one in zip(PLAN, row.pop("counts", ()))}
        tables[type(frame).__name__.lower()].append(row)
    assert all(tables.values())
    assert {touch["touching"] for touch in tables["touch"]} == {False, True}
    return tables


PLAN = ["F3", "F4", "F5", "F6", "F7", "F8"]
RENAMED = {"contrast_log2": "contrast", "brightness_log2": "brightness", "gain_code": "gain"}
TIMES = {"time_s", "arrived_s"}


def check(row, wanted):
    for name, value in row.items():
        other = wanted.get(RENAMED.get(name, name))
        if name in TIMES:
            assert value == pytest.approx(other, abs=1e-9)
        elif name == "known":
            unknown = any(wanted[one] != wanted[one] for one in ("position_um", "force_mN"))
            assert bool(value) is not unknown
        elif other != other:  # an unknown value
            assert value is None, name
        else:
            assert value == other, name


def exported(seen, tmp_path, kind):
    out = tmp_path / f"out.{kind}"
    return exports.export(seen.path, kind, out)


def test_mcap(seen, truth, tmp_path):
    (path,) = exported(seen, tmp_path, "mcap")
    found = {name: [] for name in KINDS}
    topics = set()
    with open(path, "rb") as file:
        reader = make_reader(file)
        begun_ns = None
        for metadata in reader.iter_metadata():
            assert json.loads(metadata.metadata["info"]) == spots.Recording(seen.path).header.info
            begun_ns = round(1e9 * float(metadata.metadata["utc_s"]))
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            topics.add((channel.topic, schema.name))
            assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
            row = json.loads(message.data)
            properties = json.loads(schema.data)["properties"]
            assert set(row) <= set(properties)
            assert None not in row.values()  # an unknown value is left out
            kind = "text" if schema.name == "foxglove.Log" else channel.topic.split("/")[-1]
            wanted = truth[kind][len(found[kind])]
            found[kind].append(row)
            assert message.log_time - begun_ns == pytest.approx(1e9 * wanted["time_s"], abs=1)
            assert message.sequence == wanted["sequence"]
            if kind == "text":
                assert json.loads(row["message"]) == wanted["content"]
            else:
                check({**dict.fromkeys(properties), **row}, wanted)
    assert {kind: len(rows) for kind, rows in found.items()} == {
        kind: len(rows) for kind, rows in truth.items()
    }
    assert topics == {
        ("/spots/0/touch", "spots.Touch"),
        ("/spots/0/spectrum", "spots.Spectrum"),
        ("/spots/0/key", "spots.Key"),
        ("/spots/0/contact", "spots.Contact"),
        ("/spots/log", "foxglove.Log"),
    }


def test_csv(seen, truth, tmp_path):
    paths = exported(seen, tmp_path, "csv")
    names = {f"out-{kind}.csv" for kind in KINDS} | {"out-header.json"}
    assert {path.name for path in paths} == names
    for kind, rows in truth.items():
        with open(tmp_path / f"out-{kind}.csv", newline="", encoding="utf-8") as file:
            read = list(csv.DictReader(file))
        assert len(read) == len(rows)
        for cells, wanted in zip(read, rows):
            content = cells.pop("content", None)
            assert content is None or json.loads(content) == wanted["content"]
            check({name: float(cell) if cell else None for name, cell in cells.items()}, wanted)
    described(json.loads((tmp_path / "out-header.json").read_text(encoding="utf-8")), seen)


def described(found, seen):
    """Check the description of an export: the header, and no change of the settings."""
    assert found.pop("changes") == []  # keys were turned on, which changes no reading
    header = msgspec.to_builtins(spots.Recording(seen.path).header)
    assert found | {"utc_s": header["utc_s"]} == header  # the board's time is simulated, UTC is not
    (dark,) = found["dark"]
    assert len(dark) == 6


@pytest.mark.parametrize(("out", "name"), [("d.v1", "d.v1"), ("d.v2", "d.v2"), ("d.csv", "d")])
def test_tables_drop_no_more_of_their_name_than_csv(tmp_path, out, name):
    record(tmp_path / "run.spots", stream(5))
    paths = exports.export(tmp_path / "run.spots", "csv", tmp_path / out)
    assert [path.name for path in paths] == [f"{name}-touch.csv", f"{name}-header.json"]


def test_npz(seen, truth, tmp_path, monkeypatch):
    monkeypatch.setattr(exports, "_BLOCK_ROWS", 64)
    (path,) = exported(seen, tmp_path, "npz")
    arrays = np.load(path)
    described(json.loads(str(arrays["header"])), seen)
    for kind, rows in truth.items():
        assert len(arrays[kind]) == len(rows)
        for cells, wanted in zip(arrays[kind], rows):
            row = dict(zip(cells.dtype.names, cells.tolist()))
            logs = "contrast_log2", "brightness_log2"
            for name in ("position_um", "force_mN", "sigma_um", *logs):
                empty = 0 if name in ("position_um", "force_mN") else math.nan
                unknown = wanted.get(RENAMED.get(name, name), 0)
                if name in row and unknown != unknown:
                    assert str(row[name]) == str(empty)
                    row[name] = None
            if "content" in row:
                row["content"] = json.loads(row["content"])
            check(row, wanted)


def test_pandas_and_strided_readers_take_every_table_of_npz(seen, tmp_path):
    (path,) = exported(seen, tmp_path, "npz")
    arrays = np.load(path)
    for kind in KINDS:
        table = pd.DataFrame(arrays[kind])
        assert list(table) == list(arrays[kind].dtype.names)
        for name in arrays[kind].dtype.names:
            column = arrays[kind][name]
            assert column.flags.aligned
            assert column.strides[0] % column.dtype.alignment == 0
    touches = pd.DataFrame(arrays["touch"])
    assert touches.position_um[touches.known].min() > 0 == touches.position_um.min()


def replies(*contents):
    """Encode replies of the board as frames."""
    return [
        encoded(struct.pack("<BHI", 3 | sensor << 4, i, 0) + json.dumps(content).encode())
        for i, (sensor, content) in enumerate(contents)
    ]


def recorded(tmp_path, info, *contents):
    pieces = [*stream(5), *replies(*contents)]
    known = clock().state()
    header = {"info": {**INFO, **info}, "clock": known, "dark": [[64] * 6] * 2}
    with Writer(lambda: 1000.0, tmp_path / "run.spots", lambda: header) as recorder:
        recorder.take(b"".join(pieces), 1000.0)
    return described_by(spots.RecordingBlocks(tmp_path / "run.spots"))


CHANNELS = {
    "named": ({"channels": PLAN}, [(0, {"re": "set", "gain": 3})], PLAN),
    "refused": ({"channels": PLAN}, [(0, {"re": "set", "error": "no"})], PLAN),
    "changed": ({"channels": PLAN}, [(0, {"re": "set", "channels": PLAN[::-1]})], None),
    "strips": (
        {"channels": PLAN, "strips": [{"channels": PLAN}, {"channels": PLAN[::-1]}]},
        [],
        None,
    ),
    "the same": ({"channels": PLAN, "strips": [{"channels": PLAN}] * 2}, [], PLAN),
    "twice": ({"channels": [*PLAN[:5], "F3"]}, [], None),
    "unknown": ({}, [], None),
    "invalid": (
        {"channels": PLAN, "strips": [7]},
        [(0, {"re": "set", "sensor": 9, "channels": {"a": 1}})],
        PLAN,
    ),
}


@pytest.mark.parametrize("name", CHANNELS)
def test_columns_have_the_names_of_the_channels_if_these_are_the_same_throughout(tmp_path, name):
    info, contents, channels = CHANNELS[name]
    found = recorded(tmp_path, info, *contents)
    assert list(found.channels) == (channels or [f"adc{i}" for i in range(6)])


def test_changes_of_the_settings_are_described(tmp_path):
    strips = [{"channels": PLAN, "gain": 9}, {"channels": PLAN, "gain": 8}]
    told = [
        (0, {"re": "get", "gain": 9, "dark": [64] * 6, "missed": 3}),
        (0, {"re": "set", "sensor": 1, "gain": 4, "channels": PLAN, "rate_mHz": 5}),
        (0, {"re": "dark", "sensor": 1, "dark": [65] * 6}),
        (0, {"re": "set", "error": "gain must be 0 to 10"}),
        (0, {"log": "error", "text": "x", "gain": 2}),
        (0, {"re": "set", "sensor": 1, "gain": 4}),
    ]
    changes = recorded(tmp_path, {"channels": PLAN, "strips": strips}, *told).changes
    assert [{k: v for k, v in one.items() if k != "arrived_s"} for one in changes] == [
        {"sensor": 1, "gain": 4},
        {"sensor": 1, "dark": [65] * 6},
    ]


def test_the_longest_text_is_whole_in_npz(tmp_path, monkeypatch):
    monkeypatch.setattr(exports, "_BLOCK_ROWS", 1)
    texts = [{"re": "get", "x": "\u00e9" * count} for count in (3, (TEXT_MAX - 22) // 6, 7)]
    pieces = [
        encoded(struct.pack("<BHI", 3, i, 0) + json.dumps(text).encode())
        for i, text in enumerate(texts)
    ]
    record(tmp_path / "a.spots", pieces)
    (path,) = exports.export(tmp_path / "a.spots", "npz", tmp_path / "a.npz")
    contents = np.load(path)["text"]["content"]
    assert [json.loads(content) for content in contents] == texts


def test_a_log_line_is_one_in_foxglove():
    from spots.recording.foxglove import log_message

    message = log_message(1_500_000_000, '{"log": "error", "text": "sensor lost"}', "b")
    assert message["timestamp"] == {"sec": 1, "nsec": 500_000_000}
    assert (message["level"], message["message"], message["name"]) == (4, "sensor lost", "b")


@pytest.mark.parametrize("kind", exports.EXPORTS)
def test_the_command_names_the_new_files(tmp_path, capsys, kind):
    path = tmp_path / "run.spots"
    record(path, stream(5))
    assert main(["export", str(path), "--to", kind]) == 0
    names = ["run-touch.csv", "run-header.json"] if kind == "csv" else [f"run.{kind}"]
    assert capsys.readouterr().out.splitlines() == [str(tmp_path / name) for name in names]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(["run.spots", *names])


@pytest.mark.parametrize("kind", exports.EXPORTS)
def test_nothing_is_written_over_and_nothing_half(tmp_path, capsys, kind):
    path = tmp_path / "run.spots"
    record(path, stream(5))
    mine = tmp_path / ("run-touch.csv" if kind == "csv" else f"run.{kind}")
    mine.write_text("mine")
    assert main(["export", str(path), "--to", kind]) == 2
    assert f"{mine} exists: choose another name" in capsys.readouterr().err
    assert mine.read_text() == "mine"
    assert main(["export", str(path), "--to", kind, "--out", str(tmp_path / "no" / "x")]) == 2
    assert f"there is no folder {tmp_path / 'no'}: make it" in capsys.readouterr().err
    assert len(list(tmp_path.iterdir())) == 2


def test_if_one_of_the_tables_cannot_be_written_none_is(seen, tmp_path):
    (tmp_path / "out-spectrum.csv").write_text("mine")
    with refusal(FileError, file="out-spectrum.csv"):
        exported(seen, tmp_path, "csv")
    assert [path.name for path in tmp_path.iterdir()] == ["out-spectrum.csv"]


def test_without_the_package_mcap_a_sentence(tmp_path, capsys, monkeypatch):
    record(tmp_path / "run.spots", stream(5))
    monkeypatch.setitem(sys.modules, "mcap.writer", None)
    assert main(["export", str(tmp_path / "run.spots"), "--to", "mcap"]) == 2
    assert '[export]"' in capsys.readouterr().err
    assert len(list(tmp_path.iterdir())) == 1
