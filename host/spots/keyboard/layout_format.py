"""Tables and words of a layout file, and in which line of its text something is."""

import re
from typing import Annotated, Literal, Optional, Union

import msgspec

from spots_device.keys import layout as lines_of
from spots_device.keys.layout import LIMITS

from ..common import toml
from . import hosts
from .key_layout import FLAVORS

STICKY = "sticky"
NAMED = ("tap_dance", "mod_morph")  # tables of the file, which an action names
# Actions without a name behind them.
TEXT, MACRO = "text", "macro"
CAPS_WORD = "caps_word"
WORDS = {"key_repeat": lines_of.KEY_REPEAT, CAPS_WORD: lines_of.CAPS_WORD}
# Limits of a hold, which a key may have itself.
HOLD_TERMS = ("tapping_term_ms", "quick_tap_ms", "require_prior_idle_ms")
RELEASE_AFTER_MS = (0, 60_000, 0)  # minimum, maximum, default


_Positive = Annotated[float, msgspec.Meta(gt=0, le=1000)]


def _ms(name: str):
    low, high, _ = LIMITS[name]
    return Annotated[int, msgspec.Meta(ge=low, le=high)]


class KeyEntry(toml.Strict, omit_defaults=True):
    """A key that is a table of actions."""

    tap: str = ""
    double: str = ""
    hold: str = ""
    firm: str = ""
    slide_minus: str = ""
    slide_plus: str = ""
    text: str = ""
    macro: list[str] = []
    width: _Positive = 1.0
    label: Optional[str] = None
    flavor: Optional[Literal[FLAVORS]] = None
    tapping_term_ms: Optional[_ms("tapping_term_ms")] = None
    quick_tap_ms: Optional[_ms("quick_tap_ms")] = None
    require_prior_idle_ms: Optional[_ms("require_prior_idle_ms")] = None
    retro_tap: bool = False


class LayerEntry(toml.Strict, omit_defaults=True):
    """A layer: its keys from the sensor on."""

    name: str
    keys: Annotated[list[Union[str, KeyEntry]], msgspec.Meta(min_length=1)]
    gap_percent: Annotated[float, msgspec.Meta(ge=0, le=80)] = 0.0
    swipe_minus: str = ""
    swipe_plus: str = ""


class _TapDance(toml.Strict, omit_defaults=True):
    actions: Annotated[list[str], msgspec.Meta(min_length=2, max_length=8)]
    holds: Annotated[list[str], msgspec.Meta(max_length=8)] = []
    tapping_term_ms: Optional[_ms("tapping_term_ms")] = None


class _ModMorph(toml.Strict, omit_defaults=True):
    action: str
    morphed: str
    mods: Annotated[list[str], msgspec.Meta(min_length=1)]
    keep_mods: list[str] = []


_Tuning = msgspec.defstruct(
    "_Tuning",
    [
        (name, Annotated[int, msgspec.Meta(ge=low, le=high)], default)
        for name, (low, high, default) in {**LIMITS, "release_after_ms": RELEASE_AFTER_MS}.items()
        if name != "flavor"
    ]
    + [("flavor", Literal[FLAVORS], FLAVORS[LIMITS["flavor"][2]])],
    bases=(toml.Strict,),
    omit_defaults=True,
)


class LayoutFile(toml.Strict, omit_defaults=True):
    """All tables of a layout file."""

    name: str
    layer: Annotated[list[LayerEntry], msgspec.Meta(min_length=1, max_length=lines_of.LAYERS_MAX)]
    host: str = ""
    os: Optional[Literal[hosts.SYSTEMS]] = None
    tuning: _Tuning = _Tuning()
    tap_dance: dict[str, _TapDance] = {}
    mod_morph: dict[str, _ModMorph] = {}
    macro: dict[str, Annotated[list[str], msgspec.Meta(min_length=1)]] = {}


def line_of(text: str, pattern: str) -> str:
    """Return ``, line 7`` if line 7 is the first that matches a pattern; empty without a match."""
    for number, line in enumerate(text.splitlines(), 1):
        if re.search(pattern, line):
            return f", line {number}"
    return ""


def line_of_key(text: str, keys: list[str]) -> str:
    """Return ``, line 7`` if line 7 sets one of the TOML keys `keys`; empty without such a line.

    If the text sets several of the keys, the first one in `keys` is used.
    """
    found = (line_of(text, rf"(?<!\w){re.escape(key)}\s*=") for key in keys)
    return next(filter(None, found), "")
