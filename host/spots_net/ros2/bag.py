"""Converts a recording to an MCAP file of ROS 2, which `ros2 bag play` and others read."""

from functools import cache
from pathlib import Path

from spots.errors import missing
from spots.recording.export import Files, Format, Records
from spots.recording.table import Description

from .messages import UNKNOWN_DARK, Strip, messages, types
from .naming import frame_id, node_name, topic_name
from .types import packed, store

try:
    from mcap.writer import Writer
except ImportError:
    raise missing("exporting to ROS 2 needs", "mcap", "ros2") from None

_CHANNELS = 6
_UNKNOWN = float("nan")
_ERROR_S = float("nan")  # a recording does not say how well the clocks were compared


def write(description: Description, records: Records, out: Path, files: Files) -> None:
    """Write an MCAP file with the profile ``ros2``: messages in CDR, definitions as ``ros2msg``."""
    header = description.header
    name = node_name(header.info["id"])
    writer = Writer(files.new(out))
    writer.start(profile="ros2", library=header.program)

    @cache
    def channel(topic: str, kind: str) -> int:
        text, _ = store().generate_msgdef(kind, ros_version=2)
        schema = writer.register_schema(kind, "ros2msg", text.encode())
        return writer.register_channel(topic, "cdr", schema)

    changes = iter([*description.changes, {"arrived_s": float("inf"), "sensor": 0}])
    change = next(changes)
    settings = header.settings
    for table, row in records:
        time_s, arrived_s, sensor, sequence = row[:4]
        while change["arrived_s"] <= arrived_s:
            settings[change["sensor"]] |= change
            change = next(changes)
        known = (_UNKNOWN if one is None else one for one in row)
        values = dict(zip(table.dtype.names, known))
        values["counts"] = row[-_CHANNELS:]
        now = settings[sensor]
        strip = Strip(
            frame_id(name, sensor), now["channels"], now["exposure_us"], now["dark"] or UNKNOWN_DARK
        )
        begun_s = description.begun_s(arrived_s)
        utc_s = max(0.0, begun_s + time_s)
        for topic, message in messages(table.name, values, utc_s, _ERROR_S, strip):
            kind = types()[topic]
            number = channel(topic_name(name, sensor, topic), kind)
            arrived_ns = round(1e9 * (begun_s + arrived_s))
            writer.add_message(number, arrived_ns, packed(message), round(1e9 * utc_s), sequence)
    writer.finish()


FORMAT = Format("mcap", write)
