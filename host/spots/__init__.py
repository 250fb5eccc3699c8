"""Host side of SPOTS, an open stretchable optical tactile sensor.

>>> import spots
>>> with spots.open() as board:                       # doctest: +SKIP
...     for touch in board.touches():
...         if touch.trusted:
...             print(touch.position_um, touch.force_mN)
"""

from importlib import import_module
from typing import TYPE_CHECKING

from spots_device import __version__ as __version__

from .common.python import script_again, shadow
from .errors import SettingError

if TYPE_CHECKING:
    from .errors import SpotsError
    from .link.board import Board
    from .link.connect import open
    from .link.decoder import Decoder
    from .link.frames import Contact, Key, LinkStats, Note, Spectrum, Text, Touch
    from .recording.arrays import Arrays, RecordingBlocks, read_arrays
    from .recording.dataframe import read_dataframe
    from .recording.recalibrate import recalibrated
    from .recording.recorder import Recorder
    from .recording.recording import Recording
    from .recording.replay import open_recording

# Each name is imported at its first use: `import spots` loads neither NumPy nor pyserial.
_NAMES = {
    "errors": ("SpotsError",),
    "link.board": ("Board",),
    "link.connect": ("open",),
    "link.decoder": ("Decoder",),
    "link.frames": ("Contact", "Key", "LinkStats", "Note", "Spectrum", "Text", "Touch"),
    "recording.arrays": ("Arrays", "RecordingBlocks", "read_arrays"),
    "recording.dataframe": ("read_dataframe",),
    "recording.recalibrate": ("recalibrated",),
    "recording.recorder": ("Recorder",),
    "recording.recording": ("Recording",),
    "recording.replay": ("open_recording",),
}
_MODULES = {name: module for module, names in _NAMES.items() for name in names}
__all__ = [
    "Arrays", "Board", "Contact", "Decoder", "Key", "LinkStats", "Note",
    "Recorder", "Recording", "RecordingBlocks", "Spectrum", "SpotsError", "Text", "Touch", "open",
    "open_recording", "read_arrays", "read_dataframe", "recalibrated",
]  # fmt: skip


def __getattr__(name: str):
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    file = script_again()
    try:
        if not file:
            return getattr(import_module(f".{_MODULES[name]}", __name__), name)
    except Exception as error:
        file = shadow(error)
        if not file:
            raise
    raise SettingError(
        f"{file} has the name of a module of Python, and is imported instead: rename it"
    )


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
