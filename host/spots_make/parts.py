"""The bill of materials: what to buy for strips, how much of it, and what it costs.

The parts are in ``parts.toml``; masses are what the recipe consumes.
"""

from __future__ import annotations

import csv
import io
import re
from pathlib import Path

import msgspec

from spots.common import atomic, toml

from .recipe import consumption_g
from .shape import StripShape

KIND = atomic.begins("a bill of materials", b"part,")
_COLUMNS = "part", "maker", "number", "count", "euros_low", "euros_high", "page"
_DASH = "\u2013"


class Part(msgspec.Struct, forbid_unknown_fields=True):
    """A part or tool, see ``parts.toml``."""

    table: str
    name: str
    maker: str = ""
    number: str = ""
    page: str = ""
    text: str = ""
    use: str = ""
    each: str = "all"
    amount: str = ""
    of: list[str] = []
    euros: tuple[float, float] | None = None
    other: str = ""
    without: str = ""
    counted: bool = True

    def count(self, shape: StripShape, strips: int) -> str:
        """Return how much of the part is needed for a number of strips."""
        if self.of:
            used = consumption_g(shape, strips)
            letters = [name.removeprefix(self.number).strip() for name in self.of]
            named = [f"{letter} " if len(self.of) > 1 else "" for letter in letters]
            return ", ".join(f"{n}{used[name]:.3g} g" for n, name in zip(named, self.of))
        return self.amount or str(strips if self.each == "strip" else 1)

    def cost(self, strips: int) -> tuple[float, float]:
        """Return the lowest and the highest estimated price in euros."""
        low, high = self.euros if self.counted and self.euros else (0.0, 0.0)
        times = strips if self.each == "strip" else 1
        return low * times, high * times


def parts(table: str = "") -> list[Part]:
    """Return all parts, or those of a table of the page."""
    path = Path(__file__).parent / "parts.toml"
    found = msgspec.convert(toml.loads(path.read_text(encoding="utf-8"))["part"], list[Part])
    return [one for one in found if table in ("", one.table)]


def cost(table: str, strips: int = 1) -> tuple[int, int]:
    """Return the lowest and the highest estimated cost of a table in euros, rounded to 5."""
    low, high = zip(*(one.cost(strips) for one in parts(table)))
    return 5 * round(sum(low) / 5), 5 * round(sum(high) / 5)


def csv_text(shape: StripShape, strips: int) -> str:
    """Return the bill of materials as CSV; prices are estimates for the whole count."""
    file = io.StringIO()
    table = csv.writer(file, lineterminator="\n")
    table.writerow(_COLUMNS)
    for one in parts():
        low, high = one.cost(strips)
        prices = (f"{low:g}", f"{high:g}") if high else ("", "")
        count = one.count(shape, strips)
        table.writerow((_plain(one.name), one.maker, one.number, count, *prices, one.page))
    return file.getvalue()


def _plain(text: str) -> str:
    """Return a text of a page without its Markdown."""
    return re.sub(r"[`*]|\[([^]]*)\]\([^)]*\)", r"\1", text)


def page_table(table: str, shape: StripShape) -> str:
    """Return a table of docs/build/parts.md."""
    if table == "tools":
        rows = [("tool", "for", "euros", "alternative")]
        rows += [(p.name, p.use, euros(p), p.other or _DASH) for p in parts(table)]
    else:
        rows = [("part", "maker, number", "amount", "euros", "alternative")]
        rows += [
            (p.name, _named(p), p.count(shape, 1), euros(p), p.other or _DASH) for p in parts(table)
        ]
    head, *body = (f"| {' | '.join(row)} |" for row in rows)
    return "\n".join([head, "|---" * len(rows[0]) + "|", *body])


def _named(part: Part) -> str:
    made = ", ".join(filter(None, (part.maker, part.number)))
    if part.maker == "Adafruit":
        made = f"{part.maker} {part.number}"
    return part.text or made or _DASH


def euros(part: Part) -> str:
    """Return the lowest and the highest estimated price of one, in words."""
    if not part.euros:
        return _DASH
    low, high = part.euros
    return f"{low:g} to {high:g}"
