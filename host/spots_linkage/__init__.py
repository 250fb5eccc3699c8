"""Strips as joint encoders, and a five-bar linkage with its digital twin (``spots twin``)."""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .digital_twin import Twin
    from .encoder import Encoder
    from .fivebar import Linkage

# Each name is imported at its first use, because these modules need NumPy.
_MODULES = {"Encoder": "encoder", "Linkage": "fivebar", "Twin": "digital_twin"}
__all__ = ["Encoder", "Linkage", "Twin"]


def __getattr__(name: str):
    if name not in _MODULES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f".{_MODULES[name]}", __name__), name)
