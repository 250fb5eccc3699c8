"""Measures the processor time of each outlet of ``spots publish --to``.

``PYTHONPATH=tests .venv/bin/python -m bench.outlets`` prints, for each outlet, the share of a core
that a board with 100 readings a second takes, and, as a peer, the share of decoding the frames.
The share of ``ros2`` includes a subscriber of all topics in the same process.
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

import zenoh
from support.net import Net, session

from spots.errors import SpotsError
from spots.link.board import Board
from spots.link.frames import Spectrum, Touch
from spots_net.outlet import maker
from spots_net.publishing import stream

from .standin import StandIn

_RATE_HZ = 100
_READINGS = 2000
_CONNECT_S = 1.0  # for a subscriber to connect


def measure(names: list[str]) -> dict[str, float]:
    """Return the share of a core at 100 readings a second, by outlet."""
    board = Board(StandIn("bench", 1000))
    board._link.fast = True
    stream(board)
    frames = []
    began_s = time.process_time()
    while len(frames) < 2 * _READINGS:
        frames += [one for one in board.frames(0.1) if isinstance(one, Touch | Spectrum)]
    found = {"decoding": _share(time.process_time() - began_s, len(frames))}
    for name in names:
        try:
            outlet = maker(name)(board)
        except SpotsError as error:
            print(f"{name}: not measured: {error}")
            continue
        time.sleep(_CONNECT_S)
        began_s = time.process_time()
        for i, frame in enumerate(frames):
            outlet.put(frame, time.time())
            outlet.turn()
            if not i % 20:
                time.sleep(0.001)  # lets the threads of the outlet run
        outlet.close()
        found[name.partition("=")[0]] = _share(time.process_time() - began_s, len(frames))
    return found


def _share(cpu_s: float, frames: int) -> float:
    return cpu_s / (frames / 2) * _RATE_HZ


def main() -> None:
    with tempfile.TemporaryDirectory() as folder:
        net = Net(Path(folder))
        os.environ["ZENOH_CONFIG"] = str(net.hub)
        reader = session(net.leaf)
        ignore = zenoh.handlers.Callback(lambda sample: None, indirect=False)
        reader.declare_subscriber("0/**", ignore)
        names = ["ros2", "foxglove=127.0.0.1:0", "lsl", "osc=127.0.0.1:9"]
        for name, share in measure([*names, f"rerun={folder}/run.rrd"]).items():
            print(f"{name:9} {100 * share:5.2f} % of a core")


if __name__ == "__main__":
    main()
