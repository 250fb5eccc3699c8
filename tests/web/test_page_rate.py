"""Rate of messages to browsers that share processors: as many as they can draw; simulated time."""

from __future__ import annotations

import heapq
import math
from types import SimpleNamespace

import numpy as np
import pytest

from spots_web import pace
from spots_web.pace import PagePace

SCREEN_S = 1 / 60
PROCESSORS = 2
SECONDS = 40.0
SETTLED_S = 10.0


def drawing(pages, draw_s, stalled=0, away_s=0.0):
    """Simulate browsers that draw pages on two processors.

    A message is drawn at the next frame of the screen, after all earlier messages.

    Parameters
    ----------
    pages : int
        Number of pages that draw.
    draw_s : float
        Processor time to draw a message, in s.
    stalled : int
        Number of additional pages that never draw.
    away_s : float
        Network delay of a message, and also of its acknowledgement, in s.

    Returns
    -------
    delays_s : list of float
        Times from sending a message until its acknowledgement arrives, in s.
    rates_Hz : list of float
        Messages that each page draws per second.
    paces : list of PagePace
        State of each page, including the stalled pages.
    """
    clock = SimpleNamespace(now_s=0.0)
    paces = [PagePace(lambda: clock.now_s) for _ in range(pages + stalled)]
    free_s = [0.0] * PROCESSORS
    # Events in the order of time: a page may get a message, or has drawn a message.
    events = [(0.001 * i, i, "tell", 0) for i in range(pages + stalled)]
    waiting, took = set(), [[] for _ in paces]
    heapq.heapify(events)
    while events:
        clock.now_s, i, what, number = heapq.heappop(events)
        now_s, one = clock.now_s, paces[i]
        if now_s > SECONDS:
            break
        if what == "drawn":
            one.acknowledge(number)
            if i in waiting:
                waiting.remove(i)
                heapq.heappush(events, (now_s, i, "tell", 0))
        elif one.full:
            waiting.add(i)
        else:
            number = one.send()
            one.answered(2 * away_s)
            assert one.sent - one.drawn <= 2
            if i < pages:
                frame_s = math.ceil((now_s + away_s) / SCREEN_S) * SCREEN_S
                begin_s = max(frame_s, heapq.heappop(free_s))
                heapq.heappush(free_s, begin_s + draw_s)
                known_s = begin_s + draw_s + away_s
                heapq.heappush(events, (known_s, i, "drawn", number))
                if now_s > SETTLED_S:
                    took[i].append(known_s - now_s)
            heapq.heappush(events, (now_s + one.every_s, i, "tell", 0))
    rates = [len(times) / (SECONDS - SETTLED_S) for times in took[:pages]]
    return np.concatenate(took), rates, paces


def test_one_page_is_told_at_every_frame_of_its_screen():
    took_s, rates, _ = drawing(1, 0.006)
    assert rates[0] > 55
    assert took_s.max() < pace.LATE_S


@pytest.mark.parametrize("away_s", [0.01, 0.02, 0.05, 0.2])
def test_a_page_far_away_is_told_as_often_as_may_be_on_the_way(away_s):
    _, rates, _ = drawing(1, 0.006, away_s=away_s)
    way_s = 2 * away_s + 0.006
    assert rates[0] > 0.75 * min(55, pace.WINDOW / (way_s + SCREEN_S / 2))


def test_a_page_far_away_is_told_more_often_than_one_that_draws_as_slowly():
    _, far, _ = drawing(1, 0.006, away_s=0.03)
    _, slow, _ = drawing(1, 0.066)
    assert far[0] > 1.5 * slow[0]


@pytest.mark.parametrize("draw_s", [0.004, 0.008, 0.012])
def test_pages_that_share_a_processor_do_not_wait_for_each_other(draw_s):
    took_s, rates, _ = drawing(8, draw_s)
    assert np.percentile(took_s, 95) < 1.1 * pace.LATE_S
    assert min(rates) > 1.5 / pace.SELDOM_S
    assert max(rates) < 3 * min(rates)


def test_told_at_every_frame_they_would_wait(monkeypatch):
    monkeypatch.setattr(pace, "_SLOWER", 1.0)
    took_s, _, _ = drawing(8, 0.008)
    assert np.median(took_s) > pace.LATE_S


def test_a_page_that_stands_still_changes_nothing_for_the_others():
    took_s, rates, paces = drawing(8, 0.008, stalled=1)
    alone_s, alone, _ = drawing(8, 0.008)
    assert paces[-1].sent == pace.WINDOW
    assert np.array_equal(took_s, alone_s)
    assert rates == alone


def test_a_page_that_is_always_late_is_still_told():
    _, rates, _ = drawing(1, 0.050)
    assert rates[0] > 0.9 / pace.SELDOM_S


def test_what_was_not_sent_cannot_have_been_drawn():
    one = PagePace(lambda: 0.0)
    one.send()
    one.acknowledge(1000)
    assert one.drawn == 1
    one.acknowledge(1)
    assert one.drawn == 1
