"""Names of the firmware's files in version 0.1.0, the only release that wrote no manifest.

This data never changes. `staging.names` returns the file names of the present version.
"""

from pathlib import Path

_FOLDER = Path(__file__).parent / "released"

FILES = {path.stem: set(path.read_text("ascii").split()) for path in _FOLDER.glob("*.txt")}
