"""Names for ROS 2, and the conventions of rmw_zenoh: keys, tokens and attachments.

See https://github.com/ros2/rmw_zenoh/blob/rolling/docs/design.md.
"""

import struct
from typing import NamedTuple

# Reliability, durability, history and depth, deadline, lifespan and liveliness; empty is the
# default. 2: best effort, because a publisher never waits.
QOS = "2::,10:,:,:,,"


def node_name(board_id: str) -> str:
    """Return the name of a board's node."""
    return f"spots_{board_id}"


def frame_id(node: str, sensor: int) -> str:
    """Return the name of a strip's coordinate frame."""
    return f"{node}_strip{sensor}"


def topic_name(node: str, sensor: int, kind: str) -> str:
    """Return the name of a strip's topic; `kind` is a key of `messages.types`."""
    return f"/{node}/strip{sensor}/{kind}"


class Node(NamedTuple):
    """A node of ROS 2: domain, Zenoh id of its session, and its name."""

    domain: int
    zid: str
    name: str

    @property
    def token(self) -> str:
        """Key of the liveliness token that shows the node."""
        return f"@ros2_lv/{self.domain}/{self.zid}/0/0/NN/%/%/{self.name}"

    def topic_token(self, number: int, topic: str, kind: str, type_hash: str) -> str:
        """Return the key of the liveliness token that shows a publisher.

        Parameters
        ----------
        number : int
            Number of the publisher in the node, from 1.
        topic, kind, type_hash : str
            Name of the topic, its message type, and the type's hash.

        Returns
        -------
        str
        """
        mangled = topic.replace("/", "%")
        return (
            f"@ros2_lv/{self.domain}/{self.zid}/0/{number}/MP/%/%/{self.name}/{mangled}/"
            f"{dds(kind)}/{type_hash}/{QOS}"
        )

    def key(self, topic: str, kind: str, type_hash: str) -> str:
        """Return the key under which the messages of a topic are published.

        Parameters
        ----------
        topic, kind, type_hash : str
            See `topic_token`.

        Returns
        -------
        str
        """
        return f"{self.domain}/{topic.lstrip('/')}/{dds(kind)}/{type_hash}"


def dds(kind: str) -> str:
    """Return the name of a message type for DDS, such as ``std_msgs::msg::dds_::Header_``."""
    package, part, name = kind.split("/")
    return f"{package}::{part}::dds_::{name}_"


def attachment(sequence: int, time_ns: int, gid: bytes) -> bytes:
    """Return the attachment of a message.

    Parameters
    ----------
    sequence : int
        Number of the message, from 1.
    time_ns : int
        Source time, in ns since 1970.
    gid : bytes
        Id of the publisher.

    Returns
    -------
    bytes
    """
    return struct.pack("<qqB", sequence, time_ns, len(gid)) + gid
