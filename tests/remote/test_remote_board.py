"""Boards over Zenoh: read like local boards, reconnected, but without commands that change them."""

import json
import socket
import threading
from itertools import islice
from types import SimpleNamespace

import pytest
from bench.standin import StandIn
from support.boards import refused
from support.net import (
    DEADLINE_S,
    REQUEST,
    Announced,
    Restarting,
    ask,
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
from spots import Board, Key, Spectrum, SpotsError, Touch
from spots.cli import main
from spots.errors import BoardError, CalibrationError, PortError, PortLostError
from spots.link import reconnect as reconnect_module
from spots_device import PROTOCOL
from spots_device.board.settings import checksum
from spots_linkage.twin_source import give
from spots_net import mailbox
from spots_net import publish as publish_module
from spots_net import zenoh_session as session_module
from spots_net.answers import Answers
from spots_net.publish import Publisher
from spots_net.zenoh_link import ZenohLink

READ_ONLY = {"hello", "get", "sync", "stream contact touch spectrum"}
HOSTILE = ("set gain=3", "set keys=1", "save", "reboot", "cal clear", "stream2", "layout clear")


def take(board, count):
    return list(islice(board.frames(), count))


def test_a_late_joiner_reads_all_from_then_on(net):
    link = stand_in()
    with publishing(net.hub, link):
        wait_until(lambda: link._port.count > 50)
        with spots.open("zenoh:") as board:
            assert board.port == "zenoh:a1"
            assert board.info["board"] == "stand-in"
            touches = list(islice(board.touches(), 100))
            frames = take(board, 100)
            latest = board.read_latest()
    assert touches[0].sequence > 50
    steps = [b.sequence - a.sequence for a, b in zip(touches, touches[1:])]
    assert set(steps) <= {2, 3, 4}  # spectra, and replies to the publisher, are in between
    assert steps.count(2) > 90
    assert {type(frame) for frame in frames} == {Touch, Spectrum}
    assert (touches[0].position_um, touches[0].force_mN) == (42_500, 3_000)
    assert latest.sequence > frames[-1].sequence
    assert board.stats.lost == board.stats.bad_crc == board.stats.restarts == 0
    # The clock of the substitute board is the monotonic clock of this machine.
    for touch in touches:
        error_s = touch.time_s % (2**32 / 1e6) - touch.t_us / 1e6
        assert abs(error_s) <= board.channel.clocks.clock.uncertainty_s + 2e-6


class Typing(StandIn):
    def _send_reading(self):
        super()._send_reading()
        self._framer.key(0, 7, 30, 2, True)


def test_keys_go_out_as_frames_and_as_samples(net):
    with session(net.leaf) as other, publishing(net.hub, stand_in(kind=Typing)):
        heard = []
        keys = other.declare_subscriber(topic_key("a1", "key"), heard.append)
        with spots.open("zenoh:a1") as board:
            board.command("stream touch")
            (key,) = (frame for frame in take(board, 3) if isinstance(frame, Key))
        wait_until(lambda: heard)
        keys.undeclare()
    assert (key.page, key.usage, key.modifiers, key.pressed) == (7, 30, 2, True)
    told = message(heard[0], "key")
    assert (told.page, told.usage, told.modifiers, told.pressed) == (7, 30, 2, True)


def test_of_several_boards_one_is_named(net):
    with publishing(net.hub, stand_in("a1"), stand_in("b2")):
        with refusal(PortError):
            spots.open("zenoh:")
        with spots.open("zenoh:b2") as board:
            assert board.info["id"] == "b2"


@pytest.mark.board
def test_no_command_that_could_change_anything_is_taken(net):
    link = stand_in()
    with publishing(net.hub, link), spots.open("zenoh:a1") as board, session(net.leaf) as hostile:
        wait_until(lambda: list(ask(hostile, "a1", "hello")))
        for line in HOSTILE:
            with refusal(BoardError, why="not_here"):
                board.command(line)
            name = line.split()[0]
            for command in (name, "command", "hello", "get", "sync"):
                place = service_key("a1", command)
                list(hostile.get(f"{place}?{name}=1", **REQUEST))
                list(hostile.get(place, **{**REQUEST, "payload": line}))
                hostile.put(place, line)
            hostile.put(frames("a1").key(0), line)
        assert board.command("get")["gain"] == 9
    assert set(link.said) == READ_ONLY


def test_a_hello_to_a_second_strip_is_refused_as_a_command(net):
    with (
        publishing(net.hub, stand_in()),
        spots.open("zenoh:") as board,
        refusal(BoardError, why="no_sensor"),
    ):
        board.command("hello sensor=1")


class Refusing(StandIn):
    busy = False

    def _reply(self, name, *words):
        if name == "get" and self.busy:
            return {"re": name, "error": "an earlier command still runs", "why": "busy"}
        return super()._reply(name, *words)


def test_a_refusal_has_its_code_on_another_machine(net):
    link = stand_in(kind=Refusing)
    with publishing(net.hub, link), spots.open("zenoh:a1") as board:
        link.busy = True
        with refusal(BoardError, why="busy") as refused:
            board.command("get")
        assert "an earlier command still runs" in str(refused.value)


def test_streaming_is_what_the_reader_says(net):
    with publishing(net.hub, stand_in()), spots.open("zenoh:a1") as board:
        assert board.command("sync")["stream"] == []
        assert board.command("stream touch")["stream"] == ["touch"]
        take(board, 20)
        assert board.command("sync")["stream"] == ["touch"]
        board.command("stream off")
        list(board.frames(0.1))  # frames that were sent before the command
        assert list(board.frames(0.1)) == []
        board.command("stream contact touch spectrum")
        take(board, 20)
        assert board.stats.lost == 0  # frames while no stream was requested do not count as lost
        with refusal(BoardError, why="bad_value"):
            board.command("stream everything")


def test_a_board_that_restarts_behind_its_publisher(net):
    link = stand_in(kind=Restarting)
    with publishing(net.hub, link), spots.open("zenoh:a1") as board:
        touches = board.touches()
        before = list(islice(touches, 100))[-1]
        link.restarting = True
        after = next(touch for touch in touches if touch.sequence < before.sequence)
        wait_until(lambda: next(touches).sequence > after.sequence + 50)
        assert board.stats.restarts == 1
        assert board.stats.lost == 0
        assert after.time_s > before.time_s


def test_a_publisher_that_is_gone_is_a_lost_port_and_may_come_back(net):
    with spots_open_while(net) as (board, publisher_ends):
        touches = board.touches()
        next(touches)
        publisher_ends()
        threading.Timer(0.3, publisher_ends.again).start()
        wait_until(lambda: next(touches) and board.stats.restarts == 1)
        assert board.stats.lost == 0


def test_a_publisher_that_stays_away_ends_the_reading(net, monkeypatch):
    monkeypatch.setattr(reconnect_module, "PATIENCE_S", 0.3)
    with spots_open_while(net) as (board, publisher_ends):
        touches = board.touches()
        next(touches)
        publisher_ends()
        with refusal(PortError):
            list(touches)


class spots_open_while:  # noqa: N801
    """A context with a reader, and a publisher that the test can end and restart."""

    def __init__(self, net):
        self._net = net
        self.again()

    def again(self):
        self._publishing = publishing(self._net.hub, stand_in())
        self._publishing.__enter__()

    def __call__(self):
        self._publishing.__exit__(None, None, None)
        self._publishing = None

    def __enter__(self):
        self._board = spots.open("zenoh:a1")
        return self._board, self

    def __exit__(self, *exception):
        self._board.close()
        if self._publishing:
            self()


def test_without_streaming_the_loss_is_told_at_once(net):
    with spots_open_while(net) as (board, publisher_ends):
        board.command("stream off")
        publisher_ends()
        with refusal(PortLostError):
            list(board.frames(30))


@pytest.mark.board
def test_a_reader_that_is_too_slow_counts_what_it_missed(net, monkeypatch):
    monkeypatch.setattr(mailbox, "WAITING_BYTES_MAX", 2000)
    link = stand_in(rate_Hz=1000)
    with publishing(net.hub, link), spots.open("zenoh:a1") as board:
        board.command("stream contact touch spectrum")
        arriving = board.frames()
        first = next(arriving)
        count = link._port.count
        wait_until(lambda: link._port.count > count + 500)
        assert board._link._mail._bytes <= 2000
        frames = [first, *islice(arriving, 300)]
        assert board.stats.lost > 0
        gaps = sum(b.sequence - a.sequence - 1 for a, b in zip(frames, frames[1:]))
        assert frames[-1].sequence - first.sequence + 1 == len(frames) + gaps
        while arriving.unread:
            next(arriving)
        assert board.stats.lost >= gaps - 2 > 0  # replies to the publisher have numbers, too


def test_recording_a_board_from_afar(net, tmp_path):
    path = tmp_path / "far.spots"
    with publishing(net.hub, stand_in()):
        assert main(["record", str(path), "--port", "zenoh:", "--seconds", "0.3"]) == 0
    with spots.open_recording(path, float("inf")) as recording:
        assert sum(1 for _ in recording.touches()) > 5
    with (
        session(net.hub) as own,
        refusal(PortError),
    ):
        Publisher(spots.open(f"recording:{path}"), session=own)


def test_a_question_that_gets_lost_is_asked_again(net, monkeypatch):
    answers, real = [], ZenohLink.ask

    def ask(link, command, timeout_s):
        if command != "sync":
            return real(link, command, timeout_s)
        answers.append(len(answers) % 2 or None)
        return answers[-1] and real(link, command, timeout_s)

    monkeypatch.setattr(ZenohLink, "ask", ask)
    with publishing(net.hub, stand_in()), spots.open("zenoh:a1") as board:
        assert next(board.touches()).force_mN == 3000
    assert answers.count(None) > 5


def test_a_hello_that_is_not_answered_in_time_is_asked_again(net, monkeypatch):
    kept, note, ask = [], Answers._note, ZenohLink.ask

    def late(answers, command, query):
        if command == "hello" and not kept:
            kept.append(query)
        else:
            note(answers, command, query)

    def patient(link, command, timeout_s):
        return ask(link, command, DEADLINE_S if kept else 0.5)

    monkeypatch.setattr(Answers, "_note", late)
    monkeypatch.setattr(ZenohLink, "ask", patient)
    with publishing(net.hub, stand_in()), spots.open("zenoh:a1") as board:
        assert kept
        assert board.info["id"] == "a1"


def test_a_linkage_from_afar_needs_boards_that_hold_its_calibration(net, calibration):
    strip = SimpleNamespace(lines=calibration, board="a1")
    with publishing(net.hub, stand_in()), spots.open("zenoh:a1") as board:
        with refusal(CalibrationError):
            give(board, strip, 1)
        hello = board.command("hello") | {"calibration": checksum(calibration)}
        board.command = lambda line: hello
        give(board, strip, 1)


def test_a_board_is_published_once(net):
    with publishing(net.hub, stand_in()), session(net.leaf) as own:
        wait_until(lambda: list(own.liveliness().get(tokens("a1"))))
        with refusal(PortError):
            Publisher(Board(stand_in()), session=own)


@pytest.mark.parametrize("board_id", [None, "", "a/b", "a*"])
def test_a_board_without_a_proper_id_is_not_published(net, board_id):
    with session(net.hub) as own, refusal(BoardError, why="no_id"):
        Publisher(Board(stand_in(board_id)), session=own)


@pytest.mark.board
def test_a_board_that_its_publisher_lost_is_asked_until_it_is_back(net, monkeypatch):
    link = stand_in(kind=Restarting)
    refusals = []

    class Refusing(Answers):
        def _reply(self, command):
            if refusals:
                refusals.pop()
                raise SpotsError(f"no {command}")
            return super()._reply(command)

    monkeypatch.setattr(publish_module, "Answers", Refusing)
    with publishing(net.hub, link), spots.open("zenoh:a1") as board:
        touches = board.touches()
        next(touches)
        refusals += range(10)
        link.restarting = True
        wait_until(lambda: next(touches) and board.stats.restarts >= 1 and not refusals)
        assert next(touches).force_mN == 3000


@pytest.mark.parametrize(
    ("answer", "told"),
    [
        ("nonsense", "does not answer 'hello'"),
        ("[1, 2]", "does not answer 'hello'"),
        (json.dumps({"protocol": 99}), "has protocol 99"),
        (json.dumps({"protocol": PROTOCOL}), "no reply to 'sync'"),
        (None, "does not answer 'hello'"),
    ],
)
def test_a_publisher_that_is_none_of_ours(net, answer, told, monkeypatch):
    monkeypatch.setattr(reconnect_module, "HELLO_TIMEOUT_S", 0.5)
    with session(net.hub) as hostile, Announced(hostile, "x") as announced:
        if answer is not None:
            for name in ("hello", "sync"):
                announced.replies(name, answer)
        with pytest.raises(SpotsError, match=told):
            spots.open("zenoh:x")


def test_mistakes_are_one_sentence(net, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(session_module, "_PATIENCE_S", 0.1)
    bad = tmp_path / "bad.json5"
    bad.write_text("{ mode: 'everywhere' }")
    taken = tmp_path / "taken.json5"
    for arguments, told in {
        ("monitor", "--port", "zenoh:"): "no board is published on Zenoh: run 'spots publish'",
        ("monitor", "--port", "zenoh:a1"): "no board a1 is published on Zenoh",
        ("monitor", "--port", "zenoh://a1"): "'//a1' is not a board's id",
        ("monitor", "--port", "zenoh:a1/"): "'a1/' is not a board's id",
        ("subscribe", "//"): "'//' is not a topic of ROS 2",
        (
            "subscribe",
            "--zenoh-config",
            "nowhere",
        ): "configuration nowhere, because there is no such file",
        (
            "subscribe",
            "--zenoh-config",
            str(tmp_path),
        ): f"{tmp_path} is a folder, not a Zenoh config",
        ("subscribe", "--zenoh-config", str(bad)): "is not a Zenoh configuration",
    }.items():
        monkeypatch.setenv("ZENOH_CONFIG", str(net.leaf))
        assert told in refused(capsys, *arguments)
    with socket.create_server(("127.0.0.1", 0)) as server:
        place = f"tcp/127.0.0.1:{server.getsockname()[1]}"
        taken.write_text(json.dumps({"listen": {"endpoints": [place]}}))
        assert "Zenoh does not start with" in refused(
            capsys, "subscribe", "--zenoh-config", str(taken)
        )


def test_more_than_may_wait_is_dropped_and_counted(monkeypatch):
    monkeypatch.setattr(mailbox, "WAITING_BYTES_MAX", 2 * mailbox._size((0, b"1234")))
    mail = mailbox.Mailbox()
    for i in range(5):
        mail.put(i, b"1234")
    assert mail.dropped == 3
    assert [mail.take()[0] for _ in range(len(mail))] == [3, 4]
    mail.put(5, bytes(1000))
    assert len(mail) == 0
    assert mail.dropped == 4
