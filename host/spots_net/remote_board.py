"""Opens the port ``zenoh:ID``: a board on another machine, which is read over Zenoh."""

from argparse import Namespace

from spots.link.board import Board

from .options import configure
from .ros2.naming import ros_domain
from .zenoh_link import ZenohLink
from .zenoh_session import find, open_session


def open_port(target: str, options: Namespace | None = None) -> Board:
    """Open the port ``zenoh:ID``, a board that is published on Zenoh; see `link.ports`.

    `target` is the id of the board, or the name of its node; empty for the only published board.
    SpotsError if the board is not published, or several are and `target` is empty.
    """
    configure(options)
    domain = ros_domain()
    session = open_session()
    try:
        link = ZenohLink(session, find(session, target, domain), domain)
    except BaseException:
        session.close()
        raise
    return Board(link)
