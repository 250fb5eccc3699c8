"""Host side of SPOTS, the stretchable parallel optical tactile sensor.

>>> import spots
>>> with spots.open() as board:                       # doctest: +SKIP
...     for touch in board.touches():
...         if touch.trusted:
...             print(touch.position_um, touch.force_mN)
"""

from .board import Board
from .connect import open
from .errors import SpotsError
from .frames import Decoder, Key, LinkStats, Note, Spectrum, Text, Touch
from .recording.arrays import Arrays, RecordingBlocks, read_arrays
from .recording.reader import Recording
from .recording.replay import open_recording
from .uses.encoder import Encoder
from .uses.fivebar import Linkage
from .uses.twin import Twin

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
