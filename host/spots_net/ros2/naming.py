"""Names for ROS 2, and the conventions of rmw_zenoh: keys, tokens and attachments.

See https://github.com/ros2/rmw_zenoh/blob/rolling/docs/design.md.
"""

import os
import re
import struct
from hashlib import blake2b
from typing import Any, NamedTuple

from spots.errors import SettingError

_PREFIX = "spots_"  # the name of a board's node, if no other is given, is this and the board's id
_NAME = re.compile("[0-9A-Za-z_]{1,200}")
_DOMAIN_MAX = 232
_HEAD = struct.Struct("<qqB")  # of an attachment
GID_BYTES = 16


def node_name(board_id: str) -> str:
    """Return the name of a board's node, if the user gives no other."""
    return f"{_PREFIX}{board_id}"


def short_name(node: str) -> str:
    """Return the text by which ``--port zenoh:`` names a node: a board's id, or the node's name."""
    return node.removeprefix(_PREFIX)


def is_name(text: str) -> bool:
    """Return whether a text can be part of a topic's name."""
    return _NAME.fullmatch(text) is not None


def checked_name(text: str) -> str:
    """Return the name of a node that the user gives; raise SettingError if it is invalid."""
    if not is_name(text) or text[0].isdigit():
        raise SettingError(
            f"{text!r} is not the name of a node: give letters, digits and _ with --name, and no "
            "digit first"
        )
    return text


def frame_id(node: str, sensor: int) -> str:
    """Return the name of a strip's coordinate frame."""
    return f"{node}_strip{sensor}"


def topic_name(node: str, sensor: int, kind: str) -> str:
    """Return the name of a strip's topic; `kind` is a key of `messages.types`."""
    return f"/{node}/strip{sensor}/{kind}"


def frames_topic(node: str) -> str:
    """Return the name of the topic of a board's frames."""
    return f"/{node}/frames"


def service_name(node: str, command: str) -> str:
    """Return the name of the service that returns a board's reply to a command."""
    return f"/{node}/{command}"


def ros_domain(text: str = "") -> int:
    """Return a ROS domain from 0 to 232; without `text`, ROS_DOMAIN_ID, or 0."""
    text = text or os.environ.get("ROS_DOMAIN_ID") or "0"
    if not (text.isascii() and text.isdecimal() and int(text[-9:]) <= _DOMAIN_MAX >= len(text)):
        raise SettingError(
            f"{text!r} is not a ROS domain: give a number from 0 to {_DOMAIN_MAX} with "
            "--to ros2=DOMAIN or ROS_DOMAIN_ID"
        )
    return int(text)


class Qos(NamedTuple):
    """Quality of service of topics; a subscriber stores `depth` messages.

    A message of a reliable topic that is lost is sent again. Both kinds drop messages that the
    network does not take in time.
    """

    reliable: bool = False
    depth: int = 10

    @property
    def token(self) -> str:
        """The text in a token; an empty field is the default, which is reliable."""
        return f"{'' if self.reliable else 2}::,{self.depth}:,:,:,,"


DEFAULT_QOS = Qos()


class Node(NamedTuple):
    """A node of ROS 2: domain, Zenoh id of its session, and its name."""

    domain: int
    zid: str
    name: str

    @property
    def token(self) -> str:
        """Key of the liveliness token that shows the node."""
        return f"@ros2_lv/{self.domain}/{self.zid}/0/0/NN/%/%/{self.name}"

    def token_of(self, entity: str, number: int, topic: "Topic", qos: str) -> str:
        """Return the key of the liveliness token that shows a publisher (MP) or a service (SS).

        The entities of a node are numbered from 1. `qos` is that of `Qos.token`.
        """
        mangled = topic.name.replace("/", "%")
        return (
            f"@ros2_lv/{self.domain}/{self.zid}/0/{number}/{entity}/%/%/{self.name}/{mangled}/"
            f"{dds(topic.kind)}/{topic.type_hash}/{qos}"
        )


class Topic(NamedTuple):
    """A topic or a service: its name, the type of its messages, and the type's hash."""

    name: str
    kind: str
    type_hash: str

    def key(self, domain: int) -> str:
        """Return the key under which its messages or requests are sent."""
        return f"{domain}/{self.name.lstrip('/')}/{dds(self.kind)}/{self.type_hash}"

    def tokens(self, domain: int, node: str) -> str:
        """Return the expression that selects the tokens of this type's publishers; "*" is any."""
        return f"@ros2_lv/{domain}/*/*/*/MP/*/*/{node}/*/{dds(self.kind)}/{self.type_hash}/*"


def node_of(token: str) -> str:
    """Return the name of the node in the key of a publisher's token."""
    return token.split("/")[8]


def dds(kind: str) -> str:
    """Return the name of a message type for DDS, such as ``std_msgs::msg::dds_::Header_``."""
    package, part, name = kind.split("/")
    return f"{package}::{part}::dds_::{name}_"


class Attachment(NamedTuple):
    """What accompanies each message.

    `sequence` counts from 1; in a response, it is that of the request. `time_ns` is since 1970.
    `gid` is the id of the publisher, or of the client that sent the request.
    """

    sequence: int
    time_ns: int
    gid: bytes

    def packed(self) -> bytes:
        """Return the attachment as bytes."""
        return _HEAD.pack(self.sequence, self.time_ns, len(self.gid)) + self.gid


def unpacked(data: Any) -> Attachment | None:
    """Return the attachment of a message from an untrusted sender; None if it is invalid."""
    if data is None or len(data) != _HEAD.size + GID_BYTES:
        return None
    data = bytes(data)
    sequence, time_ns, size = _HEAD.unpack_from(data)
    return Attachment(sequence, time_ns, data[_HEAD.size :]) if size == GID_BYTES else None


def gid_of(token: str) -> bytes:
    """Return the id of a publisher, by the key of its token.

    So a message whose publisher has no token is known. rmw_zenoh uses another hash of this key, and
    compares no hashes of others.
    """
    return blake2b(token.encode(), digest_size=GID_BYTES).digest()
