"""Opens the port ``zenoh:ID``: a board on another machine, which is read over Zenoh."""

from spots.link.board import Board

from .zenoh_link import ZenohLink
from .zenoh_session import find, open_session


def open_port(rest: str, **simulated) -> Board:
    """Open the port ``zenoh:ID``, a board that is published on Zenoh; see `link.ports`.

    Parameters
    ----------
    rest : str
        Id of the board; empty for the only published board.
    **simulated
        Options that only simulated boards use; ignored.

    Returns
    -------
    Board

    Raises
    ------
    SpotsError
        If the board is not published, or `rest` is empty and several boards are published.
    """
    session = open_session()
    try:
        link = ZenohLink(session, find(session, rest))
    except BaseException:
        session.close()
        raise
    return Board(link)
