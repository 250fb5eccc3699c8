"""The protocol between simulator and virtual board, read from the board's own file."""

from __future__ import annotations

import runpy
from types import SimpleNamespace

from spots.deploy.staging import BOARDS

protocol = SimpleNamespace(**runpy.run_path(str(BOARDS / "_virtual" / "_protocol.py")))
