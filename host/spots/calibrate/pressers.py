"""For what the tables of a calibration are: a finger or an indenter.

Skin reflects light back into the strip, and an indenter does not. So a strip that an indenter has
calibrated reads a finger at a wrong position, by more than a millimetre. A re-zero stores its
presser. The board has the tables for one presser; the file can give those for each.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from msgspec.structs import replace

from ..errors import CalibrationError
from .calibration_file import FINGER, INDENTER, CalibrationFile, Presser, Rezero
from .fit.shift import drift_at, shifted
from .thermal import with_lines as with_thermal

_NO_FINGER = "no_finger"  # after an indenter, for a strip that a finger will press
ONE = {"finger": "a finger", "indenter": "an indenter", None: "another presser"}


def marked(lines: Iterable[str], presser: Presser | None, chosen: bool = True) -> list[str]:
    """Return lines of a calibration with the line ``presser``; without it if it is unknown.

    Unless `chosen`, a calibration by an indenter says that the finger is missing.
    """
    word = presser if chosen or presser != INDENTER else _NO_FINGER
    kept = [line for line in lines if not line.startswith("presser ")]
    return [*kept, f"presser {word}"] if word else kept


def _word(made: CalibrationFile) -> str | None:
    return next((line.split()[1] for line in made.lines if line.startswith("presser ")), None)


def used(made: CalibrationFile) -> Presser | None:
    """Return for what the lines of a calibration are; None if it is unknown."""
    return INDENTER if lacks_finger(made) else _word(made)  # type: ignore[return-value]


def lacks_finger(made: CalibrationFile) -> bool:
    """Return whether an indenter has calibrated a strip that a finger will press."""
    return _word(made) == _NO_FINGER


def awaited(made: CalibrationFile) -> Presser | None:
    """Return with what a re-zero presses if nobody chooses: what uses the strip."""
    return FINGER if lacks_finger(made) else used(made)


def with_presser(made: CalibrationFile, presser: Presser | None) -> list[Rezero]:
    """Return the re-zeros with one presser, oldest first."""
    return [one for one in made.rezeros if one.presser == presser]


def is_known(made: CalibrationFile, presser: Presser | None) -> bool:
    """Return whether a calibration has what `used_by` needs."""
    return presser == made.presser or bool(with_presser(made, presser))


def used_by(made: CalibrationFile, presser: Presser | None) -> CalibrationFile:
    """Return a calibration with the tables for one presser: those after its last re-zero with it.

    CalibrationError if the calibration has neither presses nor a re-zero with it.
    """
    if not is_known(made, presser):
        raise CalibrationError(
            f"this calibration has no presses by {ONE[presser]}: run "
            f"'spots rezero --with {presser or FINGER}'"
        )
    original = made.original or made.lines
    lines, rezeros = list(original), with_presser(made, presser)
    if rezeros:
        lines = shifted(original, rezeros[-1].place_um, rezeros[-1].shifts)
        lines = with_thermal(lines, rezeros)
    # The light of the untouched strip is not a matter of the presser: the latest is right.
    lines = [line for line in lines if not line.startswith("rest ")]
    lines += [line for line in made.lines if line.startswith("rest ")]
    return replace(made, lines=tuple(marked(lines, presser)))


def used_as(new: CalibrationFile, before: CalibrationFile) -> CalibrationFile:
    """Return a new fit of a calibration with the tables for what `before` was used by."""
    presser = used(before)
    is_chosen = not lacks_finger(before) and is_known(new, presser)
    return used_by(new, presser) if is_chosen else new


def reference(made: CalibrationFile, presser: Presser | None, place_um: Sequence[float]):
    """Return the shifts at n places that are no drift but the presser's, shape (n, 6).

    They are those of the first re-zero with this presser, or 0 if it pressed the calibration. None
    before its first re-zero.
    """
    if presser == made.presser:
        return np.zeros((len(place_um), 6))
    first = next(iter(with_presser(made, presser)), None)
    if first is None:
        return None
    return np.array([drift_at(x_um, first.place_um, first.shifts) for x_um in place_um])
