"""`spots twin` makes a linkage file from measured positions of the end point."""

from __future__ import annotations

import csv
import math
from types import SimpleNamespace

import numpy as np
import pytest
from support.joints import JOINT
from support.joints import touch as reading
from support.linkage_places import FOUND, places
from support.refusals import refusal

from spots import SpotsError, cli
from spots.errors import FileError
from spots.keyboard.layout import FOLDER as LAYOUTS
from spots_linkage import Encoder, Linkage, Twin, mounted, twin_points

DRAWN = """bar_mm = [100, 100, 100, 100]
base_mm = 80
[[joint]]
calibration = "strips/a.toml"
offset_deg = -108
[[joint]]
calibration = "strips/b.toml"
offset_deg = -108
"""


@pytest.fixture
def files(tmp_path):
    """Folder with a nominal linkage file, and with points of the true linkage in points.csv.

    One of the points is wrong.
    """
    (tmp_path / "drawn.toml").write_text(DRAWN)
    angles, seen = places(40, noise=1.0)
    seen[:, 7] += 3.0
    table = np.vstack([seen, np.degrees(angles), np.full((2, 40), math.degrees(2e-4))]).T
    with open(tmp_path / "points.csv", "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["note", *twin_points.COLUMNS])
        writer.writerows([["", *row] for row in table.tolist()])
    return tmp_path


def calibrate(folder, *arguments):
    return cli.main(
        [
            *("twin", "--linkage", str(folder / "drawn.toml")),
            *("--calibrate", str(folder / "points.csv"), "--place-sigma-mm", "0.02", *arguments),
        ]
    )


def test_points_in_metres_are_refused(files, capsys):
    path = files / "points.csv"
    with open(path, newline="") as file:
        head, *rows = csv.reader(file)
    for row in rows:
        row[1:3] = [str(float(cell) / 1000) for cell in row[1:3]]
    with open(path, "w", newline="") as file:
        csv.writer(file).writerows([head, *rows])
    assert calibrate(files, "--out", str(files / "arm.toml")) == 2
    assert "give the positions in mm, not in metres" in capsys.readouterr().err
    assert not (files / "arm.toml").exists()


def test_points_become_a_linkage_file(files, capsys):
    (files / "found").mkdir()
    out = files / "found" / "arm.toml"
    assert calibrate(files, "--out", str(out)) == 0
    report = capsys.readouterr().out
    assert "from 40 points" in report
    assert "points that do not fit: 9\n" in report
    assert "rank 12 of 12" in report
    arm = mounted.load(out)
    assert arm.bar_mm == pytest.approx([FOUND[f"bar{i}_mm"] for i in (1, 2, 3, 4)], abs=0.2)
    assert arm.base_mm == pytest.approx(FOUND["base_mm"], abs=0.2)
    assert arm.offset_rad == pytest.approx((FOUND["offset1_rad"], FOUND["offset2_rad"]), abs=0.01)
    assert arm.gain == pytest.approx((FOUND["gain1"], FOUND["gain2"]), abs=0.005)
    # Paths are relative to the folder of the linkage file.
    assert [joint.calibration for joint in arm.joint] == ["../strips/a.toml", "../strips/b.toml"]
    assert "# bar1_mm " in out.read_text()
    # The file gives the correct end points, except for the position of the measuring grid.
    angles, seen = places(20, seed=5)
    theta = [o + g * a for o, g, a in zip(arm.offset_rad, arm.gain, angles)]
    x_mm, y_mm = arm.linkage.forward(*theta)
    x_mm, y_mm = x_mm - x_mm.mean(), y_mm - y_mm.mean()
    off = np.hypot(x_mm, y_mm) - np.hypot(*(seen - seen.mean(axis=1, keepdims=True)))
    assert abs(off).max() < 0.1


def test_without_a_name_nothing_is_written(files, capsys):
    before = sorted(files.iterdir())
    assert calibrate(files) == 0
    assert "nothing was written: add --out" in capsys.readouterr().out
    assert sorted(files.iterdir()) == before


@pytest.mark.parametrize("name", ["points.csv", "strips/a.toml", "strips/../strips/b.toml"])
def test_a_linkage_file_replaces_nothing_it_is_made_from(name, files, capsys):
    (files / "strips").mkdir()
    for strip in ("a.toml", "b.toml"):
        (files / "strips" / strip).write_text("a calibration")
    before = (files / name).read_bytes()
    assert calibrate(files, "--out", str(files / name)) == 2
    said = capsys.readouterr().err
    assert "would be replaced" in said
    assert said.count("\n") == 1
    assert (files / name).read_bytes() == before


def test_a_folder_is_no_linkage_file(files, capsys):
    (files / "found").mkdir()
    before = sorted(files.iterdir())
    assert calibrate(files, "--out", str(files / "found")) == 2
    said = capsys.readouterr().err
    assert "cannot write" in said
    assert said.count("\n") == 1
    assert sorted(files.iterdir()) == before


def test_what_points_cannot_tell_is_named(files, capsys):
    rows = (files / "points.csv").read_text().splitlines()
    # Only points with nearly the same angle of joint 1.
    kept = [rows[0]]
    for row in rows[1:]:
        cells = row.split(",")
        if abs(float(cells[3]) - 80) < 12:
            kept.append(row)
    assert len(kept) > 7
    (files / "points.csv").write_text("\n".join(kept))
    assert calibrate(files) == 0
    assert "these points do not determine" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x_mm,y_mm\n1,2\n", "points.csv has no column joint1_deg, joint2_deg, sigma1_deg"),
        ("", "points.csv has no column x_mm"),
        (
            ",".join(twin_points.COLUMNS) + "\n1,2,3,4,5,six\n",
            "line 2: sigma2_deg must be a number, ",
        ),
        (
            ",".join(twin_points.COLUMNS) + "\n1,2,3,4,5\n",
            "line 2: sigma2_deg must be a number, not ''",
        ),
        (",".join(twin_points.COLUMNS) + "\n1,2,3,4,5,0\n", "line 2: sigma2_deg, .* more than 0"),
        (",".join(twin_points.COLUMNS) + "\n1,2,3,4,5,6\n", "points.csv: 1 points give 2 numbers"),
        (None, "there is no file .*points.csv: .* --measure"),
    ],
)
def test_a_table_that_is_wrong_says_where(text, words, files, capsys):
    points = files / "points.csv"
    points.unlink() if text is None else points.write_text(text)
    with pytest.raises(SpotsError, match=words):
        twin_points.fit(points, files / "drawn.toml", 0.02, None)
    assert calibrate(files) == 2
    assert capsys.readouterr().err.count("\n") == 1


def test_points_are_measured_one_by_one(tmp_path):
    twin = Twin(Linkage(100, 80), (Encoder(JOINT, 1.0), Encoder(JOINT)))
    angles_deg = [40.0, 55.0]

    def readings(seconds):
        for joint in (0, 1):  # readings from before the question, at another end point
            yield joint, reading(10_000, 0, time_s=0.99)
        for i in range(20):
            for joint, angle in enumerate(angles_deg):
                if angle is not None:
                    place_um = (angle + 20) / 0.002 + (-1) ** i
                    yield joint, reading(place_um, i, time_s=1 + 0.03 * i)

    boards = [SimpleNamespace(now_s=lambda: 1.0)]
    source = SimpleNamespace(twin=twin, readings=readings, boards=boards)
    points = tmp_path / "points.csv"
    said = []

    def measure(*answers):
        replies = iter([*answers, ""])
        return twin_points.measure(source, points, lambda question: next(replies), said.append)

    assert measure("40 150", "forty 150", "40", "nan 3", "1e999 5", "5 -inf") == 1
    assert said.count("type two numbers in mm, such as: 40 150") == 5
    angles_deg[:] = 41.0, None
    assert measure("41 150") == 1
    assert "joint 2 gave 0 angles in 1 s, but 3 are needed" in said[-1]
    angles_deg[:] = 42.0, 57.0
    assert measure("42 150.5") == 2
    with open(points, newline="") as file:
        rows = [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]
    assert [row["x_mm"] for row in rows] == [40, 42]
    # The angles come from the calibrations of the joints; the mounting has no effect.
    assert [row["joint1_deg"] for row in rows] == pytest.approx([40, 42], abs=0.001)
    assert [row["joint2_deg"] for row in rows] == pytest.approx([55, 57], abs=0.001)
    assert rows[0]["sigma1_deg"] == pytest.approx(JOINT.resolution_deg / math.sqrt(20), abs=1e-5)
    # If the table has no line end at its end, the next point still gets its own line.
    points.write_bytes(points.read_bytes().rstrip())
    assert measure("44 151") == 3
    table, lines = twin_points._read(points)
    assert table[:, 0].tolist() == [40, 42, 44]
    assert lines == [2, 3, 4]


ROW = (40.0, 150.0, 1.0, 2.0, 0.1, 0.2)  # a point, in the order of `COLUMNS`


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16"])
@pytest.mark.parametrize(
    "names", [[*reversed(twin_points.COLUMNS)], ["note", *twin_points.COLUMNS[2:], "y_mm", "x_mm"]]
)
def test_a_point_is_appended_in_the_columns_of_the_table(tmp_path, names, encoding):
    points = tmp_path / "points.csv"
    cells = dict(zip(twin_points.COLUMNS, range(1, 7)))
    row = ",".join(str(cells.get(name, "first")) for name in names)
    before = f"{','.join(names)}\n{row}".encode(encoding)  # as some editors leave it
    points.write_bytes(before)
    twin_points._append(points, ROW)
    assert twin_points._read(points)[0].tolist() == [[1, 2, 3, 4, 5, 6], [*ROW]]
    assert points.read_bytes().startswith(before)


@pytest.mark.parametrize("text", ["x_mm,y_mm\n1,2\n", "mine = 1\n"])
def test_a_point_is_not_appended_to_another_table(tmp_path, text):
    points = tmp_path / "points.csv"
    points.write_text(text)
    with refusal(FileError):
        twin_points._append(points, ROW)
    assert points.read_text() == text


def test_a_point_that_is_not_on_the_disk_is_not_in_the_table(tmp_path, monkeypatch):
    points = tmp_path / "points.csv"
    twin_points._append(points, ROW)
    before = points.read_bytes()
    with monkeypatch.context() as patch:
        patch.setattr("os.fsync", lambda handle: (_ for _ in ()).throw(OSError(5, "I/O error")))
        with refusal(FileError, file="points.csv"):
            twin_points._append(points, ROW)
    assert points.read_bytes() == before


@pytest.mark.parametrize("kind", ["layout", "calibration"])
def test_a_linkage_file_replaces_no_file_of_another_kind(files, capsys, kind):
    out = files / "mine.toml"
    layout = (LAYOUTS / "mini.toml").read_text()
    out.write_text(before := layout if kind == "layout" else "# The calibration\nversion = 1\n")
    assert calibrate(files, "--out", str(out)) == 2
    assert "mine.toml would be replaced, but it is not a linkage file" in capsys.readouterr().err
    assert out.read_text() == before


def test_calibrations_on_another_drive_are_named_whole(files, monkeypatch):
    def relpath(path, start):
        raise ValueError("path is on mount 'C:', start on mount 'D:'")

    monkeypatch.setattr(twin_points.os.path, "relpath", relpath)
    (files / "found").mkdir()
    assert calibrate(files, "--out", str(files / "found" / "arm.toml")) == 0
    arm = mounted.load(files / "found" / "arm.toml")
    strips = files.resolve() / "strips"
    named = [(strips / name).as_posix() for name in ("a.toml", "b.toml")]
    assert [joint.calibration for joint in arm.joint] == named


@pytest.mark.parametrize(
    ("every", "says"),
    [(1, "times the error that is expected; nothing"), (3, "13 of 40 points do not fit, the")],
)
def test_a_linkage_that_misses_the_points_is_not_written(files, capsys, every, says):
    rows = list(csv.reader((files / "points.csv").open(newline="")))
    for row in rows[1::every]:
        row[1] = float(row[1]) + math.sin(9 * float(row[2]))
    with open(files / "points.csv", "w", newline="") as file:
        csv.writer(file).writerows(rows)
    assert calibrate(files, "--out", str(files / "arm.toml")) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1
    assert not (files / "arm.toml").exists()
