"""Host side of SPOTS, the stretchable parallel optical tactile sensor.

>>> import spots
>>> with spots.open() as board:                       # doctest: +SKIP
...     for touch in board.touches():
...         if touch.trusted:
...             print(touch.position_um, touch.force_mN)
"""

from importlib import import_module
from typing import TYPE_CHECKING

from spots_device import __version__ as __version__

if TYPE_CHECKING:
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

# Each name is loaded where it is first used: `import spots` takes neither NumPy nor a serial port.
_MODULES = {
    "Arrays": "recording.arrays",
    "Board": "link.board",
    "Decoder": "link.frames",
    "Encoder": "linkage.encoder",
    "Key": "link.frames",
    "LinkStats": "link.frames",
    "Linkage": "linkage.fivebar",
    "Note": "link.frames",
    "Recording": "recording.recording",
    "Spectrum": "link.frames",
    "RecordingBlocks": "recording.arrays",
    "SpotsError": "errors",
    "Text": "link.frames",
    "Touch": "link.frames",
    "Twin": "linkage.digital_twin",
    "open": "link.connect",
    "open_recording": "recording.replay",
    "read_arrays": "recording.arrays",
}
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


def __getattr__(name: str):
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_MODULES[name]}", __name__), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
