"""Reads the documents, and the pages of the built site."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote

from markdown_it import MarkdownIt
from markdown_it.token import Token


class Prose(NamedTuple):
    """Texts of a document.

    Attributes
    ----------
    paragraphs : list of str
    cells : list of str
        Of its tables.
    counts : dict
        Number of tables, code blocks, headings and list items, by their names in HTML.
    """

    paragraphs: list[str]
    cells: list[str]
    counts: dict[str, int]


def prose(text: str) -> Prose:
    """Return the texts of a document, as GitHub reads it."""
    tokens = MarkdownIt("gfm-like", {"linkify": False}).parse(text)
    paragraphs, cells = [], []
    counts = dict.fromkeys(("table", "pre", "li", "h2", "h3"), 0)
    for before, token in zip(tokens, tokens[1:]):
        if token.type == "inline" and before.type == "paragraph_open":
            paragraphs.append(_plain(token))
        elif token.type == "inline" and before.type in ("td_open", "th_open"):
            cells.append(_plain(token))
    for token in tokens:
        name = "pre" if token.type == "fence" else token.tag
        if name in counts and token.nesting >= 0:
            counts[name] += 1
    return Prose(paragraphs, cells, counts)


def _plain(token: Token) -> str:
    """Return a text as a reader sees it: without targets of links and without pictures."""
    return "".join(
        " " if one.type in ("softbreak", "hardbreak") else one.content
        for one in token.children or ()
        if one.type != "image"
    )


def words(text: str) -> int:
    """Return how many words a text has."""
    return len(text.split())


class Html(HTMLParser):
    """What a page of the site refers to, and what it consists of.

    Attributes
    ----------
    links : list of str
        Targets of links and pictures.
    loaded : list of str
        What the browser loads for the page: scripts, style sheets, fonts, pictures, frames.
    ids : set of str
        Names that a link can lead to.
    counts : dict
        Number of tables and so on in the article, as in `Prose`.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.ids: set[str] = set()
        self.counts = dict.fromkeys(("table", "pre", "li", "h2", "h3"), 0)
        self._in_article = False
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list) -> None:
        of = {name: value or "" for name, value in attrs}
        if "id" in of:
            self.ids.add(of["id"])
        if tag == "a" and "href" in of:
            self.links.append(unquote(of["href"]))
        if tag in ("script", "img", "iframe", "source", "video") and "src" in of:
            self.loaded.append(unquote(of["src"]))
        if tag == "link" and of.get("rel") not in ("canonical", "prev", "next"):
            self.loaded.append(unquote(of["href"]))
        self._in_article |= tag == "article"
        if self._in_article and tag in self.counts:
            self.counts[tag] += 1

    def handle_endtag(self, tag: str) -> None:
        if tag == "article":
            self._in_article = False
