"""The files of a board, laid out in a folder as they go onto its file system."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

import tactile

from . import toml
from .errors import SpotsError

# An installed package carries both folders inside itself; a checkout has them at its top.
_PACKAGED = Path(str(resources.files("spots"))) / "_device"
_CHECKOUT = Path(tactile.__file__).resolve().parents[2]
_ROOT = _PACKAGED if _PACKAGED.is_dir() else _CHECKOUT
BOARDS = _ROOT / "boards"

# What a runtime starts with; the last one is what makes a board run the application.
ENTRIES = {"micropython": ("main.py",), "circuitpython": ("boot.py", "code.py")}


@dataclass(frozen=True)
class Device:
    """What board.toml says of a board.

    Attributes
    ----------
    name, title : str
        As the command line and as people call it.
    runtime : str
        ``micropython`` or ``circuitpython``.
    march : str or None
        Architecture of its native code, as ``mpy-cross -march`` names it; None for sources only.
    config : dict
        What becomes board_config.py.
    wiring : dict
        Pins by the names that are printed on the board, for people.
    """

    name: str
    title: str
    runtime: str
    march: str | None
    config: dict
    wiring: dict


def board_names() -> list[str]:
    """Return the boards that there are files for."""
    return sorted(path.parent.name for path in BOARDS.glob("*/board.toml"))


def device_of(board: str) -> Device:
    """Return what is known of a board.

    Raises
    ------
    SpotsError
        If there is no such board.
    """
    if board not in board_names():
        raise SpotsError(f"no board is called {board}; there are {', '.join(board_names())}")
    said = toml.loads((BOARDS / board / "board.toml").read_text(encoding="utf-8"))
    return Device(
        name=board,
        title=said["title"],
        runtime=said["runtime"],
        march=said.get("march"),
        config={"NAME": board} | said["device"],
        wiring=said.get("wiring", {}),
    )


def stage(board: str, folder: Path) -> None:
    """Lay out a board's files in a folder: the firmware and board_config.py, in sources.

    Raises
    ------
    SpotsError
        If there is no such board.
    """
    device = device_of(board)
    (others,) = set(ENTRIES) - {device.runtime}
    shutil.copytree(
        Path(tactile.__file__).parent,
        folder / "tactile",
        ignore=shutil.ignore_patterns("__pycache__", f"*{others}.py"),
        dirs_exist_ok=True,
    )
    for entry in ENTRIES[device.runtime]:
        shutil.copy(_ROOT / "firmware" / entry, folder)
    config = "".join(f"{name} = {value!r}\n" for name, value in device.config.items())
    (folder / "board_config.py").write_text(config, encoding="utf-8")
