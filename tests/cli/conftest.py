"""Fixture: the unpacked wheel of the package, built one time for all processes of a test run."""

import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]


def _unpacked_wheel(folder):
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder)]
    subprocess.run([*build, str(REPOSITORY)], check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(folder / "site")


@pytest.fixture(scope="session")
def installed(once):
    """Folder with the unpacked content of the wheel."""
    return once("wheel", _unpacked_wheel) / "site"
