"""Streams readings to the Lab Streaming Layer (LSL), with the times of the measurements."""

import pylsl

from spots.common.other_clock import OtherClock
from spots.link.board import Board
from spots.link.frames import Reading
from spots.recording.table import VALUES

from .sending import KINDS, kind_of, plans, values

_UNITS = {"um": "um", "mN": "mN"}  # by the last part of a column's name


class Lsl:
    """Streams each kind of frame of each sensor as an LSL stream of doubles.

    Streams are irregular: each sample has the time of the middle of its exposure, which the board's
    clock measured, as a time of LSL's clock. `outlets` has the streams by source id, such as
    ``ID/0/touch``.
    """

    def __init__(self, board: Board):
        self._clock = OtherClock(pylsl.local_clock, board.now_s)
        self.outlets: dict[str, pylsl.StreamOutlet] = {}
        board_id = board.info["id"]
        self.place = f"LSL streams SPOTS {board_id}"
        self._sources = {}
        for sensor, plan in enumerate(plans(board)):
            for kind in KINDS:
                columns = _columns(kind, plan)
                source = f"{board_id}/{sensor}/{kind}"
                self._sources[sensor, kind] = source
                self.outlets[source] = pylsl.StreamOutlet(_info(board, source, columns))

    def put(self, frame: Reading, utc_s: float) -> None:
        """Send a frame; LSL keeps it for receivers that are slow."""
        kind = kind_of(frame)
        found = values(frame)
        numbers = [found[name] for name in found if name not in ("sensor", "sequence", "t_us")]
        if kind == "spectrum":
            numbers = [*numbers[:-1], *frame.counts]  # type: ignore[union-attr]
        time_s = frame.time_s
        stamp_s = self._clock.now_s() if time_s is None else self._clock.at(time_s)
        outlet = self.outlets[self._sources[frame.sensor, kind]]
        outlet.push_sample([float(one) for one in numbers], stamp_s)

    def turn(self) -> None:
        """Do nothing: LSL sends in a thread of its own."""

    def close(self) -> None:
        """End all streams."""
        self.outlets.clear()


def _columns(kind: str, plan: list[str]) -> dict[str, str]:
    # Units of the values of a kind of frame, by name, in the order of `values`.
    units = {name: _UNITS.get(name.rpartition("_")[2], "") for name in VALUES[kind]}
    if units.pop("counts", None) is not None:
        units |= {f"counts_{channel}": "count" for channel in plan}
    return units


def _info(board: Board, source: str, columns: dict[str, str]) -> pylsl.StreamInfo:
    board_id, sensor, kind = source.rsplit("/", 2)
    info = pylsl.StreamInfo(
        f"SPOTS {board_id} {sensor} {kind}",
        "Tactile",
        len(columns),
        pylsl.IRREGULAR_RATE,
        pylsl.cf_double64,
        source,
    )
    about = info.desc()
    about.append_child_value("manufacturer", "SPOTS")
    about.append_child_value("board", board.info["board"])
    about.append_child_value("firmware", board.info["firmware"])
    channels = about.append_child("channels")
    for name, unit in columns.items():
        channel = channels.append_child("channel")
        channel.append_child_value("label", name)
        channel.append_child_value("unit", unit)
        channel.append_child_value("type", kind)
    return info
