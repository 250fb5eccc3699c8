"""Layout files: validates these TOML files and compiles them to the lines that a board stores.

A file contains layers, and a layer contains keys. A key is either the action of a tap, or a table
of actions: ``tap``, ``double``, ``hold``, ``firm``, ``slide_minus`` (towards the sensor) and
``slide_plus`` (away from the sensor). A layer may also contain an action for a swipe (a quick
movement along the strip) in each direction. docs/type/actions.md describes the actions.
"""

import re
from pathlib import Path

import msgspec

from ..common import kinds, schema, toml
from ..errors import FileError
from .key_layout import KeyLayout
from .layout_compiler import Compiler
from .layout_format import LayoutFile, line_of, line_of_key

# How `schema` names the place of a key, and that of a layer.
_ENTRY = re.compile(r"( in |^)(entry (?P<key>\d+) of keys in )?entry (?P<layer>\d+) of layer")
FOLDER = Path(__file__).parent / "layouts"


def load(name: str | Path) -> KeyLayout:
    """Read a layout file.

    Parameters
    ----------
    name : str or Path
        Path of the file, or name of a layout in the package, such as ``mini``.

    Returns
    -------
    KeyLayout

    Raises
    ------
    SpotsError
        If the file does not exist or is invalid; the message names the place and the remedy.
    """
    return compiled(*toml.find(name, FOLDER, "layout"))


def compiled(path: Path, text: str) -> KeyLayout:
    """Validate and compile the text of a layout file.

    Parameters
    ----------
    path : Path
        Path of the file, for error messages.
    text : str
        Content of the file.

    Returns
    -------
    KeyLayout

    Raises
    ------
    FileError
        If the text is invalid; the message names the place and the remedy.
    """
    content: dict = {}
    try:
        content = toml.loads(text)
        file = schema.convert(content, LayoutFile)
    except msgspec.ValidationError as error:
        kinds.check(path, text, "a layout file")
        line = line_of_key(text, getattr(error, "keys", [])[::-1])
        if isinstance(content.get("layer"), dict):
            line = line_of(text, r"^[ \t]*\[layer\]")
        place = line[2:] or getattr(error, "place", "")
        raise FileError(f"layout {path}{line}: {_placed(error, content)}", path, place) from None
    return Compiler(path, text, file).layout()


def _placed(error: msgspec.ValidationError, content: dict) -> str:
    """Return a message with the place as the messages of the compiler have it."""
    if isinstance(content.get("layer"), dict):
        return "write [[layer]] with two brackets: a layout has a list of layers"
    found = _ENTRY.search(str(error))
    if not found:
        return str(error)
    key, number = found["key"], int(found["layer"])
    layer = content["layer"][number - 1]
    name = layer.get("name") if isinstance(layer, dict) else None
    place = f"in layer {number if name is None else repr(name)}" + (f", key {key}" if key else "")
    words = f"{str(error)[: found.start()]}{str(error)[found.end() :]}"
    return f"{place}: {words.strip()}"
