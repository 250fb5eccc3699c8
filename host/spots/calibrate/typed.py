"""Reads positions and forces as a person types them: ``42mm``, ``4.2 cm``, ``120g``, ``1,18 N``."""

from __future__ import annotations

import re

from ..errors import SpotsError

_STANDARD_GRAVITY = 9.80665  # mN per g
PLACES = {"mm": 1000.0, "cm": 10_000.0}
FORCES = {"g": _STANDARD_GRAVITY, "kg": 1000 * _STANDARD_GRAVITY, "n": 1000.0, "mn": 1.0}
_LEAST_MN, _MOST_MN = 98.0, 20_000.0  # 10 g to 2 kg; a force outside has the wrong unit
_SHARE = 0.5  # if the requested force is small, this share of it is still possible
_BEYOND_UM = 1000.0  # largest distance of a press beyond the end of the strip
_NUMBER = re.compile(r"\s*(\d+(?:[.,]\d+)?)\s*([a-z]+)[\s,;]*", re.IGNORECASE)


def typed(
    text: str, length_um: float, wanted_mN: float = _MOST_MN
) -> tuple[float | None, float | None]:
    """Parse a position and a force that a person typed in any order.

    Parameters
    ----------
    text : str
        Numbers with units, for example ``42mm 120g``.
    length_um : float
        Length of the strip in um.
    wanted_mN : float, optional
        Requested force of the press, in mN. A typed force below 98 mN (10 g) is accepted only if
        it is at least half of the requested force.

    Returns
    -------
    place_um, force_mN : float or None
        Position in um and force in mN; None if not typed.

    Raises
    ------
    SpotsError
        If a unit is missing or unknown, or a value is impossible for a press by hand.
    """
    place_um = force_mN = None
    at = 0
    while at < len(text):
        found = _NUMBER.match(text, at)
        unit = found[2].lower() if found else ""
        if found is None or unit not in PLACES | FORCES:
            raise SpotsError(f"'{text}' is not valid: type numbers with units, such as 42mm 120g")
        value = float(found[1].replace(",", "."))
        at = found.end()
        if unit in PLACES:
            place_um = value * PLACES[unit]
            if place_um > length_um + _BEYOND_UM:
                raise SpotsError(
                    f"{found[0].strip()} is beyond the end of the strip at {length_um / 1000:g} mm"
                )
        else:
            force_mN = value * FORCES[unit]
            least_mN = min(_LEAST_MN, _SHARE * wanted_mN)
            if not least_mN <= force_mN <= _MOST_MN:
                other = "g" if unit in ("n", "mn") else "N"
                hint = f"did you mean {found[1]} {other}?"
                if not least_mN <= value * FORCES[other.lower()] <= _MOST_MN:
                    hint = f"it must be from {grams(least_mN)} to {grams(_MOST_MN)}"
                raise SpotsError(f"{found[0].strip()} is not a possible force of a press: {hint}")
    return place_um, force_mN


def grams(force_mN: float) -> str:
    """Return a force as text in g (for a kitchen scale) and in N: ``120 g (1.18 N)``."""
    return f"{force_mN / _STANDARD_GRAVITY:.0f} g ({force_mN / 1000:.3g} N)"
