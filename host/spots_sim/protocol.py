"""What the simulator and a virtual board have to agree on: the file that the board itself has."""

from __future__ import annotations

import runpy
from types import SimpleNamespace

from spots.deploy.staging import BOARDS

protocol = SimpleNamespace(**runpy.run_path(str(BOARDS / "_virtual" / "_protocol.py")))
