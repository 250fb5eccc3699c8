"""A node of ROS 2 in a Zenoh session, as rmw_zenoh makes it: publishers and services."""

import time
from collections.abc import Callable
from contextlib import ExitStack
from itertools import count

import zenoh

from .ros2.naming import Attachment, Node, Qos, Topic, gid_of
from .zenoh_session import direct

_CDR = zenoh.Encoding.APPLICATION_CDR
_SERVICE_QOS = "::,10:,:,:,,"  # all fields are the default


class RosNode:
    """A node with its publishers and services, which end with it."""

    def __init__(self, session: zenoh.Session, domain: int, name: str):
        self._session, self._numbers = session, count(1)
        self._node = Node(domain, str(session.zid()), name)
        self._stack = ExitStack()
        self._declare(self._node.token)

    def publisher(self, topic: Topic, qos: Qos) -> "Sender":
        """Declare a publisher of a topic, and the token that shows it."""
        token = self._node.token_of("MP", next(self._numbers), topic, qos.token)
        made = Sender(self._session, topic.key(self._node.domain), gid_of(token), qos.reliable)
        self._stack.callback(made.close)
        self._declare(token)
        return made

    def service(self, topic: Topic, handle: Callable[[zenoh.Query], None]) -> None:
        """Declare a service, and the token that shows it; Zenoh's threads call `handle`."""
        queryable = self._session.declare_queryable(
            topic.key(self._node.domain), direct(handle), complete=True
        )
        self._stack.callback(queryable.undeclare)
        self._declare(self._node.token_of("SS", next(self._numbers), topic, _SERVICE_QOS))

    def close(self) -> None:
        """End the node; the first to end is what was declared last."""
        self._stack.close()

    def _declare(self, token: str) -> None:
        self._stack.callback(self._session.liveliness().declare_token(token).undeclare)


class Sender:
    """Publishes messages of a topic, and never waits: what the network does not take is lost."""

    def __init__(self, session: zenoh.Session, key: str, gid: bytes, reliable: bool):
        self._sequence, self._gid = count(1), gid
        kinds = zenoh.Reliability
        self._publisher = session.declare_publisher(
            key,
            encoding=_CDR,
            congestion_control=zenoh.CongestionControl.DROP,
            reliability=kinds.RELIABLE if reliable else kinds.BEST_EFFORT,
        )
        self.close = self._publisher.undeclare

    @property
    def wanted(self) -> bool:
        """Whether anybody subscribes to the topic."""
        return self._publisher.matching_status.matching

    def put(self, data: bytes, time_ns: int | None = None) -> None:
        """Publish a message in CDR; without `time_ns` (since 1970), it has the present time.

        Not a str: while Zenoh converts one, it swallows the exception of a Ctrl-C.
        """
        if time_ns is None:
            time_ns = time.time_ns()
        mark = Attachment(next(self._sequence), time_ns, self._gid).packed()
        self._publisher.put(data, attachment=mark)
