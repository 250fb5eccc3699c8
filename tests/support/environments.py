"""Fresh environments with the wheel of the package, and with only the packages that it asks for."""

from __future__ import annotations

import importlib.metadata
import os
import re
import subprocess
import sys
import venv
import zipfile
from pathlib import Path

from packaging.requirements import Requirement


def required(wheel, extras):
    """Return the distributions that the wheel with `extras` requires here, by their names.

    Their versions are those of this environment, so no test downloads anything.
    """
    (folder,) = (path for path in zipfile.Path(wheel).iterdir() if path.suffix == ".dist-info")
    wanted = _active(importlib.metadata.PathDistribution(folder), extras)
    found, seen = {}, set()
    while wanted:
        one = wanted.pop()
        name = re.sub(r"[-_.]+", "-", one.name).lower()
        if (name, *sorted(one.extras)) not in seen:
            seen.add((name, *sorted(one.extras)))
            found[name] = importlib.metadata.distribution(name)
            wanted += _active(found[name], one.extras)
    return found


def _active(distribution, extras):
    """Return the requirements of a distribution with `extras` that apply to this computer."""
    return [
        need
        for need in map(Requirement, distribution.requires or [])
        if need.marker is None
        or any(need.marker.evaluate({"extra": extra}) for extra in ("", *extras))
    ]


def create(folder: Path, wheel: Path, extras) -> None:
    """Create an environment in `folder`, in which pip installs the wheel with its `extras`.

    The packages that the wheel requires are links to those of this environment. pip refuses to
    install the wheel if one of them is missing.
    """
    venv.create(folder, symlinks=True)
    (site,) = folder.glob("lib/python*/site-packages")
    for distribution in required(wheel, extras).values():
        for file in distribution.files:
            if ".." not in file.parts and "__pycache__" not in file.parts:
                (site / file).parent.mkdir(parents=True, exist_ok=True)
                (site / file).symlink_to(distribution.locate_file(file))
    pip = [sys.executable, "-m", "pip", "--python", str(folder), "--disable-pip-version-check"]
    wanted = f"{wheel}[{','.join(extras)}]" if extras else str(wheel)
    subprocess.run([*pip, "install", "--quiet", "--no-index", wanted], check=True)


def variables(folder: Path) -> dict[str, str]:
    """Return the variables for a program that uses the environment in `folder`."""
    away = "PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV"
    kept = {name: value for name, value in os.environ.items() if name not in away}
    others = [p for p in kept["PATH"].split(os.pathsep) if p != str(Path(sys.executable).parent)]
    return kept | {"PATH": os.pathsep.join([str(folder / "bin"), *others]), "BROWSER": "true"}
