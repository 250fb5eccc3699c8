"""Hostile Zenoh peers: they send messages that no SPOTS program sends."""

from __future__ import annotations

import contextlib
import json
import subprocess
import sys
import tracemalloc
from itertools import pairwise

import pytest
import zenoh
from support.net import (
    DEADLINE_S,
    REQUEST,
    Announced,
    ask,
    content,
    frames,
    message,
    publishing,
    service_key,
    session,
    stand_in,
    tokens,
    topic_key,
    wait_until,
)
from support.refusals import refusal

import spots
from spots import SpotsError
from spots.errors import PortError
from spots.link import reconnect as reconnect_module
from spots_net import mailbox, subscribe
from spots_net.ros2.messages import Strip, frame_message, messages, types
from spots_net.ros2.naming import gid_of
from spots_net.ros2.types import packed

DEEP = '{"a":' * 50_000 + "1" + "}" * 50_000
WIDE = json.dumps({"a": [[]] * 200})
LONG = json.dumps({"a": "x" * 100_000})
NO_CDR = (
    b"",
    b"\0",
    b"\xff" * 700,
    b"\0\1\0\0" + b"\xff" * 60,
    b"\0\1\0\0\1\0\0\0\xff\xff\xff\x7f",
)

FLOOD = """
import sys, time, zenoh
session = zenoh.open(zenoh.Config.from_file(sys.argv[1]))
keys, mark = sys.argv[2:5], bytes.fromhex(sys.argv[5])
ignore = zenoh.handlers.Callback(lambda reply: None, indirect=False)
sent, due_s = 0, time.monotonic()
while True:
    session.get(keys[sent % 3], handler=ignore, payload=b"\\0\\1\\0\\0\\0", attachment=mark)
    sent += 1
    due_s += 1 / 2000
    time.sleep(max(0, due_s - time.monotonic()))
    if sent % 1000 == 0:
        print(sent, flush=True)
"""


@pytest.mark.parametrize("answer", [DEEP, WIDE, LONG], ids=["deep", "wide", "long"])
def test_an_answer_that_is_too_deep_or_too_long_is_no_answer(net, answer, monkeypatch):
    monkeypatch.setattr(reconnect_module, "HELLO_TIMEOUT_S", 0.5)
    with session(net.hub) as hostile, Announced(hostile, "x") as announced:
        announced.replies("hello", answer)
        with refusal(PortError):
            spots.open("zenoh:x")


@pytest.mark.parametrize("data", [*NO_CDR, b"\0\1\0\0\1" + b"x" * 1_000_000], ids="abcdef")
def test_a_response_that_is_no_message_is_no_answer(net, data, monkeypatch):
    monkeypatch.setattr(reconnect_module, "HELLO_TIMEOUT_S", 0.5)
    with session(net.hub) as hostile, Announced(hostile, "x") as announced:
        announced.replies_cdr("hello", data)
        with refusal(PortError):
            spots.open("zenoh:x")


@pytest.mark.parametrize("error", ["\x1b[2J", "x" * 1_000_000], ids=["control", "long"])
def test_an_error_of_a_foreign_service_is_one_sentence(net, error, monkeypatch):
    monkeypatch.setattr(reconnect_module, "HELLO_TIMEOUT_S", 0.5)
    with session(net.hub) as hostile, Announced(hostile, "x") as announced:
        announced.replies("hello", json.dumps({"error": error}), success=False)
        with pytest.raises(SpotsError) as told:
            spots.open("zenoh:x")
    assert len(str(told.value)) < 1000


def test_an_error_of_zenoh_is_no_answer(net, monkeypatch):
    monkeypatch.setattr(reconnect_module, "HELLO_TIMEOUT_S", 0.5)
    with session(net.hub) as hostile, Announced(hostile, "x"):
        hostile.declare_queryable(
            service_key("x", "hello"), lambda q: q.reply_err(b"\xff" * 1_000_000), complete=True
        )
        with refusal(PortError):
            spots.open("zenoh:x")


def test_a_spoofed_service_beside_the_true_one_changes_nothing(net):
    with (
        session(net.leaf) as hostile,
        publishing(net.hub, stand_in()),
        spots.open("zenoh:a1") as board,
    ):
        foreign = Announced(hostile, "a1")
        for command in ("hello", "get", "sync"):
            foreign.replies_cdr(command, b"\xff" * 50)
        wait_until(lambda: len(list(ask(hostile, "a1", "get"))) == 2)
        for _ in range(5):
            assert board.command("get", DEADLINE_S)["gain"] == 9
        assert next(board.touches()).force_mN == 3000


def test_frames_of_a_peer_without_a_token_or_without_form_change_nothing(net):
    with (
        session(net.leaf) as hostile,
        publishing(net.hub, stand_in()),
        spots.open("zenoh:a1") as board,
    ):
        touches = board.touches()
        next(touches)
        foreign = Announced(hostile, "a1")  # without a token
        place = frames("a1").key(0)
        (true,) = hostile.liveliness().get(tokens("a1"))
        gid = gid_of(str(true.ok.key_expr))
        whole_frame = packed(frame_message(b"wrong\0", 7))
        for _ in range(20):
            foreign.put(whole_frame)
            for data in NO_CDR:
                foreign.put(data, gid)
            for mark in (b"", b"x", b"\xff" * 33, b"\xff" * 100_000):
                hostile.put(place, whole_frame, attachment=mark)
            hostile.put(place, whole_frame)
            foreign.put(b"\0\1\0\0" + b"x" * 2_000_000, gid)
            next(touches)
        wait_until(lambda: next(touches).sequence > 100)
        stats = board.stats
        assert (stats.restarts, stats.bad_crc, stats.lost) == (0, 0, 0)


@pytest.mark.board
def test_thousands_of_boards_are_one_short_sentence(net):
    with session(net.hub) as hostile, contextlib.ExitStack() as stack:
        for i in range(2000):
            stack.enter_context(Announced(hostile, f"b{i}"))
        with refusal(PortError) as told:
            spots.open("zenoh:")
        assert len(str(told.value)) < 1000


@pytest.mark.board
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


@pytest.mark.board
def test_names_of_boards_are_forgotten_the_least_recently_used_first(monkeypatch):
    now_s = 0.0
    monkeypatch.setattr(subscribe.time, "monotonic", lambda: now_s)
    lines = subscribe._Lines()
    strip = Strip("", [], 0, (0,) * 6)
    values = dict.fromkeys(("sequence", "t_us", "flags", "gain_code"), 1) | {"counts": (1,) * 6}
    ((_, spectrum),) = messages("spectrum", values, 0.0, 0.0, strip)
    kind = types()["spectrum"]
    assert lines.written("/mine/strip0/spectrum", kind, spectrum)
    tracemalloc.start()
    for i in range(20_000):
        lines.written(f"/{i}/strip0/spectrum", kind, spectrum)
        # A name in use stays stored.
        assert not lines.written("/mine/strip0/spectrum", kind, spectrum)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown < 300_000


@pytest.mark.board
def test_a_reader_whose_output_is_blocked_does_not_grow(net):
    reader = subprocess.Popen(
        [sys.executable, "-m", "spots", "subscribe", "/**", "--json"]
        + ["--zenoh-config", str(net.leaf)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    with session(net.hub) as hostile:
        probe = topic_key("probe", "key"), _pressed()
        while b"probe" not in (hostile.put(*probe), _line(reader))[1]:
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


def _pressed():
    names = "sequence", "t_us", "page", "usage", "modifiers", "pressed"
    ((_, key),) = messages("key", dict.fromkeys(names, 1), 1.0, 0.0, Strip("", [], 0, (0,) * 6))
    return packed(key)


def _publish_names(hostile, count):
    place, data = topic_key("b0", "key"), _pressed()
    for i in range(count):
        hostile.put(
            place.replace("b0", f"b{i}"), data, congestion_control=zenoh.CongestionControl.BLOCK
        )


def _rss(pid):
    with open(f"/proc/{pid}/statm") as statm:
        return int(statm.read().split()[1]) * 4096


@pytest.mark.board
def test_a_flood_of_questions_costs_no_reading(net):
    # test_answers.py limits the time for the replies, in simulated time.
    with publishing(net.hub, stand_in()), session(net.leaf) as other:
        wait_until(lambda: list(ask(other, "a1", "hello")))
        keys = [service_key("a1", command) for command in ("hello", "get", "sync")]
        mark = REQUEST["attachment"].hex()
        flood = subprocess.Popen(
            [sys.executable, "-c", FLOOD, str(net.leaf), *keys, mark], stdout=subprocess.PIPE
        )
        try:
            heard = []
            touches = other.declare_subscriber(
                topic_key("a1", "reading"), lambda s: heard.append(message(s, "reading").sequence)
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
        wait_until(lambda: list(ask(other, "a1", "hello")))
        asked = len(link.said)
        # All queries at the same time, because a publisher pauses between two rounds of replies.
        waiting = [ask(other, "a1", "get", timeout=DEADLINE_S) for _ in range(200)]
        for (reply,) in waiting:
            assert content(reply)["gain"] == 9
        said = link.said[asked:]
        assert 1 <= said.count("get") < 100
        assert said.count("hello") == 0


def test_a_question_that_no_client_of_ros_sends_is_not_answered(net):
    with publishing(net.hub, stand_in()), session(net.leaf) as other:
        wait_until(lambda: list(ask(other, "a1", "hello")))
        for extra in (
            {"payload": None},
            {"payload": b"x" * 1000},
            {"attachment": None},
            {"attachment": b"x" * 33},
            {"attachment": REQUEST["attachment"] + b"x"},
        ):
            assert list(ask(other, "a1", "hello", timeout=DEADLINE_S, **extra)) == []
        assert list(other.get(service_key("a1", "hello") + "?" + "x" * 5000, **REQUEST)) == []
