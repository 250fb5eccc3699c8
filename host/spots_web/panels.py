"""Panels of other packages in the web UI: entry points of the group ``spots.panels``.

The entry point has the name of the panel: small letters, digits and ``-``. It names a class, which
needs no import of this package. The class must have

``title``
    Heading of the panel.
``static``
    Path of a folder with ``panel.js`` and, if needed, ``panel.css`` and further files. Browsers get
    them from ``/panels/NAME/``, with the policy of the web UI: nothing from other machines, and
    no scripts or styles inside of HTML. ``panel.js`` exports a function ``panel(root, request)``.
    It fills the element `root`, and returns a function ``draw(value, state, now_s)``, which draws
    the newest value; `state` has all parts, see docs/extend/web-messages.md. ``request(body)``
    sends a request to ``on_request``, and resolves to its answer, or to ``{refused: why}``. The
    files ``../../static/dom.js`` and ``../../static/controls.js`` help to make elements.

and is called as ``(show, options)``, where ``show(value)`` replaces the value that browsers draw
(of JSON types; None hides the panel), and `options` are those of ``spots serve``. It may raise a
SpotsError. The class may have

``add_options(parser)``
    Adds options to ``spots serve``; called without an object.
``on_touch(touch)``
    Called with each reading, in the thread that reads the board.
``on_request(board, request)``
    Handles a request of a browser with the token, in the same thread: takes what the browser sent,
    of JSON types, and returns an answer (a dict) or None. Raises a SpotsError to refuse it.
``boards_option``
    An option of ``add_options`` with which the web UI reads other boards than the one that
    ``--port`` names, such as ``--linkage FILE.toml``.
``boards()``
    Returns these boards, each a `panel_feed.Source` or an equal tuple; the strip of the first one
    is shown. It is called if the option is given.
"""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

from spots.cli.parser import Parser
from spots.common.plugins import entry_points
from spots.errors import SpotsError, printable

GROUP = "spots.panels"
SCRIPT, STYLE = "panel.js", "panel.css"
_NAME = re.compile("[a-z][a-z0-9-]*")


class Panel:
    """A panel of another package, or the reason why it cannot be shown.

    Its part of the state and its element are ``panel-NAME``. If it cannot be shown, `kind` (its
    class) is None, and `fault` the reason in one sentence; otherwise `fault` is empty. `files` has
    the path of each file that browsers get, by its name.
    """

    def __init__(self, entry: EntryPoint):
        self.name, self.kind, self.fault = entry.name, None, ""
        self.files: Mapping[str, Path] = {}
        self._package = f" of {entry.dist.name}" if entry.dist else ""
        try:
            if not _NAME.fullmatch(entry.name):
                raise ValueError("its name has other characters than a-z, 0-9 and -")
            kind = entry.load()
            folder = Path(kind.static)
            if not (folder / SCRIPT).is_file():
                raise FileNotFoundError(f"there is no file {SCRIPT} in {folder}")
            self._title = str(kind.title)
            self.files = {
                p.relative_to(folder).as_posix(): p for p in folder.rglob("*") if p.is_file()
            }
            self.kind = kind
        except Exception as error:
            self.failed(error)

    def failed(self, error: Exception) -> None:
        """Record why the panel cannot be shown; the web UI works without it."""
        why = printable(f"{type(error).__name__}: {error}".partition("\n")[0])
        self.kind = None
        self.fault = (
            f"the panel '{printable(self.name)}'{self._package} cannot be loaded ({why}): "
            "update or remove this package"
        )

    def add_options(self, parser: Parser) -> None:
        """Add the options of this panel to ``spots serve``."""
        try:
            getattr(self.kind, "add_options", lambda parser: None)(parser)
        except Exception as error:
            self.failed(error)

    def open(self, show: Callable[[Any], None], options: Namespace) -> Any:
        """Return an object of the panel's class; None if the panel cannot be shown.

        SpotsError if an option of the panel is wrong.
        """
        try:
            return self.kind and self.kind(show, options)
        except SpotsError:
            raise
        except Exception as error:
            self.failed(error)

    @property
    def boards_option(self) -> str:
        """The option with which this panel reads other boards; empty if there is none."""
        return getattr(self.kind, "boards_option", "")

    def reads(self, options: Namespace) -> bool:
        """Return whether the options of ``spots serve`` let this panel read other boards."""
        name = self.boards_option.partition(" ")[0].lstrip("-").replace("-", "_")
        return bool(name) and getattr(options, name) is not None

    def message(self) -> dict[str, Any]:
        """Return what a browser needs to load the panel, of JSON types."""
        if self.kind is None:
            return {"name": self.name, "title": self.name, "fault": self.fault}
        return {"name": self.name, "title": self._title, "style": STYLE in self.files}


@cache
def installed() -> Sequence[Panel]:
    """Return the panels of all installed packages, by name."""
    entries = {entry.name: entry for entry in entry_points(group=GROUP)}
    return [Panel(entry) for _, entry in sorted(entries.items())]
