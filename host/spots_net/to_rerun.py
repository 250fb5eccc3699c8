"""Sends readings to a Rerun viewer, in batches, or into a file of Rerun."""

import math
from collections import defaultdict
from pathlib import Path

import rerun
import rerun.blueprint as blueprint

from spots.common.atomic import check_writable
from spots.errors import FileError, SettingError
from spots.link.board import Board
from spots.link.frames import Reading, Spectrum, Touch

from .sending import plans

_DEFAULT = "rerun+http://127.0.0.1:9876/proxy"
_BATCH_S = 0.1  # a batch of columns takes as long as a single value


class Rerun:
    """Sends position, force and counts of each sensor as columns of scalars.

    Entities are ``/spots/SENSOR/position_um``, ``…/force_mN`` and ``…/counts/CHANNEL``, on the
    timeline ``time``, in UTC. Unknown values are left out. The address is the URL of a viewer,
    ``rerun+http://HOST:PORT/proxy``, or a new file that ends with ``.rrd``; SettingError if it is
    neither, FileError if the file exists or cannot be written.
    """

    def __init__(self, board: Board, address: str = _DEFAULT):
        self._plans = plans(board)
        self._board, self._due_s = board, 0.0
        self._columns: dict[str, tuple[list, list]] = defaultdict(lambda: ([], []))
        self._stream = rerun.RecordingStream("spots")
        if address.endswith(".rrd"):
            if Path(address).exists():
                raise FileError(
                    f"{address} exists already: give another name, or remove it", address
                )
            check_writable(Path(address))
            self._stream.save(address, default_blueprint=_blueprint(self._plans))
        elif address.startswith("rerun"):
            self._stream.connect_grpc(address, default_blueprint=_blueprint(self._plans))
        else:
            raise SettingError(f"{address!r} is no viewer of Rerun: give {_DEFAULT} or FILE.rrd")
        self.place = f"Rerun, {address}"

    def put(self, frame: Reading, utc_s: float) -> None:
        """Keep the values of a frame for the next batch."""
        if isinstance(frame, Touch) and frame.trusted:
            for name in ("position_um", "force_mN"):
                self._note(f"{frame.sensor}/{name}", utc_s, getattr(frame, name))
        elif isinstance(frame, Spectrum):
            for channel, count in zip(self._plans[frame.sensor], frame.counts):
                self._note(f"{frame.sensor}/counts/{channel}", utc_s, count)

    def turn(self) -> None:
        """Send a batch, if one is due."""
        now_s = self._board.now_s()
        if now_s >= self._due_s:
            self._due_s = now_s + _BATCH_S
            self._flush()

    def close(self) -> None:
        """Send the rest, and end the stream."""
        self._flush()
        self._stream.flush()
        self._stream.disconnect()

    def _note(self, name: str, utc_s: float, value: float) -> None:
        if not math.isnan(value):
            times, values = self._columns[name]
            times.append(utc_s)
            values.append(value)

    def _flush(self) -> None:
        for name, (times, values) in self._columns.items():
            time = rerun.TimeColumn("time", timestamp=times)
            columns = rerun.Scalars.columns(scalars=values)
            rerun.send_columns(f"spots/{name}", [time], columns, recording=self._stream)
        self._columns.clear()


def _blueprint(plans: list[list[str]]) -> blueprint.Blueprint:
    views = [
        blueprint.TimeSeriesView(origin=f"spots/{sensor}/{name}", name=f"{sensor} {name}")
        for sensor in range(len(plans))
        for name in ("position_um", "force_mN", "counts")
    ]
    return blueprint.Blueprint(blueprint.Vertical(*views))
