"""Constants of the requests from virtual board to simulator, read from the board's source."""

from __future__ import annotations

import runpy
from types import SimpleNamespace

from spots.deploy.staging import BOARDS

protocol = SimpleNamespace(**runpy.run_path(str(BOARDS / "_virtual" / "_protocol.py")))
