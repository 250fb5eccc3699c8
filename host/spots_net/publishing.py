"""``spots publish``: sends the readings of a board to other programs and machines."""

import argparse
import sys
import time
from collections.abc import Sequence
from contextlib import ExitStack
from typing import Any

from spots.common.other_clock import OtherClock
from spots.common.signals import released_by_signals
from spots.errors import BoardError
from spots.link.board import Board
from spots.link.connect import open_named
from spots.link.frames import Contact, Key, Spectrum, Touch
from spots.link.stored import learn_calibrations

from .options import configure
from .outlet import DEFAULT, Outlet, maker
from .ros2.naming import Qos, checked_name, ros_domain

_TURN_S = 0.05  # longest time between two turns of the outlets
_READINGS = Touch, Spectrum, Contact, Key


def stream(board: Board) -> None:
    """Start the streams that outlets send."""
    try:
        board.stream("contact", "touch", "spectrum")
    except BoardError:  # a firmware without contacts
        board.stream("touch", "spectrum")


def publish(board: Board, outlets: Sequence[Outlet], seconds: float | None = None) -> None:
    """Send the frames of a streaming board to outlets; PortError if the board is lost.

    No other code of the program may read the board's frames.
    """
    now_s, utc = board.now_s, OtherClock(time.time, board.now_s)
    end_s = None if seconds is None else now_s() + seconds
    frames = board.frames()
    while end_s is None or now_s() < end_s:
        for frame in frames.within(_TURN_S):
            if isinstance(frame, _READINGS):
                utc_s = utc.now_s() if frame.time_s is None else utc.at(frame.time_s)
                for outlet in outlets:
                    outlet.put(frame, utc_s)
            for outlet in outlets:
                outlet.turn()
        for outlet in outlets:
            outlet.turn()


def publish_command(options: argparse.Namespace) -> None:
    """Run ``spots publish`` with the options that `cli` parsed."""
    configure(options)
    # Before the board, so that a missing package is reported first.
    makers = [maker(name, **_settings(name, options)) for name in options.to or [DEFAULT]]
    with released_by_signals(), open_named(options) as board:
        try:
            with ExitStack() as stack:
                outlets = []
                for opens in makers:
                    outlets.append(opens(board))
                    stack.callback(outlets[-1].close)
                learn_calibrations(board)
                stream(board)
                for outlet in outlets:
                    print(f"published as {outlet.place} (Ctrl-C ends it)", flush=True)
                publish(board, outlets, options.seconds)
        except KeyboardInterrupt:
            pass
        finally:
            stats = board.stats
            print(f"{stats.frames} frames, lost {stats.lost}, bad {stats.bad_crc}", file=sys.stderr)


def _settings(name: str, options: argparse.Namespace) -> dict[str, Any]:
    """Return the arguments of an outlet besides its address; raise SpotsError if one is wrong."""
    kind, _, address = name.partition("=")
    if kind == "osc":
        return {"time_tags": options.osc_time_tags}
    if kind == "foxglove":
        return {"origins": tuple(options.origin or ())}
    if kind != DEFAULT:
        return {}
    ros_domain(address)
    if options.name:
        checked_name(options.name)
    return {"name": options.name, "qos": Qos(options.qos == "reliable", options.depth)}
