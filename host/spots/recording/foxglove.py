"""JSON schemas with which Foxglove and PlotJuggler show an export without any configuration."""

import json

from .table import Table

_TYPES = {"b": "boolean", "f": "number", "i": "integer", "u": "integer", "U": "string"}
_TIME = {"type": "object", "title": "time"}
_TIME["properties"] = {"sec": {"type": "integer"}, "nsec": {"type": "integer"}}
# Foxglove's Log panel shows every topic with this schema.
LOG_SCHEMA = {
    "title": "foxglove.Log",
    "type": "object",
    "properties": {
        "timestamp": _TIME,
        "level": {"type": "integer"},
        "message": {"type": "string"},
        "name": {"type": "string"},
        "file": {"type": "string"},
        "line": {"type": "integer"},
    },
}
_REPLY_LEVEL = 1  # level of replies in Foxglove's Log schema: debug
_LEVELS = {"debug": 1, "info": 2, "warning": 3, "error": 4, "fatal": 5}


def schema(table: Table) -> dict:
    """Return the JSON schema of the messages for one kind of frame.

    No property is required: a message does not contain a value that is unknown.
    """
    dtype = table.dtype
    properties = {name: {"type": _TYPES[dtype[name].kind]} for name in dtype.names}
    return {"title": f"spots.{table.name.capitalize()}", "type": "object", "properties": properties}


def log_message(time_ns: int, content: str, name: str) -> dict:
    """Return a board's log line, or its reply to a command, as a message ``foxglove.Log``.

    `content` is the text of a JSON object, which arrived at `time_ns` since 1970. Replies to
    commands get the level debug.
    """
    text = json.loads(content)
    is_log = isinstance(text.get("log"), str)
    return {
        "timestamp": {"sec": time_ns // 10**9, "nsec": time_ns % 10**9},
        "level": _LEVELS.get(text["log"], 0) if is_log else _REPLY_LEVEL,
        "message": str(text.get("text", content)) if is_log else content,
        "name": name,
        "file": "",
        "line": 0,
    }
