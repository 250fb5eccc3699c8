"""The message types of ROS 2 that SPOTS sends: standard ones, and those in the folder ``msg``."""

from functools import cache
from importlib.resources import files

from .optional import typesys

PACKAGE = "spots_msgs"
OWN = "Reading", "Contact", "Spectrum"


@cache
def store() -> typesys.store.Typestore:
    """Return the types of ROS 2 Jazzy, and `OWN`.

    Returns
    -------
    rosbags.typesys.store.Typestore
        It serializes messages to CDR, and computes the type hashes (RIHS01) of ROS 2.
    """
    made = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)
    for name in OWN:
        text = files(__package__).joinpath("msg", f"{name}.msg").read_text()
        made.register(typesys.get_types_from_msg(text, own(name)))
    return made


def own(name: str) -> str:
    """Return the full name of a message type of SPOTS, such as ``spots_msgs/msg/Reading``."""
    return f"{PACKAGE}/msg/{name}"
