"""Figures of a simulated linkage, and the figures and numbers in docs/evidence/linkage.md."""

from __future__ import annotations

import importlib.util
import re
from unittest.mock import create_autospec

import msgspec
import numpy as np
import pytest
from make import linkage_page as page
from support.refusals import refusal

from spots.errors import FileError, RequirementError
from spots_linkage import Linkage
from spots_sim.measure import figures, maps
from spots_sim.measure.survey import follow, survey
from spots_sim.person.mechanism import Mechanism
from spots_sim.strip.files import (
    LinkageFile,
    PathFile,
    SensorFile,
    load,
)


@pytest.fixture(scope="module")
def files():
    return load(SensorFile, "default"), load(LinkageFile, "default"), load(PathFile, "sust")


@pytest.fixture(scope="module")
def found(files):
    return survey(*files[:2], exposure_us=30_000, pitch_mm=22.0)


@pytest.fixture(scope="module")
def run(files):
    sensor, linkage, path = files
    return follow(sensor, linkage, msgspec.structs.replace(path, stroke=path.stroke[-1:]))


@pytest.mark.parametrize("joint", [0, 1])
def test_along_a_line_one_joint_stands(joint):
    linkage = Linkage((90, 120, 105, 80), 70)
    x, y = maps.iso_angles(linkage, joint, -0.4)
    assert x.count() > 50
    keep = ~x.mask
    theta = linkage.inverse(x.data[keep], y.data[keep])
    assert abs(theta[joint] + 0.4).max() < 1e-6
    assert np.ptp(theta[1 - joint]) > 0.5
    _, half = maps.iso_angles(linkage, joint, -0.4, lambda x, y: y > 110)
    assert 0 < half.count() < x.count()
    assert half.min() > 110


@pytest.mark.board
def test_the_program_of_the_page_writes_it_and_its_pictures(found, run, tmp_path, monkeypatch):
    for name, result in (("survey", found), ("follow", run)):
        monkeypatch.setattr(page, name, create_autospec(getattr(page, name), return_value=result))
    page.main(tmp_path)
    sizes = {path.name: path.stat().st_size for path in tmp_path.rglob("*.*")}
    assert sizes.keys() == {"linkage.md", "angles.png", "deviation.png", "sust.png"}
    assert min(sizes.values()) > 4000
    text = (tmp_path / "evidence" / "linkage.md").read_text(encoding="utf-8")
    assert "places, mean of a stop | 0." in text
    (said,) = re.findall(r"^Accuracy .* ideal strips, .*", text, re.MULTILINE)
    (row,) = re.findall(r"^\| fitted to \d+ places \| .* to (\S+) \|$", text, re.MULTILINE)
    found_mm = [float(mm) for mm in re.findall(r"(\S+) mm with", said)]
    assert found_mm == [pytest.approx(float(row), abs=0.0051)] * len(found_mm) != []


@pytest.mark.board
def test_the_page_tells_what_was_measured(files, found, run):
    sensor, linkage, _ = files
    surveys = {"ideal": [found], "real": [found]}
    runs = {"ideal": {30_000: [run]}, "real": {30_000: [run]}}
    one_board = {"ideal": [found]}
    text = page.document(surveys, one_board, runs, linkage, Mechanism(linkage, sensor))
    for name in ("deviation", "sust"):
        assert f"(../pictures/linkage/{name}.png)" in text
    for part in (found.given, found.calibrated, found.rested):
        assert f"{part.max_mm:.3f} to {part.max_mm:.3f}" in text
    figures = run.summary()
    mean = figures["error_mm"]["mean"]
    for strips in surveys:
        assert f"| {strips} | 30 ms | {figures['rate_hz']:.0f} | {mean:.3f} to {mean:.3f} |" in text
    assert f"| base (mm) | 80 | 80.72 | {found.kinematics.values['base_mm']:.2f} |" in text
    assert not re.search(r"\{|nan", text)


@pytest.mark.board
def test_a_real_linkage_is_right_again_after_a_re_zero_of_its_joints(files):
    _, linkage, path = files
    last = msgspec.structs.replace(path, stroke=path.stroke[-1:])
    real = load(SensorFile, "real")
    rezeroed = follow(real, linkage, last, 0, 30_000, rezeroed=True).summary()
    assert rezeroed["error_mm"]["mean"] < 0.2


@pytest.mark.board
def test_without_matplotlib_it_says_what_to_install(monkeypatch, tmp_path, found):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        figures, "find_spec", lambda name: None if name == "matplotlib" else find(name)
    )
    with refusal(RequirementError):
        maps.deviation(found, tmp_path / "a.png")


def test_a_picture_that_cannot_be_written_is_one_sentence(tmp_path, run):
    with refusal(FileError):
        maps.trajectory(run, tmp_path / "no" / "a.png")
