"""The wheel holds all that an installed package needs: firmware, boards, data files."""

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The wheel's content, unpacked."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder)]
    subprocess.run([*build, str(REPOSITORY)], check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    zipfile.ZipFile(wheel).extractall(folder / "site")
    return folder / "site"


@pytest.mark.parametrize(("use", "figure"), [("strip", "touches"), ("controller", "states")])
def test_the_demo_runs_from_the_wheel_alone(installed, tmp_path, use, figure):
    demo = "import sys, spots.cli; print(spots.__file__); sys.exit(spots.cli.main())"
    run = subprocess.run(
        [sys.executable, "-c", demo, "demo", "--fast", "--seconds", "1", "--json", "--use", use],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(installed)},
        capture_output=True,
        text=True,
    )
    assert run.returncode == 0, run.stderr
    where, figures = run.stdout.splitlines()
    assert where.startswith(str(installed))
    assert json.loads(figures)[figure] >= 1


def test_every_board_of_the_checkout_is_in_the_wheel(installed):
    def boards(root):
        return sorted(str(p.relative_to(root)) for p in (root / "boards").rglob("*.[pt]*[yl]"))

    assert boards(installed / "spots" / "_device") == boards(REPOSITORY) != []
