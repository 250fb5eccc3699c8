"""Fixtures: the wheel of the package, and environments in which it is installed."""

import subprocess
import sys
from pathlib import Path

import pytest
from support.environments import create, extend

REPOSITORY = Path(__file__).parents[2]


def _build_wheel(folder):
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder)]
    subprocess.run([*build, str(REPOSITORY)], check=True, capture_output=True)


@pytest.fixture(scope="session")
def environment(once, shared_folder):
    """Return a function that returns the folder of a fresh environment with the wheel installed.

    All processes of a test run share the wheel and the environments.
    """

    def environment(*extras):
        (wheel,) = once("wheel", _build_wheel).glob("*.whl")
        folder = shared_folder / "-".join(("environment", *extras))

        def make(done):
            if extras:
                extend(folder, environment(), wheel, extras)
            else:
                create(folder, wheel)
            done.touch()

        # pip writes the path of the folder into scripts, so the folder cannot be renamed.
        once(f"{folder.name}-done", make)
        return folder

    return environment
