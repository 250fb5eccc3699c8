"""The calibration file: saved files load again; damaged or invalid files are refused."""

import os

import msgspec
import pytest
from support.refusals import refusal

from spots import SpotsError
from spots.calibrate import calibration_file as file
from spots.errors import FileError
from spots_device.reading.calibration import Calibration

RESIDUALS = [
    file.Residual(strain_ppm=0, position_rms_um=5.7, force_rms_mN=42.8, presses=65),
    file.Residual(strain_ppm=100_000, position_rms_um=3.8, presses=17),
]
JOINT = file.Joint(
    zero_deg=-19.5,
    deg_per_um=0.00229260247,
    r2=0.9999996,
    resolution_deg=0.08,
    accuracy_deg=0.02,
    backlash_deg=0.03,
    low=(8_500.0, 0.05),
    high=(76_500.0, 0.13),
)


@pytest.fixture
def made(calibration):
    conditions = Calibration(calibration).conditions
    return file.CalibrationFile(
        date=file.now(),
        **conditions._asdict(),
        lines=tuple(calibration),
        residuals=RESIDUALS,
        joint=JOINT,
    )


@pytest.fixture
def path(made, tmp_path):
    path = tmp_path / "calibration.toml"
    file.save(made, path, None)
    return path


@pytest.mark.parametrize("joint", [None, JOINT])
def test_what_was_saved_is_loaded(made, tmp_path, joint):
    made = msgspec.structs.replace(made, joint=joint)
    file.save(made, tmp_path / "a.toml", None)
    assert file.load(tmp_path / "a.toml") == made


def test_a_person_can_read_it(path, calibration):
    text = path.read_text()
    assert f'board = "{calibration[0].split()[1]}"' in text
    assert 'plan = ["F3", "F4", "F5", "F6", "F7", "F8"]' in text
    assert max(len(line) for line in text.splitlines()) < 120


def test_a_file_that_is_cut_at_any_byte_is_refused(path):
    data = path.read_bytes()
    cuts = [*range(0, len(data) - 60, 97), *range(len(data) - 60, len(data) - 1)]
    for cut in cuts:
        path.write_bytes(data[:cut])
        with refusal(FileError, file="calibration.toml"):
            file.load(path)


def test_a_file_with_any_byte_changed_is_refused(path):
    data = path.read_bytes()
    for at in range(0, len(data), 53):
        path.write_bytes(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])
        with refusal(FileError, path=str(path)):
            file.load(path)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("version = 1", "version = 7", "version 7, but this program reads version 1: update"),
        ("gain = 9", "gain = 8", "was changed after it was written"),
        ("# Calib", "# calib", "was changed"),
    ],
)
def test_what_is_wrong_is_said(path, old, new, says):
    path.write_text(path.read_text().replace(old, new), encoding="utf-8")
    with pytest.raises(SpotsError, match=says):
        file.load(path)


def sealed(path, old, new):
    body = path.read_text().partition(file._END)[0].replace(old, new)
    path.write_text(f'{body}{file._END}crc32 = "{file._crc32(body)}"\n')


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("gain = 9", "gain = 8", "do not match its settings"),
        ('"coarse ', '"course ', "is not a calibration"),
        ("gain = 9", "gain = nine", "is not a calibration"),
        ("gain = 9", "gains = 9", "is not a calibration"),
        ("version = 1", "", "is not a calibration"),
    ],
)
def test_a_file_made_by_hand_is_checked_as_a_calibration(path, old, new, says):
    sealed(path, old, new)
    with pytest.raises(SpotsError, match=says):
        file.load(path)


def test_no_file_says_how_to_make_one(tmp_path):
    with refusal(FileError):
        file.load(tmp_path / "none.toml")
    with refusal(FileError):
        file.load(tmp_path)


def test_a_file_of_other_bytes_is_refused(path):
    path.write_bytes(b"\x80\xfe")  # not a byte order mark
    with refusal(FileError, file="calibration.toml"):
        file.load(path)


def test_a_save_that_is_cut_leaves_the_old_file(made, path, monkeypatch):
    before = path.read_bytes()

    def cut(*names):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", cut)
    with refusal(FileError, file="calibration.toml"):
        file.save(msgspec.structs.replace(made, joint=None), path, made)
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


def test_a_folder_is_no_file_to_save_in(made, tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    with refusal(FileError):
        file.save(made, folder, None)
    assert list(tmp_path.iterdir()) == [folder]
