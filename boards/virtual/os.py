"""`os` of the virtual board: an empty path is its file system's top, as on a microcontroller."""

import uos
from uos import *  # noqa: F403


def stat(path):
    return uos.stat(path or ".")
