"""Reads positions and forces as a person types them: ``42mm``, ``4.2 cm``, ``120g``, ``1,18 N``."""

from __future__ import annotations

import re

from ...errors import SettingError, SpotsError

_STANDARD_GRAVITY = 9.80665  # mN per g
PLACES = {"mm": 1000.0, "cm": 10_000.0}
FORCES = {"g": _STANDARD_GRAVITY, "kg": 1000 * _STANDARD_GRAVITY, "n": 1000.0, "mn": 1.0}
# A measure may continue in the next smaller unit: 4 cm 2 mm, 1 kg 200 g.
_CONTINUES = {"cm": "mm", "kg": "g"}
_LEAST_MN, _MOST_MN = 98.0, 20_000.0  # 10 g to 2 kg; a force outside has the wrong unit
_SHARE = 0.5  # if the requested force is small, this share of it is still possible
_BEYOND_UM = 1000.0  # largest distance of a press beyond the end of the strip
_MEASURE = re.compile(r"\s*(\d+(?:[.,]\d+)?)\s*([a-z]+)[\s,;]*", re.IGNORECASE | re.ASCII)
_NUMBER = re.compile(r"\s*-?\d+(?:[.,]\d+)?\s*", re.ASCII)
_THOUSANDS = re.compile(r"(-?[1-9]\d{0,2})[.,](\d{3})", re.ASCII)


def decimal(text: str) -> float:
    """Return a number that a person typed with a decimal point or a decimal comma.

    SettingError if the text is not a number, or its comma can also separate thousands, as in
    ``1,200``. The text of the error lacks the remedy.
    """
    if not _NUMBER.fullmatch(text):
        raise SettingError(f"'{text}' is not valid")
    value = float(text.replace(",", "."))
    if "," in text and (thousands := _thousands(text)):
        raise SettingError(f"'{text}' can be {thousands} or {value:g}")
    return value


def _thousands(text: str) -> str:
    """Return a number without its separator of thousands; empty if it cannot have one."""
    found = _THOUSANDS.fullmatch(text.strip())
    return found[1] + found[2] if found else ""


def typed(
    text: str, length_um: float, wanted_mN: float = _MOST_MN
) -> tuple[float | None, float | None]:
    """Parse a position in um and a force in mN that a person typed in any order; None if not typed.

    The numbers have units, for example ``42mm 120g``. A measure may have two units, for example
    ``4cm 2mm``. A typed force below 98 mN (10 g) is accepted only if it is at least half of the
    requested force. SettingError if a unit is missing or unknown, two positions or two forces are
    typed, a number is ambiguous, or a value is impossible for a press by hand.
    """
    found: dict[str, tuple[float, str]] = {}
    at = 0
    while at < len(text):
        what, value, words, at = _measure(text, at)
        if what in found:
            raise SettingError(f"'{text}' has two {what}s: type one, in one unit")
        found[what] = value, words
    place_um, words = found.get("position", (None, ""))
    if place_um is not None and place_um > length_um + _BEYOND_UM:
        raise SettingError(f"{words} is beyond the end of the strip at {length_um / 1000:g} mm")
    force_mN, words = found.get("force", (None, ""))
    least_mN = min(_LEAST_MN, _SHARE * wanted_mN)
    if force_mN is not None and not least_mN <= force_mN <= _MOST_MN:
        hint = _hint(words, least_mN)
        raise SettingError(f"{words} is not a possible force of a press: {hint}")
    return place_um, force_mN


def _measure(text: str, at: int) -> tuple[str, float, str, int]:
    """Parse the measure that begins at the index `at` of a text.

    Returns ``position`` or ``force``, its value in um or mN, its text, and the index of its end.
    """
    found = _MEASURE.match(text, at)
    unit = found[2].lower() if found else ""
    if found is None or unit not in PLACES | FORCES:
        raise SettingError(f"'{text}' is not valid: type numbers with units, such as 42mm 120g")
    what, units = ("position", PLACES) if unit in PLACES else ("force", FORCES)
    value, last = _value(found[1]) * units[unit], found
    more = _MEASURE.match(text, found.end())
    if more and found[1].isdigit() and more[2].lower() == _CONTINUES.get(unit):
        part = _value(more[1]) * units[more[2].lower()]
        if part < units[unit]:
            value, last = value + part, more
    return what, value, text[found.start() : last.end(2)].strip(), last.end()


def _value(number: str) -> float:
    try:
        return decimal(number)
    except SpotsError as error:
        raise SettingError(f"{error}: type one of these") from None


def _hint(words: str, least_mN: float) -> str:
    """Return the advice about an impossible force: the likely unit, or the limits of a force."""
    found = _MEASURE.fullmatch(words)
    if found:  # it has one unit
        number, unit = found[1], found[2]
        other = "g" if unit.lower() in ("n", "mn") else "N"
        for likely, its_unit in ((_thousands(number), unit), (number, other)):
            if likely and least_mN <= decimal(likely) * FORCES[its_unit.lower()] <= _MOST_MN:
                return f"did you mean {likely} {its_unit}?"
    return f"it must be from {grams(least_mN)} to {grams(_MOST_MN)}"


def grams(force_mN: float) -> str:
    """Return a force as text in g (for a kitchen scale) and in N: ``120 g (1.18 N)``."""
    return f"{force_mN / _STANDARD_GRAVITY:.0f} g ({force_mN / 1000:.3g} N)"
