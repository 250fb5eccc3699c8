"""Measures strips that were made with less, and writes the errors into docs/build/cheapest.md."""

from __future__ import annotations

import re
from pathlib import Path
from statistics import mean

from evidence import effects

_ROOT = Path(__file__).parents[2]
_PAGE = _ROOT / "docs/build/cheapest.md"
_PEOPLE = 9301, 9302, 9303  # seeds
_FINE = "--by-hand --rezero 3"
# What was left out, and the options with which it is simulated.
_WITHOUT = {
    "nothing": _FINE,
    "kitchen scale and indenter": "--by-hand --rough",
    "scale of 0.01 g: half of the dye": f"{_FINE} --set dye.strength_per_mm=0.008",
    "scale of 0.01 g: one and a half of it": f"{_FINE} --set dye.strength_per_mm=0.024",
    "soft silicone: twice the force (*assumed*)": (
        f"{_FINE} --set contact.threshold_mN=300 --set contact.half_mN=8000"
    ),
}
_ALWAYS = "--sensor first --forces 1 3 --readings 4"


def _measured(options: str) -> str:
    """Return the cells of a row: mean error and worst place of all people, at 1 and 3 N."""
    people = []
    for seed in _PEOPLE:
        words = f"{_ALWAYS} {options} --person {seed}"
        people.append(effects.measured(effects.parser().parse_args(words.split())))
        print(words, *people[-1], sep="\n  ", flush=True)
    cells = []
    for rows in zip(*people):
        error_mm = mean(row.error_mm for row in rows)
        cells.append(f"{error_mm:.2f}/{max(row.worst_error_mm for row in rows):.2f}")
    return " | ".join(cells)


def main() -> None:
    """Measure, write the page, and print its path."""
    rows = [f"| {what} | {_measured(options)} |\n" for what, options in _WITHOUT.items()]
    page = _PAGE.read_text(encoding="utf-8")
    head = "| left out | 1 N | 3 N |\n|---|---|---|\n"
    made = re.sub(rf"{re.escape(head)}(?:\|.*\n)*", head + "".join(rows), page)
    _PAGE.write_text(made, encoding="utf-8")
    print(_PAGE)


if __name__ == "__main__":
    main()
