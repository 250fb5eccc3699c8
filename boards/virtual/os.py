"""`os` of the virtual board: an empty path is the root of its file system, as on a real board."""

import uos
from uos import *  # noqa: F403


def stat(path):
    return uos.stat(path or ".")


def ilistdir(path=""):
    return uos.ilistdir(path or ".")


def listdir(path=""):
    return uos.listdir(path or ".")


def statvfs(path):
    return uos.statvfs(path or ".")
