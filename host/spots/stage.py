"""The files of a board, laid out in a folder as they go onto its file system."""

from __future__ import annotations

import shutil
import sys
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


def board_names() -> list[str]:
    """Return the boards that there are files for."""
    return sorted(path.parent.name for path in BOARDS.glob("*/board.toml"))


def stage(board: str, folder: Path) -> None:
    """Lay out a board's files in a folder: the firmware, its own files, and board_config.py.

    Raises
    ------
    SpotsError
        If there is no such board.
    """
    if board not in board_names():
        raise SpotsError(f"no board is called {board}; there are {', '.join(board_names())}")
    source = BOARDS / board
    shutil.copytree(
        Path(tactile.__file__).parent,
        folder / "tactile",
        ignore=shutil.ignore_patterns("__pycache__"),
        dirs_exist_ok=True,
    )
    for file in source.glob("*.py"):
        shutil.copy(file, folder)
    shutil.copy(_ROOT / "firmware" / "main.py", folder)
    device = toml.loads((source / "board.toml").read_text(encoding="utf-8"))["device"]
    config = "".join(f"{name} = {value!r}\n" for name, value in device.items())
    (folder / "board_config.py").write_text(config, encoding="utf-8")


if __name__ == "__main__":
    try:
        stage(sys.argv[1], Path(sys.argv[2]))
    except SpotsError as error:
        sys.exit(f"spots: {error}")
