"""Host side of SPOTS, the stretchable parallel optical tactile sensor.

>>> import spots
>>> with spots.open() as board:                       # doctest: +SKIP
...     for touch in board.touches():
...         if touch.trusted:
...             print(touch.position_um, touch.force_mN)
"""

from .errors import SpotsError
from .link.board import Board
from .link.connect import open
from .link.frames import Decoder, Key, LinkStats, Note, Spectrum, Text, Touch
from .linkage.digital_twin import Twin
from .linkage.encoder import Encoder
from .linkage.fivebar import Linkage
from .recording.arrays import Arrays, RecordingBlocks, read_arrays
from .recording.recording import Recording
from .recording.replay import open_recording

__version__ = "0.1.0"
__all__ = [
    "Arrays",
    "Board",
    "Decoder",
    "Encoder",
    "Key",
    "LinkStats",
    "Linkage",
    "Note",
    "Recording",
    "RecordingBlocks",
    "Spectrum",
    "SpotsError",
    "Text",
    "Touch",
    "Twin",
    "open",
    "open_recording",
    "read_arrays",
]
