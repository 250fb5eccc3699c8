"""Writes what to buy, and its cost, into docs/build and README.md; see spots_make/parts.py."""

from __future__ import annotations

import re
from pathlib import Path

from spots_make import parts
from spots_make.shape import StripShape

_ROOT = Path(__file__).parents[2]
_SHAPE = StripShape(85)  # the strip of the paper
_TABLE = r"(?:\|.*\n)+"


def documents(root: Path = _ROOT) -> dict[Path, str]:
    """Return the text of each document with parts or costs, by its path."""
    page, index, readme = (
        root / "docs/build/parts.md",
        root / "docs/build/index.md",
        root / "README.md",
    )
    text = page.read_text(encoding="utf-8")
    for table in ("electronics", "strip", "tools"):
        made = rf"\g<1>{parts.page_table(table, _SHAPE)}\n"
        text = re.sub(rf"(## {table.title()}\n\n(?:[^#|]*\n)?){_TABLE}", made, text)
    (low, high), (tools_low, tools_high) = _sums("electronics", "strip"), _sums("tools")
    every = low + tools_low, high + tools_high
    total = f"{every[0]} to {every[1]} euros"
    rows = {
        "board, breakout, LED, cables, breadboard": _range("electronics"),
        "materials of the strip, filament, sandpaper, cups; enough for several strips": _range(
            "strip"
        ),
        "**materials, total**": f"{low} to {high} euros",
        "vacuum chamber and pump, scale of 0.01 g, gloves, goggles, iron, if you have none": _range(
            "tools"
        ),
        "**with these tools, total**": total,
    }
    costs = "".join(f"| {what} | {euros} |\n" for what, euros in rows.items())
    head = "| for one strip of 85 mm | estimate |\n|---|---|\n"
    cost = re.sub(
        rf"{re.escape(head)}(?:\|.*euros \|\n)+", head + costs, index.read_text(encoding="utf-8")
    )
    cost = re.sub(
        r"One strip costs .*? in materials, and .*? with",
        f"One strip costs {low} to {high} euros in materials, and {total} with",
        cost,
    )
    cheapest = page.with_name("cheapest.md")
    return {
        page: text,
        index: cost,
        cheapest: _without(cheapest.read_text(encoding="utf-8"), every),
        readme: re.sub(
            r"materials \d+ to \d+ euros, with tools \d+ to \d+ euros",
            f"materials {low} to {high} euros, with tools {total}",
            readme.read_text(encoding="utf-8"),
        ),
        page.with_suffix(".csv"): parts.csv_text(_SHAPE, 1),
    }


def _without(page: str, euros: tuple[int, int]) -> str:
    left = [one for one in parts.parts() if one.without]
    head = "| leave out | euros | do this, or know that |\n|---|---|---|\n"
    rows = "".join(f"| {one.name} | {parts.euros(one)} | {one.without} |\n" for one in left)
    low, high = (
        5 * round((total - sum(saved)) / 5)
        for total, saved in zip(euros, zip(*(one.cost(1) for one in left)))
    )
    page = re.sub(rf"{re.escape(head)}(?:\|.*\n)*", head + rows, page)
    return re.sub(
        r"costs \d+ to \d+ euros, and \d+ to \d+ euros",
        f"costs {low} to {high} euros, and {euros[0]} to {euros[1]} euros",
        page,
    )


def _sums(*tables: str) -> tuple[int, int]:
    low, high = zip(*map(parts.cost, tables))
    return sum(low), sum(high)


def _range(table: str) -> str:
    return "{} to {} euros".format(*parts.cost(table))


def main() -> None:
    """Write the documents, and print their paths."""
    for path, text in documents().items():
        path.write_text(text, encoding="utf-8")
        print(path)


if __name__ == "__main__":
    main()
