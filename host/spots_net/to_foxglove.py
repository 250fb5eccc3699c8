"""Serves readings to Foxglove by a WebSocket, with the schemas of the MCAP export."""

import json

import foxglove
import msgspec

from spots.errors import RequirementError
from spots.link.board import Board
from spots.link.frames import Reading
from spots.recording.foxglove import schema
from spots.recording.table import tables

from .outlet import KINDS, host_and_port, kind_of, plans, row

_DEFAULT = "127.0.0.1", 8765
_encode = msgspec.json.Encoder().encode


class Foxglove:
    """Serves each kind of frame of each sensor as a topic, ``/spots/SENSOR/KIND``.

    It listens on the address ``HOST:PORT``; RequirementError if this is impossible. Clients cannot
    send anything: the server announces no service, parameter or asset.
    """

    def __init__(self, board: Board, address: str = ""):
        host, port = host_and_port(address, _DEFAULT, "Foxglove")
        self._board, self._began_s = board, board.now_s()
        self._context = foxglove.Context()
        self._plans = plans(board)
        self._channels = {}
        for sensor, plan in enumerate(self._plans):
            for table in (one for one in tables(plan) if one.name in KINDS):
                topic = f"/spots/{sensor}/{table.name}"
                content = json.dumps(schema(table)).encode()
                named = foxglove.Schema(
                    name=f"spots.{table.name.capitalize()}", encoding="jsonschema", data=content
                )
                self._channels[sensor, table.name] = foxglove.Channel(
                    topic, schema=named, message_encoding="json", context=self._context
                )
        try:
            self._server = foxglove.start_server(
                name=f"SPOTS {board.info['id']}", host=host, port=port, context=self._context
            )
        except (OSError, RuntimeError) as error:
            raise RequirementError(
                f"cannot listen on {host}:{port} ({error}): give another address with "
                "--to foxglove=HOST:PORT"
            ) from None
        self.place = f"Foxglove at ws://{host}:{self._server.port}"

    def put(self, frame: Reading, utc_s: float) -> None:
        """Send a frame; for a client that is too slow, the oldest messages are dropped."""
        arrived_s = self._board.now_s() - self._began_s
        time_s = arrived_s if frame.time_s is None else frame.time_s - self._began_s
        message = row(frame, time_s, arrived_s, self._plans[frame.sensor])
        channel = self._channels[frame.sensor, kind_of(frame)]
        channel.log(_encode(message), log_time=round(1e9 * utc_s))

    def turn(self) -> None:
        """Do nothing: the server has a thread of its own."""

    def close(self) -> None:
        """End the server."""
        self._server.stop()
