"""File names of version 0.1.0, the only one that wrote no manifest.

Data, and never changed: the files of this version are those of `staging.names`.
"""

from pathlib import Path

_FOLDER = Path(__file__).parent / "released"

FILES = {path.stem: set(path.read_text("ascii").split()) for path in _FOLDER.glob("*.txt")}
