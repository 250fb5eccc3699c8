"""Publishes readings as a node of ROS 2 with rmw_zenoh; ROS 2 need not be installed here."""

import os
import secrets
from contextlib import ExitStack
from itertools import count

import zenoh

from spots.errors import SettingError
from spots.link.board import Board
from spots.link.frames import Reading
from spots.link.lines import of_sensor

from ..outlet import kind_of, values
from ..zenoh_session import open_session
from .messages import UNKNOWN_DARK, Strip, messages, types
from .naming import Node, attachment, frame_id, node_name, topic_name
from .types import store

_CDR = zenoh.Encoding.APPLICATION_CDR
_GID_BYTES = 16
_DOMAIN_MAX = 232


class Ros2:
    """A node ``spots_ID`` with the topics ``/spots_ID/stripN/KIND``.

    Parameters
    ----------
    board : Board
        The board.
    address : str
        ROS domain; ROS_DOMAIN_ID, or 0, if not given.

    Raises
    ------
    SpotsError
        If the domain is not a number from 0 to 232, or there is no Zenoh session.
    """

    def __init__(self, board: Board, address: str = ""):
        name = node_name(board.info["id"])
        domain = _domain(address or os.environ.get("ROS_DOMAIN_ID") or "0")
        self._strips = [_strip(board, sensor, name) for sensor in board.sensors]
        self._stack = ExitStack()
        session = self._stack.enter_context(open_session())
        node = Node(domain, str(session.zid()), name)
        self._topics = {}
        number = count(1)
        for sensor in board.sensors:
            for kind, message_type in types().items():
                topic = topic_name(name, sensor, kind)
                self._topics[sensor, kind] = _Topic(
                    session, node, next(number), topic, message_type
                )
        # The node comes last, because its tokens announce topics that exist.
        self._tokens = [one.token for one in self._topics.values()]
        self._tokens.append(session.liveliness().declare_token(node.token))
        self.place = f"ROS 2 node {name} in domain {domain}, over Zenoh"

    def put(self, frame: Reading, utc_s: float) -> None:
        """Publish the messages for a frame; one that the network does not take is lost."""
        strip = self._strips[frame.sensor]
        for kind, message in messages(kind_of(frame), values(frame), utc_s, strip):
            self._topics[frame.sensor, kind].put(message, round(1e9 * utc_s))

    def turn(self) -> None:
        """Do nothing: every frame was published at once."""

    def close(self) -> None:
        """End the node."""
        for token in self._tokens:
            token.undeclare()
        self._stack.close()


class _Topic:
    def __init__(self, session: zenoh.Session, node: Node, number: int, topic: str, kind: str):
        type_hash = store().hash_rihs01(kind)
        self._kind, self._sequence = kind, count(1)
        self._gid = secrets.token_bytes(_GID_BYTES)
        self._publisher = session.declare_publisher(
            node.key(topic, kind, type_hash),
            encoding=_CDR,
            congestion_control=zenoh.CongestionControl.DROP,
        )
        self.token = session.liveliness().declare_token(
            node.topic_token(number, topic, kind, type_hash)
        )

    def put(self, message, time_ns: int) -> None:
        data = bytes(store().serialize_cdr(message, self._kind))
        mark = attachment(next(self._sequence), time_ns, self._gid)
        self._publisher.put(data, attachment=mark)


def _domain(text: str) -> int:
    if not (text.isdecimal() and int(text) <= _DOMAIN_MAX):
        raise SettingError(
            f"{text!r} is not a ROS domain: give a number from 0 to {_DOMAIN_MAX} with "
            "--to ros2=DOMAIN or ROS_DOMAIN_ID"
        )
    return int(text)


def _strip(board: Board, sensor: int, name: str) -> Strip:
    info = board.command(of_sensor("hello", sensor))
    dark = board.command(of_sensor("get", sensor)).get("dark")
    exposure_us = info["exposure_us"]
    return Strip(frame_id(name, sensor), info["plan"], exposure_us, dark or UNKNOWN_DARK)
