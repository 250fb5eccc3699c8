"""Defaults of the options of a simulated strip, a linkage, and what touches them."""

from __future__ import annotations

import argparse

_DEFAULTS = {
    "sensor": "default",
    "scenario": "demo",
    "seed": 0,
    "path": None,
    "exposure_us": None,
    "picture": None,
}


def given(options: argparse.Namespace | None) -> argparse.Namespace:
    """Return options of the command line, with the defaults of the simulator's options."""
    found = {**vars(options)} if options else {}
    found |= {name: one for name, one in _DEFAULTS.items() if found.get(name) is None}
    return argparse.Namespace(**found)
