"""What `make release` writes, made twice in two folders, and the workflows around it."""

import csv
import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import pytest

from spots.common.toml import tomllib
from spots.deploy.build import build, files_of
from spots_device import __version__

ROOT = Path(__file__).parents[2]
DATE_S = 1_800_000_000


@pytest.fixture(scope="session")
def releases(once):
    """Folders of two releases from two copies of what git knows."""
    root = once("releases", _release_twice)
    return [root / "UTC" / "dist", root / "Auckland" / "dist"]


def _release_twice(folder):
    for name, zone in (("UTC", "UTC"), ("Auckland", "Pacific/Auckland")):
        root = folder / name
        listed = subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True
        )
        for name in filter(None, listed.stdout.decode().split("\0")):
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_bytes((ROOT / name).read_bytes())
        environment = os.environ | {"SOURCE_DATE_EPOCH": str(DATE_S), "TZ": zone}
        environment |= {"PYTHONPATH": os.pathsep.join(map(str, (root / "host", root / "firmware")))}
        page = root / "page"
        page.mkdir()
        (page / "index.html").write_text("<!doctype html>")
        command = [sys.executable, str(root / "tools" / "release.py"), str(root / "dist")]
        command += ["--live", str(page)]
        subprocess.run(command, check=True, env=environment, cwd=root, capture_output=True)
        time.sleep(2)  # the resolution of dates in zip files


@pytest.mark.board
def test_two_releases_are_equal(releases):
    first, second = ({path.name: path.read_bytes() for path in one.iterdir()} for one in releases)
    assert first.keys() == second.keys()
    assert not [name for name in first if first[name] != second[name]]


@pytest.mark.board
def test_the_hashes_are_those_of_the_files(releases):
    for line in (releases[0] / "SHA256SUMS").read_text().splitlines():
        digest, name = line.split("  ")
        assert hashlib.sha256((releases[0] / name).read_bytes()).hexdigest() == digest
    assert len(list(releases[0].iterdir())) == 1 + len(
        (releases[0] / "SHA256SUMS").read_text().splitlines()
    )


@pytest.mark.board
def test_a_release_has_each_real_board_and_the_licences(releases):
    names = {path.name for path in releases[0].iterdir()}
    for board in ("pico", "pico2", "xiao_esp32s3", "qtpy_rp2040", "feather_rp2040"):
        (packed,) = [name for name in names if name.startswith(f"spots-{board}-")]
        files = zipfile.ZipFile(releases[0] / packed).namelist()
        assert "licenses/LICENSE" in files
        assert "board_config.py" in files
        adafruit = [name for name in files if name.startswith("licenses/adafruit")]
        assert bool(adafruit) == any(name.startswith("lib/") for name in files)
    (live,) = [name for name in names if name.startswith("spots-live-")]
    assert "index.html" in zipfile.ZipFile(releases[0] / live).namelist()
    (wheel,) = [name for name in names if name.endswith(".whl")]
    with zipfile.ZipFile(releases[0] / wheel) as packed:
        (record,) = [name for name in packed.namelist() if name.endswith("RECORD")]
        rows = {row[0] for row in csv.reader(packed.read(record).decode().splitlines())}
    assert "spots/_device/boards/pico/board.toml" in rows


@pytest.mark.board
@pytest.mark.skipif(sys.platform != "linux", reason="circup keeps its data elsewhere")
def test_circup_installs_the_firmware_and_its_libraries(releases, tmp_path):
    (packed,) = releases[0].glob("*-bundle-py-*.zip")
    tag = packed.stem[-8:]
    data, drive = tmp_path / "circup", tmp_path / "CIRCUITPY"
    # The second bundle stands for Adafruit's: these libraries, as this Python has them.
    built = build("qtpy_rp2040", tmp_path / "built")
    bundles = {"spots": packed.name[: -len(f"-py-{tag}.zip")], "adafruit": "adafruit-bundle"}
    for owner, name in bundles.items():
        folder = data / owner / f"{name}-py"
        if owner == "spots":
            zipfile.ZipFile(packed).extractall(folder)
        else:
            shutil.copytree(built / "lib", folder / f"{name}-py-{tag}" / "lib")
    keys = {owner: f"{owner}/{name}" for owner, name in bundles.items()}
    (data / "bundle_config.json").write_text(json.dumps(keys))
    (data / "circup.json").write_text(json.dumps({key: [tag] for key in keys.values()}))
    (drive / "lib").mkdir(parents=True)
    about = "Adafruit CircuitPython 10.2.1 on 2026-01-01; QT Py with rp2040\nBoard ID:x\n"
    (drive / "boot_out.txt").write_text(about)
    circup = [Path(sys.executable).with_name("circup"), "--offline", "--path", drive]
    environment = os.environ | {"XDG_DATA_HOME": str(tmp_path)}
    subprocess.run([*circup, "install", "spots_device"], env=environment, check=True)
    listed = subprocess.run([*circup, "freeze"], env=environment, check=True, capture_output=True)
    assert f"spots_device=={__version__}" in listed.stdout.decode().split()
    for path, content in files_of(built).items():
        if "/" in path:
            there = path if path.startswith("lib/") else f"lib/{path}"
            assert (drive / there).read_bytes() == content, path


@pytest.mark.board
def test_the_version_is_the_same_everywhere(releases):
    cited = re.search(r"^version: (.*)$", (ROOT / "CITATION.cff").read_text(), re.MULTILINE)[1]
    logged = re.search(r"^## \[?([\d.]+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)[1]
    assert {cited, logged} == {__version__}
    assert (releases[0] / f"spots_tactile-{__version__}.tar.gz").exists()


def test_each_job_runs_targets_that_exist():
    makefile = (ROOT / "Makefile").read_text()
    for path in (ROOT / ".github" / "workflows").glob("*.yml"):
        for target in re.findall(r"run: make (\w[\w-]*)", path.read_text()):
            assert re.search(rf"^(\w+ )*{target}( \w+)*:", makefile, re.MULTILINE), target


def test_the_oldest_python_is_the_one_of_the_package():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    oldest = project["requires-python"].removeprefix(">=")
    tested = re.findall(r'python: \["([\d.]+)"', (ROOT / ".github/workflows/test.yml").read_text())
    assert {*tested} == {oldest}
