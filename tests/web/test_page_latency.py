"""How old a reading is when it is on the screen. ``pytest -s`` prints the figures of docs/page.md.

Times are not asserted: what else runs on a machine is none of the page's making. What is: a page
draws readings once and in their order, never has more than two messages underway, and draws on
while another one stands still.
"""

from __future__ import annotations

import time
from contextlib import closing
from types import SimpleNamespace

import numpy as np
import pytest

from serving import until
from spots.uses.layout import load
from spots.web.reader import Reader, finder
from spots.web.state import Cursor, State

MEASURED = 150  # readings that the first page draws
SETTLED = 60  # and before that
MOST_UNDERWAY = 2


@pytest.fixture(scope="module")
def virtual():
    """The state of a virtual board in real time, in a process of its own."""
    state = State()
    reader = Reader(finder("virtual", "default", "demo", 0), load("digits"), state)
    reader.start()
    with closing(SimpleNamespace(close=lambda: reader.stop(30))):
        yield state


def stall(page):
    """Stop a page dead, without using the processor; return what wakes it."""
    dialogs = []
    page.on("dialog", lambda dialog: dialogs.append(dialog))
    page.evaluate("() => { setTimeout(() => alert('stalled'), 0); }")
    while not dialogs:
        page.wait_for_timeout(20)
    return dialogs[0].dismiss


@pytest.mark.parametrize(("pages", "stalled"), [(1, 0), (8, 1)])
def test_from_frame_to_pixel(virtual, serve, open_page, pages, stalled):
    url = serve(virtual).url
    opened = [open_page(url) for _ in range(pages)]
    for page in opened:
        until(page, "drawn.length > 0")
    others = [open_page(url) for _ in range(stalled)]
    for page in others:
        until(page, "drawn.length > 0")
    wake = [stall(page) for page in others]
    until(opened[0], f"drawn.length > {SETTLED}")
    for page in opened:
        page.evaluate("drawn.length = 0")
    until(opened[0], f"drawn.length > {MEASURED}")
    found = [page.evaluate("drawn") for page in opened]
    epoch_s = time.time() - time.monotonic()
    ages_s, sensor_s, rates = [], [], []
    for drawn in found:
        assert len(drawn) > MEASURED / 10
        times_s = [one["time_s"] for one in drawn]
        assert times_s == sorted(set(times_s))
        ages_s += [one["shown_s"] - epoch_s - one["arrived_s"] for one in drawn]
        sensor_s += [one["shown_s"] - epoch_s - one["time_s"] for one in drawn]
        rates.append((len(drawn) - 1) / (drawn[-1]["shown_s"] - drawn[0]["shown_s"]))
    board_hz = virtual.since(Cursor(0, 0))[1]["link"]["rate_hz"]
    print(
        f"\n{pages} pages and {stalled} stalled, each drawing {np.median(rates):.0f} of "
        f"{board_hz:.0f} readings a second:"
    )
    for name, values in (("from frame to pixel", ages_s), ("from light to pixel", sensor_s)):
        p50, p99 = 1000 * np.percentile(values, (50, 99))
        print(f"  {name}: p50 {p50:.1f} ms, p99 {p99:.1f} ms")
    newest_s = found[0][-1]["time_s"]
    for page, end in zip(others, wake):
        end()
        page.evaluate("drawn.length = 0")
        until(page, f"drawn.filter((one) => one.time_s > {newest_s}).length > 20")
        late = [one for one in page.evaluate("drawn") if one["time_s"] <= newest_s]
        assert len(late) <= MOST_UNDERWAY  # what had been sent before it stood still
    for page in opened + others:
        assert 1 <= page.evaluate("underway") <= MOST_UNDERWAY
