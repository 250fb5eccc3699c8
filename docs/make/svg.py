"""The frame of drawn pictures, which follow the reader's colour scheme, and their texts."""

from __future__ import annotations

from collections.abc import Iterable


def picture(title: str, width: int, height: int, style: str, parts: Iterable[str]) -> str:
    """Return a picture as SVG, with the title for readers who do not see it."""
    head = (
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" role="img">\n'
        f"<title>{title}</title>"
    )
    ground = f'<rect class="ground" width="{width}" height="{height}" rx="8"/>'
    return "\n".join([head, style, ground, *parts, "</svg>"]) + "\n"


def text(x: float, y: float, words: str, kind: str = "", anchor: str = "start") -> str:
    """Return a text at a place; `kind` is its class, `anchor` the part of it that is there."""
    return f'<text class="{kind}" x="{x:g}" y="{y:g}" text-anchor="{anchor}">{words}</text>'
