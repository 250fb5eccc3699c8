"""Measures many boards in one process: processor time, and the age of a reading in a callback.

``PYTHONPATH=tests .venv/bin/python -m bench.many_boards`` prints a row for each number of boards.
Another process sends their frames through pseudo-terminals, 100 readings a second each, with
spectra. The age counts from the last byte of the frame's creation; on a board, half an exposure
and the transfer of the sample come before it (5.6 ms at 10 ms, see ``spots demo --fast``).
"""

from __future__ import annotations

import multiprocessing
import os
import pty
import threading
import time
import tty
from contextlib import ExitStack, suppress

import numpy as np

import spots

from .standin import StandIn

_RATE_HZ = 100
_SECONDS = 5.0
_WARM_UP_S = 1.0
_TURN_S = 0.001


def feed(masters: list[int]) -> None:
    """Play a substitute board at each pseudo-terminal, until the process is ended."""
    boards = []
    for number, master in enumerate(masters):
        os.set_blocking(master, False)
        boards.append((master, StandIn(f"{number:04x}", _RATE_HZ)))
        boards[-1][1].fast = True
    while True:
        for master, board in boards:
            with suppress(BlockingIOError, OSError):
                board.write(os.read(master, 4096))
            with suppress(BlockingIOError):
                if data := board.read(0):
                    os.write(master, data)
        time.sleep(_TURN_S)


def measure(count: int, seconds: float = _SECONDS) -> dict[str, float]:
    """Return the share of a core for each board, readings a second, and ages in ms.

    Parameters
    ----------
    count : int
        Number of boards.
    seconds : float
        Duration of the measurement.

    Returns
    -------
    dict
        ``core``, ``rate_hz``, ``p50_ms``, ``p99_ms``, ``lost``.
    """
    pairs = [pty.openpty() for _ in range(count)]
    for _, slave in pairs:
        tty.setraw(slave)
    child = multiprocessing.get_context("fork").Process(
        target=feed, args=([master for master, _ in pairs],), daemon=True
    )
    child.start()
    ages_us: list[int] = []
    counting = threading.Event()

    def take(touch: spots.Touch) -> None:
        if counting.is_set():
            ages_us.append(time.monotonic_ns() // 1000 - touch.t_us & 0xFFFFFFFF)

    try:
        with ExitStack() as stack:
            boards = [stack.enter_context(spots.open(os.ttyname(slave))) for _, slave in pairs]
            for board in boards:
                board.stream("touch", "spectrum")
                board.subscribe(take)
            time.sleep(_WARM_UP_S)
            counting.set()
            began_s = time.process_time()
            time.sleep(seconds)
            used_s = time.process_time() - began_s
            counting.clear()
            lost = sum(board.stats.lost for board in boards)
    finally:
        child.terminate()
        child.join()
        for pair in pairs:
            for one in pair:
                os.close(one)
    half_ms, late_ms = np.percentile(ages_us, [50, 99]) / 1000
    rate_hz = len(ages_us) / count / seconds
    core = used_s / seconds / count
    return {
        "core": core,
        "rate_hz": rate_hz,
        "p50_ms": float(half_ms),
        "p99_ms": float(late_ms),
        "lost": lost,
    }


def main() -> None:
    print("boards  core a board  readings/s   age p50    age p99   lost")
    for count in (1, 5, 20):
        row = measure(count)
        print(
            f"{count:6}  {100 * row['core']:10.2f} %  {row['rate_hz']:10.1f}  "
            f"{row['p50_ms']:6.2f} ms  {row['p99_ms']:6.2f} ms  {row['lost']:5}"
        )


if __name__ == "__main__":
    main()
