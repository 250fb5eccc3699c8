"""The message types of ROS 2 that SPOTS sends: standard ones, and those in the folder ``msg``."""

from functools import cache
from importlib.resources import files
from typing import Any

from .naming import Topic
from .optional import typesys

PACKAGE = "spots_msgs"
OWN = "Reading", "Contact", "Spectrum", "Key", "Frame"
# The standard service without a request, and its hash, which `ros2 service info` shows.
_TRIGGER = "std_srvs/srv/Trigger"
_TRIGGER_HASH = "RIHS01_eeff2cd6fa5ad9d27cdf4dec64818317839b62f212a91e6b5304b634b2062c5f"
FRAME = f"{PACKAGE}/msg/Frame"
REPLY = f"{_TRIGGER}_Response"
# An empty message has one byte after the four bytes of the head, because IDL has no empty types.
EMPTY = b"\0\1\0\0\0"


@cache
def store() -> typesys.store.Typestore:
    """Return the types of ROS 2 Jazzy, and `OWN`.

    The store serializes messages to CDR, and computes the type hashes (RIHS01) of ROS 2.
    """
    made = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    for name in OWN:
        text = files(__package__).joinpath("msg", f"{name}.msg").read_text(encoding="utf-8")
        made.register(typesys.get_types_from_msg(text, own(name)))
    (fields,) = typesys.get_types_from_msg("bool success\nstring message", REPLY).values()
    made.register({REPLY: fields})
    return made


def own(name: str) -> str:
    """Return the full name of a message type of SPOTS, such as ``spots_msgs/msg/Reading``."""
    return f"{PACKAGE}/msg/{name}"


def topic(name: str, kind: str) -> Topic:
    """Return the topic with a name and a message type."""
    return Topic(name, kind, store().hash_rihs01(kind))


def service(name: str) -> Topic:
    """Return the service with a name; all services of SPOTS have the type ``std_srvs/Trigger``."""
    return Topic(name, _TRIGGER, _TRIGGER_HASH)


def packed(message: Any) -> bytes:
    """Return a message as CDR."""
    return bytes(store().serialize_cdr(message, message.__msgtype__))
