"""Hostile Zenoh peers: they send messages that no SPOTS program sends."""

from __future__ import annotations

import json
import subprocess
import sys
import tracemalloc
from itertools import pairwise

import pytest
import zenoh
from support.net import DEADLINE_S, publishing, session, stand_in, wait_until

import spots
from spots import SpotsError
from spots.link import reconnect as reconnect_module
from spots_net import mailbox, subscribe

DEEP = b'{"a":' * 50_000 + b"1" + b"}" * 50_000
WIDE = json.dumps({"a": [[]] * 200}).encode()
LONG = json.dumps({"a": "x" * 100_000}).encode()

FLOOD = """
import sys, time, zenoh
session = zenoh.open(zenoh.Config.from_file(sys.argv[1]))
ask = [session.declare_querier(f"spots/{sys.argv[2]}/{name}") for name in ("get", "info", "sync")]
ignore = zenoh.handlers.Callback(lambda reply: None, indirect=False)
sent, due_s = 0, time.monotonic()
while True:
    ask[sent % 3].get(handler=ignore)
    sent += 1
    due_s += 1 / 2000
    time.sleep(max(0, due_s - time.monotonic()))
    if sent % 1000 == 0:
        print(sent, flush=True)
"""


@pytest.mark.parametrize("answer", [DEEP, WIDE, LONG], ids=["deep", "wide", "long"])
def test_an_answer_that_is_too_deep_or_too_long_is_no_answer(net, answer, monkeypatch):
    monkeypatch.setattr(reconnect_module, "HELLO_TIMEOUT_S", 0.5)
    with session(net.hub) as hostile:
        hostile.declare_queryable("spots/x/info", lambda q: q.reply(q.key_expr, answer))
        with (
            hostile.liveliness().declare_token("spots/x/alive"),
            pytest.raises(SpotsError, match="does not answer 'hello'"),
        ):
            spots.open("zenoh:x")


@pytest.mark.parametrize("error", [b"\xff\xfe", b"x" * 1_000_000], ids=["no text", "long"])
def test_an_error_that_is_no_text_is_one_sentence(net, error, monkeypatch):
    monkeypatch.setattr(reconnect_module, "HELLO_TIMEOUT_S", 0.5)
    with session(net.hub) as hostile:
        hostile.declare_queryable("spots/x/info", lambda q: q.reply_err(error))
        with (
            hostile.liveliness().declare_token("spots/x/alive"),
            pytest.raises(SpotsError) as told,
        ):
            spots.open("zenoh:x")
    assert len(str(told.value)) < 1000


def test_thousands_of_boards_are_one_short_sentence(net):
    with session(net.hub) as hostile:
        tokens = [hostile.liveliness().declare_token(f"spots/b{i}/alive") for i in range(2000)]
        with pytest.raises(SpotsError, match="more than one board") as told:
            spots.open("zenoh:")
        assert len(str(told.value)) < 1000
        del tokens


def test_messages_that_nobody_reads_take_bounded_memory():
    for size in (0, 1, 100, mailbox.MESSAGE_BYTES_MAX):
        tracemalloc.start()
        mail = mailbox.Mailbox()
        for i in range(50_000 if size < 1000 else 50):
            mail.put(f"spots/b{i:06}/0/touch", bytes(size))
        grown, _ = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert mail.dropped > 0
        assert grown < 1.5 * mailbox.WAITING_BYTES_MAX


def test_a_message_longer_than_any_of_a_publisher_is_dropped():
    mail = mailbox.Mailbox()
    mail.put("small", b"1")
    mail.put("huge", bytes(mailbox.MESSAGE_BYTES_MAX + 1))
    assert (mail.dropped, mail.take()) == (1, ("small", b"1"))
    assert not mail


def test_names_of_boards_are_forgotten_the_least_recently_used_first(monkeypatch):
    now_s = 0.0
    monkeypatch.setattr(subscribe.time, "monotonic", lambda: now_s)
    lines = subscribe._Lines()
    content = {"utc_s": 0.0, "flags": 1}
    assert lines.written("spots/mine/0/spectrum", content)
    tracemalloc.start()
    for i in range(20_000):
        lines.written(f"spots/{i}/0/spectrum", content)
        assert not lines.written("spots/mine/0/spectrum", content)  # a name in use stays stored
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown < 200_000


def test_a_reader_whose_output_is_blocked_does_not_grow(net):
    reader = subprocess.Popen(
        [sys.executable, "-m", "spots", "subscribe", "spots/**", "--json"]
        + ["--zenoh-config", str(net.leaf)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    with session(net.hub) as hostile:
        while b"probe" not in (hostile.put("spots/a/probe", b'{"a":1}'), _line(reader))[1]:
            pass
        _publish_names(hostile, 5_000)
        before = _rss(reader.pid)
        _publish_names(hostile, 200_000)
        grown = _rss(reader.pid) - before
        assert reader.poll() is None
        reader.kill()
        reader.communicate()
    assert grown < 16 << 20


def _line(process):
    import select

    ready, _, _ = select.select([process.stdout], [], [], 0.1)
    return process.stdout.readline() if ready else b""


def _publish_names(hostile, count):
    for i in range(count):
        hostile.put(f"spots/b{i}/0/touch", b"{}", congestion_control=zenoh.CongestionControl.BLOCK)


def _rss(pid):
    with open(f"/proc/{pid}/statm") as statm:
        return int(statm.read().split()[1]) * 4096


def test_a_flood_of_questions_costs_no_reading(net):
    # test_answers.py limits the time for the replies, in simulated time.
    with publishing(net.hub, stand_in()), session(net.leaf) as other:
        wait_until(lambda: list(other.get("spots/a1/info")))
        flood = subprocess.Popen(
            [sys.executable, "-c", FLOOD, str(net.leaf), "a1"], stdout=subprocess.PIPE
        )
        try:
            heard = []
            touches = other.declare_subscriber(
                "spots/a1/0/touch", lambda s: heard.append(json.loads(bytes(s.payload))["sequence"])
            )
            for _ in range(3):
                assert flood.stdout.readline()
            wait_until(lambda: len(heard) > 200)
            touches.undeclare()
        finally:
            flood.kill()
            flood.communicate()
    # Between two readings, a spectrum and replies to queries also take sequence numbers.
    assert {b - a for a, b in pairwise(heard)} <= {2, 3, 4, 5}


def test_questions_under_a_flood_are_answered_with_what_the_board_replied(net):
    link = stand_in()
    with publishing(net.hub, link), session(net.leaf) as other:
        wait_until(lambda: list(other.get("spots/a1/info")))
        asked = len(link.said)
        # All queries at the same time, because a publisher pauses between two rounds of replies.
        waiting = [other.get("spots/a1/get", timeout=DEADLINE_S) for _ in range(200)]
        for (reply,) in waiting:
            assert json.loads(bytes(reply.ok.payload))["gain"] == 9
        said = link.said[asked:]
        assert 1 <= said.count("get") < 100
        assert said.count("hello") == 0


def test_a_question_with_a_payload_is_not_answered(net):
    with publishing(net.hub, stand_in()), session(net.leaf) as other:
        wait_until(lambda: list(other.get("spots/a1/info")))
        for extra in ({"payload": b"x"}, {"attachment": b"x"}):
            assert list(other.get("spots/a1/info", timeout=DEADLINE_S, **extra)) == []
        assert list(other.get("spots/a1/info?" + "x" * 5000)) == []
