"""Text files as the editors of Windows write them: byte order marks, UTF-16 and CRLF."""

import codecs
from pathlib import Path

import pytest
from support.refusals import refusal

from spots.calibrate import calibration_file
from spots.controller import controller_settings
from spots.errors import FileError
from spots.keyboard import layout
from spots.wearable import wearable
from spots_device.reading.calibration import Calibration
from spots_linkage import mounted, twin_points
from spots_sim.strip import files

DRAWN = """bar_mm = [100, 100, 100, 100]
base_mm = 80
joint = [{calibration = "a", offset_deg = 0}, {calibration = "b", offset_deg = 0}]
# Größe
"""
POINTS = "x_mm,y_mm,joint1_deg,joint2_deg,sigma1_deg,sigma2_deg\n0,100,10,20,0.1,0.1\n"
SIM = files.DATA
# For each kind of file: its text, and the function that reads it.
KINDS = {
    "layout": (layout.FOLDER / "mini.toml", lambda path: layout.load(path).lines),
    "controller": (controller_settings.DEFAULT, controller_settings.load),
    "gestures": (wearable.DEFAULT, lambda path: wearable.Mapping(path).keys),
    "linkage": (DRAWN, mounted.load),
    "points": (POINTS, lambda path: twin_points._read(path)[0].tolist()),
    "sensor": (SIM / "sensors/default.toml", lambda path: files.load(files.SensorFile, path)),
    "scenario": (SIM / "scenarios/demo.toml", lambda path: files.load(files.ScenarioFile, path)),
}
FORMS = {
    "mark": lambda text: codecs.BOM_UTF8 + text.encode(),
    "crlf": lambda text: text.replace("\n", "\r\n").encode(),
    "mark and crlf": lambda text: codecs.BOM_UTF8 + text.replace("\n", "\r\n").encode(),
    "utf-16": lambda text: text.encode("utf-16"),
    "utf-16, big-endian": lambda text: codecs.BOM_UTF16_BE + text.encode("utf-16-be"),
}


def written(tmp_path, text, form):
    path = tmp_path / "file.toml"
    path.write_bytes(FORMS[form](text) if form else text.encode())
    return path


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_file_is_read_in_every_form(tmp_path, kind, form):
    text, read = KINDS[kind]
    text = text.read_text(encoding="utf-8") if isinstance(text, Path) else text
    assert read(written(tmp_path, text, form)) == read(written(tmp_path, text, None))


@pytest.mark.parametrize("form", FORMS)
def test_a_calibration_is_read_in_every_form(tmp_path, calibration, form):
    conditions = Calibration(calibration).conditions
    lines = tuple(calibration)
    made = calibration_file.CalibrationFile(
        date=calibration_file.now(), **conditions._asdict(), lines=lines, residuals=[]
    )
    calibration_file.save(made, tmp_path / "saved.toml", None)
    text = (tmp_path / "saved.toml").read_text(encoding="utf-8")
    assert calibration_file.load(written(tmp_path, text, form)) == made


@pytest.mark.parametrize("data", [b"name = '\xe4'", "name".encode("utf-16")[:-1]])
def test_a_file_in_another_encoding_is_refused_with_the_reason(tmp_path, data):
    path = tmp_path / "file.toml"
    path.write_bytes(data)
    with refusal(FileError):
        layout.load(path)


def test_no_pattern_of_lines_goes_on_over_the_end_of_a_line():
    """With ``^\\s*``, 32,000 empty lines took 13 s, because each line is searched to the end."""
    host = Path(__file__).parents[2] / "host"
    modules = [path.read_text(encoding="utf-8") for path in host.rglob("*.py")]
    assert sum("MULTILINE" in text for text in modules) >= 3
    assert [line for text in modules for line in text.splitlines() if r"^\s*" in line] == []
