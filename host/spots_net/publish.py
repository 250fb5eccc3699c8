"""Publishes a board over Zenoh as a node of ROS 2 does with rmw_zenoh; ROS is not needed here."""

import re
import time
from contextlib import ExitStack

from spots.errors import BoardError, PortError
from spots.link.board import Board
from spots.link.decoder import whole
from spots.link.frames import Reading
from spots.link.lines import of_sensor
from spots.terminal.view import Pace

from .answers import Answers
from .optional import zenoh
from .ros2.messages import (
    DIAGNOSTICS,
    TOPICS,
    UNKNOWN_DARK,
    Strip,
    diagnostics,
    frame_message,
    messages,
    types,
)
from .ros2.naming import (
    DEFAULT_QOS,
    Qos,
    checked_name,
    frame_id,
    frames_topic,
    node_name,
    ros_domain,
    short_name,
    topic_name,
)
from .ros2.types import FRAME, packed, topic
from .ros_node import RosNode
from .sending import kind_of, values
from .zenoh_session import open_session

_HEALTH_PER_S = 1  # messages with link statistics per second


class Publisher:
    """A node ``spots_ID`` with the topics ``/spots_ID/stripN/KIND``, and services for queries.

    A service returns the reply to one of the commands ``hello``, ``get`` and ``sync``. What the
    board sends is also published as bytes, which the port ``zenoh:ID`` reads. Messages to which
    nobody subscribes are not made. No other code of the program may read the board's frames.

    `address` is the ROS domain; without it, ROS_DOMAIN_ID, or 0. `name` is used in place of
    ``spots_ID``. Without `session`, a session is opened. SpotsError if the board is read-only, has
    no valid id, or is already published, or the domain or the name is invalid.
    """

    def __init__(
        self,
        board: Board,
        address: str = "",
        name: str = "",
        qos: Qos = DEFAULT_QOS,
        session: zenoh.Session | None = None,
    ):
        domain = ros_domain(address)
        if board.read_only:
            raise PortError(
                f"cannot publish {board.port}, which is a recording or a remote board: give the "
                "port of a connected board"
            )
        self._board = board
        board_id = board.info["id"]
        if not re.fullmatch("[0-9A-Za-z_]+", board_id or ""):
            raise BoardError(
                f"cannot publish the board on {board.port}: it has no valid id; flash its firmware "
                "again",
                "no_id",
            )
        self.name = checked_name(name or node_name(board_id))
        frames = topic(frames_topic(self.name), FRAME)
        self._strips = [_strip(board, sensor, self.name) for sensor in board.sensors]
        with ExitStack() as own:  # ends the session if the board cannot be published
            if session is None:
                session = own.enter_context(open_session())
            there = session.liveliness().get(frames.tokens(domain, self.name))
            if any(reply.ok for reply in there):
                raise PortError(
                    f"the board {short_name(self.name)} is already published: stop the other "
                    "publisher"
                )
            node = RosNode(session, domain, self.name)
            own.callback(node.close)
            self._topics = {
                (sensor, kind): node.publisher(
                    topic(topic_name(self.name, sensor, kind), message_type), qos
                )
                for sensor in board.sensors
                for kind, message_type in types().items()
            }
            self._health = node.publisher(topic("/diagnostics", DIAGNOSTICS), qos)
            self._health_pace = Pace(_HEALTH_PER_S)
            self._answers = Answers(board, self.name, node)
            self._copy = b""  # bytes that have arrived and are not published yet
            board.channel.taps.append(self._keep)
            # These frames announce the board. They come last, because readers then subscribe to
            # them and call the services.
            self._frames = node.publisher(frames, qos)
            self._own = own.pop_all()
        self.place = f"{short_name(self.name)}, node {self.name} of ROS domain {domain}"

    def put(self, frame: Reading, utc_s: float) -> None:
        """Publish the bytes that have arrived, and the messages for a frame."""
        self._send()
        kind, sensor = kind_of(frame), frame.sensor
        if not any(self._topics[sensor, name].wanted for name in TOPICS[kind]):
            return
        error_s = self._board.time_error_s
        for name, message in messages(kind, values(frame), utc_s, error_s, self._strips[sensor]):
            sender = self._topics[sensor, name]
            if sender.wanted:
                sender.put(packed(message), round(1e9 * utc_s))

    def turn(self) -> None:
        """Publish the bytes that are left, answer queries, and publish the link's counters."""
        self._send()
        self._answers.give()
        if self._health_pace.due(self._board.now_s()) and self._health.wanted:
            self._health.put(packed(diagnostics(self._board, self.name, time.time())))

    def close(self) -> None:
        """End the node."""
        self._own.close()

    def _keep(self, data: bytes, now_s: float) -> None:
        self._copy += data

    def _send(self) -> None:
        # The `Board` has already decoded these bytes, so it has counted a restart before them.
        size = whole(self._copy)
        data, self._copy = self._copy[:size], self._copy[size:]
        if data and self._frames.wanted:
            self._frames.put(packed(frame_message(data, self._board.stats.restarts)))


def _strip(board: Board, sensor: int, name: str) -> Strip:
    info = board.command(of_sensor("hello", sensor))
    dark = board.command(of_sensor("get", sensor)).get("dark")
    exposure_us = info["exposure_us"]
    return Strip(frame_id(name, sensor), info["channels"], exposure_us, dark or UNKNOWN_DARK)
