"""What `make release` writes, made twice in two folders, and the workflows around it."""

import csv
import hashlib
import os
import re
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import pytest

from spots.common.toml import tomllib

ROOT = Path(__file__).parents[2]
DATE_S = 1_800_000_000


@pytest.fixture(scope="module")
def releases(tmp_path_factory):
    """Folders of two releases from two copies of what git knows."""
    made = []
    for zone in ("UTC", "Pacific/Auckland"):
        root = tmp_path_factory.mktemp("release")
        listed = subprocess.run(
            ["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True
        )
        for name in filter(None, listed.stdout.decode().split("\0")):
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_bytes((ROOT / name).read_bytes())
        environment = os.environ | {"SOURCE_DATE_EPOCH": str(DATE_S), "TZ": zone}
        environment |= {"PYTHONPATH": os.pathsep.join(map(str, (root / "host", root / "firmware")))}
        command = [sys.executable, str(root / "tools" / "release.py"), str(root / "dist")]
        subprocess.run(command, check=True, env=environment, cwd=root, capture_output=True)
        made.append(root / "dist")
        time.sleep(2)  # the resolution of dates in zip files
    return made


def test_two_releases_are_equal(releases):
    first, second = ({path.name: path.read_bytes() for path in one.iterdir()} for one in releases)
    assert first.keys() == second.keys()
    assert not [name for name in first if first[name] != second[name]]


def test_the_hashes_are_those_of_the_files(releases):
    for line in (releases[0] / "SHA256SUMS").read_text().splitlines():
        digest, name = line.split("  ")
        assert hashlib.sha256((releases[0] / name).read_bytes()).hexdigest() == digest
    assert len(list(releases[0].iterdir())) == 1 + len(
        (releases[0] / "SHA256SUMS").read_text().splitlines()
    )


def test_a_release_has_each_real_board_and_the_licences(releases):
    names = {path.name for path in releases[0].iterdir()}
    for board in ("pico", "pico2", "xiao_esp32s3", "qtpy_rp2040", "feather_rp2040"):
        (packed,) = [name for name in names if name.startswith(f"spots-{board}-")]
        files = zipfile.ZipFile(releases[0] / packed).namelist()
        assert "licenses/LICENSE" in files
        assert "board_config.py" in files
        adafruit = [name for name in files if name.startswith("licenses/adafruit")]
        assert bool(adafruit) == any(name.startswith("lib/") for name in files)
    (wheel,) = [name for name in names if name.endswith(".whl")]
    with zipfile.ZipFile(releases[0] / wheel) as packed:
        (record,) = [name for name in packed.namelist() if name.endswith("RECORD")]
        rows = {row[0] for row in csv.reader(packed.read(record).decode().splitlines())}
    assert "spots/_device/boards/pico/board.toml" in rows


def test_the_version_is_the_same_everywhere(releases):
    from spots_device import __version__

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
