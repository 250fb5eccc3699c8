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


def _of_wheel(wheel):
    (folder,) = (path for path in zipfile.Path(wheel).iterdir() if path.suffix == ".dist-info")
    return importlib.metadata.PathDistribution(folder)


def required(package, extras):
    """Return the distributions that `package` with `extras` requires here, by their names.

    Their versions are those of this environment, so no test downloads anything.
    """
    wanted = _active(package, extras)
    found, seen = {}, set()
    while wanted:
        one = wanted.pop()
        name = re.sub(r"[-_.]+", "-", one.name).lower()
        if (name, *sorted(one.extras)) not in seen:
            seen.add((name, *sorted(one.extras)))
            found[name] = importlib.metadata.distribution(name)
            assert one.specifier.contains(found[name].version, prereleases=True), one
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


def create(folder: Path, wheel: Path) -> None:
    """Create an environment in `folder`, in which pip installs the wheel without extras.

    The packages that the wheel requires are links to those of this environment. pip refuses to
    install the wheel if one of them is missing.
    """
    _links(folder, required(_of_wheel(wheel), ()))
    pip = [sys.executable, "-m", "pip", "--python", str(folder), "--disable-pip-version-check"]
    subprocess.run([*pip, "install", "--quiet", "--no-index", str(wheel)], check=True)


def extend(folder: Path, bare: Path, wheel: Path, extras) -> None:
    """Create an environment like `bare`, which `create` made, with the packages of `extras`.

    The wheel's own files are links, too, because pip needs a second of processor time.
    """
    _links(folder, required(_of_wheel(wheel), extras))
    name = wheel.name.partition("-")[0]
    (installed,) = importlib.metadata.distributions(name=name, path=[str(_site(bare))])
    _link(_site(folder), installed)
    for program in (bare / "bin").iterdir():
        ours = folder / "bin" / program.name
        if not ours.exists():  # a script names the path of its environment
            ours.write_text(program.read_text().replace(str(bare), str(folder)))
            ours.chmod(0o755)


def _site(folder: Path) -> Path:
    return next(folder.glob("lib/python*/site-packages"))


def _links(folder: Path, distributions: dict) -> None:
    venv.create(folder, symlinks=True)
    for distribution in distributions.values():
        _link(_site(folder), distribution)


def _link(site: Path, distribution) -> None:
    """Link to the packages of a distribution as a whole, else to its files.

    A folder that is no package may have files of other distributions, too.
    """
    for file in distribution.files:
        top = Path(distribution.locate_file(file.parts[0]))
        if ".." in file.parts or (site / top.name).is_symlink():
            continue
        if (top / "__init__.py").exists() or top.suffix == ".dist-info":
            (site / top.name).symlink_to(top)
        elif distribution.locate_file(file).exists():
            (site / file).parent.mkdir(parents=True, exist_ok=True)
            (site / file).symlink_to(distribution.locate_file(file))


def variables(folder: Path) -> dict[str, str]:
    """Return the variables for a program that uses the environment in `folder`."""
    away = "PYTHONPATH", "PYTHONHOME", "VIRTUAL_ENV"
    kept = {name: value for name, value in os.environ.items() if name not in away}
    others = [p for p in kept["PATH"].split(os.pathsep) if p != str(Path(sys.executable).parent)]
    return kept | {"PATH": os.pathsep.join([str(folder / "bin"), *others]), "BROWSER": "true"}
