"""Writes everything that a release consists of into `dist`; two runs give equal files.

    python tools/release.py [FOLDER] [--live FOLDER] [--runtime BOARD=FILE ...]

With a board's runtime, as downloaded, the release has one file for a bare board, too. With
``--live``, it has the live page that `make live` has built in this folder.

The date of all files is that of the last commit, or SOURCE_DATE_EPOCH. Wheel and sdist are built
by hatchling in this environment, without downloads.
"""

import argparse
import hashlib
import os
import subprocess
import sys
import tempfile
import zipfile
from importlib import metadata
from pathlib import Path
from time import gmtime

import spots_device
from spots.common.python import module_command
from spots.deploy.build import build, files_of
from spots.deploy.image import image
from spots.deploy.runtime_files import form_of
from spots.deploy.staging import LIBRARIES, board_names, device_of

ROOT = Path(__file__).resolve().parents[1]
VERSION = spots_device.__version__
SUMS = "SHA256SUMS"
# Name of a bundle as circup reads it: its repository, format and date.
BUNDLE = "spots-circuitpython-bundle-py"


def main() -> None:
    """Write the release into a folder, which must be empty or absent."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT / "dist")
    parser.add_argument("--live", type=Path)
    parser.add_argument("--runtime", action="append", default=[], metavar="BOARD=FILE")
    options = parser.parse_args()
    folder = options.folder
    folder.mkdir(parents=True, exist_ok=True)
    if any(folder.iterdir()):
        sys.exit(f"{folder} is not empty: name another folder, or remove it")
    date_s = date()
    os.environ["SOURCE_DATE_EPOCH"] = str(date_s)
    packages(folder)
    boards(folder, date_s)
    mip(folder, date_s)
    bundle(folder, date_s)
    if options.live:
        pack(folder / f"spots-live-{VERSION}.zip", files_of(options.live) | licences(()), date_s)
    for board, _, runtime in (one.partition("=") for one in options.runtime):
        end = form_of(device_of(board)).suffix
        image(board, runtime, folder / f"spots-{board}-{VERSION}{end}")
    lines = [
        f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n"
        for path in sorted(folder.iterdir())
    ]
    (folder / SUMS).write_text("".join(lines))
    print("".join(lines), end="")


def date() -> int:
    """Return the date of the release, in seconds since 1970."""
    if given := os.environ.get("SOURCE_DATE_EPOCH"):
        return int(given)
    git = ["git", "-C", str(ROOT), "log", "-1", "--format=%ct"]
    return int(subprocess.run(git, capture_output=True, check=True).stdout)


def packages(folder: Path) -> None:
    """Build wheel and sdist."""
    command = module_command("build", "--no-isolation", "--outdir", str(folder), str(ROOT))
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)


def boards(folder: Path, date_s: int) -> None:
    """Pack the files of each real board, with the licences of what other projects wrote."""
    with tempfile.TemporaryDirectory() as root:
        for name in board_names():
            device = device_of(name)
            if device.port:
                continue
            files = files_of(build(name, Path(root)))
            files |= licences(LIBRARIES[device.runtime])
            pack(folder / f"spots-{name}-{VERSION}.zip", files, date_s)


def mip(folder: Path, date_s: int) -> None:
    """Pack the sources for `mip install`, as they lie in the repository."""
    files = files_of(ROOT / "firmware")
    files = {path: data for path, data in files.items() if "__pycache__" not in path}
    pack(folder / f"spots-mip-{VERSION}.zip", files | licences(()), date_s)


def bundle(folder: Path, date_s: int) -> None:
    """Pack the firmware's package for CircuitPython's circup, with the libraries that it needs."""
    day = "{:04}{:02}{:02}".format(*gmtime(date_s)[:3])
    top = f"{BUNDLE}-{day}"
    with tempfile.TemporaryDirectory() as root:
        built = build(next(name for name in board_names() if device_of(name).board_id), Path(root))
        files = {
            f"{top}/lib/{path}": data
            for path, data in files_of(built).items()
            if path.startswith("spots_device/")
        }
    needed = sorted(owner(library) for library in LIBRARIES["circuitpython"])
    files[f"{top}/requirements/spots_device/requirements.txt"] = "\n".join(needed).encode()
    files |= {f"{top}/{path}": data for path, data in licences(()).items()}
    pack(folder / f"{top}.zip", files, date_s)


def licences(libraries: tuple[str, ...]) -> dict[str, bytes]:
    """Return the licence of this project, and of libraries in packages of this Python."""
    found = {"licenses/LICENSE": (ROOT / "LICENSE").read_bytes()}
    for library in libraries:
        package = owner(library)
        for path in metadata.files(package) or ():
            if "LICENSE" in path.name.upper():
                found[f"licenses/{package}-{path.name}"] = path.read_binary()
    return found


def owner(library: str) -> str:
    """Return the name of the package that brings a library to this Python."""
    (found,) = set(metadata.packages_distributions()[library])
    return found


def pack(path: Path, files: dict[str, bytes], date_s: int) -> None:
    """Write a zip file whose bytes depend on nothing but its arguments."""
    with zipfile.ZipFile(path, "x", zipfile.ZIP_DEFLATED, compresslevel=9) as packed:
        for name in sorted(files):
            info = zipfile.ZipInfo(name, gmtime(date_s)[:6])
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            packed.writestr(info, files[name])


if __name__ == "__main__":
    main()
