"""How old a reading is when it is on the screen. ``pytest -s`` prints the figures of docs/page.md.

Only gross failure is asserted: what else runs on a machine is none of the page's making.
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
from spots.web.state import State

MEASURED = 300  # readings
GROSS_S = 2.0


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
    for page in opened:
        page.evaluate("drawn.length = 0")
    until(opened[0], f"drawn.length > {MEASURED}")
    found = [page.evaluate("drawn") for page in opened]
    epoch_s = time.time() - time.monotonic()
    ages_s, sensor_s, rates = [], [], []
    for drawn in found:
        assert len(drawn) > MEASURED / 10
        ages_s += [one["shown_s"] - epoch_s - one["arrived_s"] for one in drawn]
        sensor_s += [one["shown_s"] - epoch_s - one["time_s"] for one in drawn]
        rates.append((len(drawn) - 1) / (drawn[-1]["shown_s"] - drawn[0]["shown_s"]))
    assert np.percentile(ages_s, 50) < GROSS_S
    print(f"\n{pages} pages and {stalled} stalled, each drawing {np.median(rates):.0f} a second:")
    for name, values in (("from frame to pixel", ages_s), ("from light to pixel", sensor_s)):
        p50, p99 = 1000 * np.percentile(values, (50, 99))
        print(f"  {name}: p50 {p50:.1f} ms, p99 {p99:.1f} ms")
    for page, end in zip(others, wake):
        woken_s = time.time()
        end()
        page.evaluate("drawn.splice(0, drawn.length - 2)")
        until(page, f"drawn.filter((one) => one.shown_s > {woken_s}).length > 20")
        first = [one for one in page.evaluate("drawn") if one["shown_s"] > woken_s]
        stale = [one for one in first if woken_s - epoch_s - one["arrived_s"] > GROSS_S]
        assert len(stale) <= 2  # what had been sent before it stalled
