"""``spots dark``: takes the dark frame of a board whose LED a person must unplug.

A dark frame contains the counts that each channel has without the light of the LED.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable

from spots_device.reading.decode import DARK_SAMPLES

from ...common.signals import stop_explained
from ...errors import BoardError
from ...link.board import Board
from ...link.connect import ensured, open_named
from .guide import Guide

_TIMEOUT_S = 60.0
_MOST = 0.05  # largest dark count as a share of full scale; more is ambient light


def dark_command(options: argparse.Namespace) -> None:
    """Run ``spots dark`` with the options that `cli` parsed."""
    guide = Guide()
    again = "nothing is saved; plug the LED in again, and run the same command again"
    with stop_explained(lambda: again), open_named(options) as board:
        dark = take_dark(board, guide.ask)
    counts = " ".join(f"{sum_ / DARK_SAMPLES:.1f}" for sum_ in dark)
    guide.say(f"the dark frame is stored on the board: {counts} counts")


def take_dark(board: Board, ask: Callable[[str], str]) -> list[int]:
    """Take the dark frame after a person has unplugged the LED; store the frame on the board.

    It is valid for the board's present settings. ``ask(text)`` returns when the person has done
    what it asks. Returned are the six dark counts, summed over `decode.DARK_SAMPLES` samples.
    BoardError if the board can switch its LED off itself.
    """
    state = board.command("get")
    if state["led"] != "always":
        raise BoardError(
            f"led={state['led']}: the board switches its LED and takes dark frames itself; if the "
            "LED is always on, run 'spots command set led=always' first",
            "led_switched",
        )
    limit = _MOST * DARK_SAMPLES * state["full_scale"]
    ask("unplug the LED or cover the strip's end at the LED, touch nothing, then press Enter: ")
    while max(dark := board.command("dark off", timeout_s=_TIMEOUT_S)["dark"]) > limit:
        share = max(dark) / DARK_SAMPLES / state["full_scale"]
        ask(
            f"the light is still {share:.0%} of full scale: keep light off the strip, then press "
            "Enter: "
        )
    ask("plug the LED in again or uncover it, then press Enter: ")
    ensured(board, "save")
    return dark
