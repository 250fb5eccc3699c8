"""A Zenoh network inside this computer, and boards that this process publishes on it."""

from __future__ import annotations

import contextlib
import json
import socket
import threading
import time

import zenoh
from bench.standin import StandIn

from spots import Board
from spots_net.publish import Publisher
from spots_net.publishing import publish, stream
from spots_net.ros2.messages import types
from spots_net.ros2.naming import (
    Attachment,
    Node,
    Qos,
    frames_topic,
    gid_of,
    node_name,
    service_name,
    topic_name,
)
from spots_net.ros2.types import EMPTY, FRAME, REPLY, packed, service, store, topic

DEADLINE_S = 60.0
RATE_HZ = 200


class Net:
    """Two Zenoh configuration files: a program with `hub` listens, those with `leaf` connect."""

    def __init__(self, folder):
        with socket.create_server(("127.0.0.1", 0)) as free:
            place = f"tcp/127.0.0.1:{free.getsockname()[1]}"
        retry = {"period_init_ms": 50, "period_max_ms": 200}
        self.hub = self._file(folder / "hub.json5", listen=[place])
        self.leaf = self._file(folder / "leaf.json5", connect=[place], retry=retry)

    @staticmethod
    def _file(path, listen=(), connect=(), retry=None):
        ends = {"listen": {"endpoints": list(listen)}, "connect": {"endpoints": list(connect)}}
        if retry:
            ends["connect"]["retry"] = retry
        path.write_text(json.dumps({"scouting": {"multicast": {"enabled": False}}, **ends}))
        return path


def session(path):
    return zenoh.open(zenoh.Config.from_file(path))


class Restarting(StandIn):
    """A substitute board that restarts when `restarting` is set to True."""

    restarting = False

    def read(self, timeout_s):
        if self.restarting:  # restart here: in the thread that reads, between two frames
            self.restarting = False
            self.__init__(self._id, 1 / self._period_s)
            self.fast = True
        return super().read(timeout_s)


@contextlib.contextmanager
def publishing(path, *links, kind=Publisher):
    """Publish boards from this process in a ``with`` block; yield the publishers.

    Parameters
    ----------
    path : Path
        Zenoh configuration file.
    links : object
        Links of the boards.
    kind : type
        Class of the publishers.
    """
    ended = threading.Event()
    failed = []

    def serve(board, publisher):
        try:
            while not ended.is_set():
                publish(board, [publisher], 0.1)
        except Exception as error:
            failed.append(error)
        publisher.close()

    with session(path) as own:
        boards = [Board(link) for link in links]
        publishers = [kind(board, session=own) for board in boards]
        for board in boards:
            stream(board)
        threads = [threading.Thread(target=serve, args=pair) for pair in zip(boards, publishers)]
        for thread in threads:
            thread.start()
        try:
            yield publishers
        finally:
            ended.set()
            for thread in threads:
                thread.join(DEADLINE_S)
    assert not failed


def stand_in(board_id="a1", kind=StandIn, rate_Hz=RATE_HZ):
    link = kind(board_id, rate_Hz)
    link.fast = True
    return link


def wait_until(condition):
    end_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.005)


def topic_key(board_id, kind, sensor=0):
    """Return the Zenoh key of a topic of a board in the domain 0."""
    return topic(topic_name(node_name(board_id), sensor, kind), types()[kind]).key(0)


def frames(board_id):
    """Return the topic of a board's frames."""
    return topic(frames_topic(node_name(board_id)), FRAME)


def service_key(board_id, command):
    return service(service_name(node_name(board_id), command)).key(0)


def tokens(board_id="*"):
    """Return the expression for the tokens that announce a board."""
    return frames(board_id).tokens(0, node_name(board_id) if board_id != "*" else "*")


class Announced:
    """A foreign peer that announces a board: a token, and messages that look like a board's.

    Parameters
    ----------
    foreign : zenoh.Session
        Session of the peer.
    board_id : str
        Id of the announced board.
    """

    def __init__(self, foreign, board_id):
        self._foreign, self._frames = foreign, frames(board_id)
        self._id = board_id
        node = Node(0, str(foreign.zid()), node_name(board_id))
        self._token = node.token_of("MP", 1, self._frames, Qos().token)

    def __enter__(self):
        self._declared = self._foreign.liveliness().declare_token(self._token)
        return self

    def __exit__(self, *exception):
        self._declared.undeclare()

    def replies(self, command, message, success=True):
        """Reply to a command with a text, as a service does."""
        self.replies_cdr(command, packed(store().types[REPLY](success, message)))

    def replies_cdr(self, command, data):
        self._foreign.declare_queryable(
            service_key(self._id, command),
            lambda query: query.reply(query.key_expr, data),
            complete=True,
        )

    def put(self, data, gid=None):
        mark = Attachment(1, 1, gid or gid_of(self._token))
        self._foreign.put(self._frames.key(0), data, attachment=mark.packed())


REQUEST = {
    "payload": EMPTY,
    "attachment": Attachment(1, 1, bytes(16)).packed(),
    "target": zenoh.QueryTarget.ALL_COMPLETE,
    "consolidation": zenoh.ConsolidationMode.NONE,
}


def ask(other, board_id, command, **options):
    """Call a service as a client of ROS does; return the replies."""
    return other.get(service_key(board_id, command), **{**REQUEST, **options})


def content(reply):
    """Return the JSON object in the response of a service."""
    return json.loads(store().deserialize_cdr(reply.ok.payload.to_bytes(), REPLY).message)


def message(sample, kind):
    """Return the message of a topic's sample."""
    return store().deserialize_cdr(sample.payload.to_bytes(), types()[kind])
