"""Who may connect to what `spots publish` opens, and what a client that never reads costs."""

import asyncio
import errno
import re
import socket
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest
from support.net import stand_in, wait_until
from support.refusals import refusal

from spots import Board
from spots.common import reports
from spots.errors import SettingError
from spots.link.frames import Touch
from spots_net import outlet, to_foxglove
from spots_net.sending import host_and_port

ROOT = Path(__file__).parents[2]
TOUCH = Touch(0, 7, 5000, 9, 1 << 20, 3 << 20, 42_000, 1500, 1.25)
OWN = "http://127.0.0.1:{port}"
UPGRADE = (
    "GET / HTTP/1.1\r\nConnection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\nSec-WebSocket-Protocol: foxglove.sdk.v1\r\n"
)


@pytest.fixture
def foxglove():
    with Board(stand_in()) as board:
        named = {"origins": ("http://192.168.1.7:8080",)}
        made = outlet.maker("foxglove=127.0.0.1:0", **named)(board)
        made.port = int(made.place.rpartition(":")[2])
        yield made
        made.close()


def connected(made, *headers):
    """Return a connection that has asked for a WebSocket, and the status of the answer."""
    one = socket.create_connection(("127.0.0.1", made.port), 60)
    lines = "".join(header.format(port=made.port) + "\r\n" for header in headers)
    one.sendall((UPGRADE + lines + "\r\n").encode())
    return one, int(one.recv(4096).split()[1])


@pytest.mark.parametrize(
    ("headers", "status"),
    [
        (["Host: 127.0.0.1:{port}"], 101),  # a program, such as the desktop application
        (["Host: localhost:{port}"], 101),
        (["Host: 127.0.0.1:{port}", f"Origin: {OWN}"], 101),
        (["Host: 127.0.0.1:{port}", "Origin: https://app.foxglove.dev"], 101),
        (["Host: 127.0.0.1:{port}", "Origin: http://192.168.1.7:8080"], 101),  # allowed by name
        (["Host: 127.0.0.1:{port}", "Origin: http://127.0.0.1:1"], 403),
        (["Host: 127.0.0.1:{port}", "Origin: https://evil.example"], 403),
        (["Host: 127.0.0.1:{port}", "Origin: https://app.foxglove.dev.evil.example"], 403),
        (["Host: 127.0.0.1:{port}", "Origin: null"], 403),
        (["Host: 127.0.0.1:{port}", f"Origin: {OWN}", "Origin: https://evil.example"], 403),
        (["Host: evil.example:{port}"], 403),  # DNS rebinding
        (["Host: evil.example:{port}", "Origin: http://evil.example:{port}"], 403),
    ],
)
def test_foxglove_knows_its_host_and_the_pages_that_may_read(foxglove, headers, status):
    one, got = connected(foxglove, *headers)
    one.close()
    assert got == status


def test_foxglove_on_a_network_answers_programs_and_its_own_pages():
    # An IP address as host is safe from DNS rebinding; a name is not.
    with Board(stand_in()) as board:
        made = outlet.maker("foxglove=0.0.0.0:0")(board)
        made.port = int(made.place.rpartition(":")[2])
        asked = ("192.168.1.20", "", 101), ("evil.example", "", 403), ("192.168.1.20", "x", 403)
        for host, origin, status in asked:
            headers = [f"Host: {host}:1"] + ["Origin: https://evil.example"] * bool(origin)
            one, got = connected(made, *headers)
            one.close()
            assert got == status, (host, origin)
        made.close()


@pytest.mark.board
def test_clients_that_never_read_take_bounded_memory_and_leave_nothing(foxglove):
    subscribe = b'{"op":"subscribe","subscriptions":[{"id":1,"channelId":1}]}'
    frame = bytes((0x81, 0x80 | len(subscribe), 0, 0, 0, 0)) + subscribe
    opened = [connected(foxglove, "Host: 127.0.0.1:{port}") for _ in range(40)]
    statuses = [status for _, status in opened]
    assert statuses.count(101) == to_foxglove._CLIENTS_MAX
    assert statuses.count(503) == 40 - to_foxglove._CLIENTS_MAX
    for one, status in opened:
        if status == 101:
            one.sendall(frame)
    wait_until(lambda: all(client._subscriptions for client in foxglove._clients))
    for _ in range(40 * to_foxglove._WAITING_MAX):
        foxglove.put(TOUCH, 1e9)
    done = threading.Event()
    foxglove._loop.call_soon_threadsafe(done.set)
    assert done.wait(60)
    assert {len(client._waiting) for client in foxglove._clients} <= {
        *range(to_foxglove._WAITING_MAX + 1)
    }
    for one, _ in opened:
        one.close()
    wait_until(lambda: not foxglove._clients)
    wait_until(lambda: not foxglove._connections._ends)


@pytest.mark.parametrize(
    ("address", "found"),
    [
        ("", ("127.0.0.1", 9000)),
        ("192.168.1.7", ("192.168.1.7", 9000)),
        ("192.168.1.255:7000", ("192.168.1.255", 7000)),
        ("[::1]:7000", ("::1", 7000)),
        ("[fe80::1%eth0]", ("fe80::1%eth0", 9000)),
        ("studio.local:7000", ("studio.local", 7000)),
        ("bühne.example", ("bühne.example", 9000)),
        *[
            (wrong, None)
            for wrong in (
                "::1:9000", "::1", ":0", ":9000", ":", "[::1", "[]:1", "[127.0.0.1]:1", "host:0",
                "host:65536", "host:1:2", "host:", "host:x", "192.168.1..7:9000", "a" * 300,
                ".".join(["a"] * 200), "a b:1", "http://host:1", "host:\u0661",
            )
        ],
    ],
)  # fmt: skip
def test_an_address_is_one_or_is_refused(address, found):
    if found:
        assert host_and_port(address, ("127.0.0.1", 9000), "OSC") == found
    else:
        with refusal(SettingError) as raised:
            host_and_port(address, ("127.0.0.1", 9000), "OSC")
        assert len(str(raised.value)) < 200


def test_osc_goes_to_all_of_a_network_and_says_why_it_does_not(capsys, monkeypatch):
    monkeypatch.setattr(reports.REPORTS, "_due_s", {})
    board = SimpleNamespace()
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("", 0))
        receiver.settimeout(60)
        port = receiver.getsockname()[1]
        for settings, tag in (({}, True), ({"time_tags": True}, False)):
            made = outlet.maker(f"osc=127.255.255.255:{port}", **settings)(board)
            made.put(TOUCH, 1e9)
            data = receiver.recv(1000)
            assert data.startswith(b"#bundle\0")
            assert (data[8:16] == bytes(7) + b"\1") == tag  # immediately

    def fail(bundle):
        raise OSError(errno.ENETUNREACH, "Network is unreachable")

    monkeypatch.setattr(made._client, "send", fail)
    for _ in range(3):
        made.put(TOUCH, 1e9)
    said = capsys.readouterr().err
    assert said.count("Network is unreachable") == 1
    assert f"127.255.255.255:{port}" in said


def test_at_the_limit_of_open_files_there_is_one_line(capsys, monkeypatch):
    monkeypatch.setattr(reports.REPORTS, "_due_s", {})
    loop = asyncio.new_event_loop()
    loop.set_exception_handler(reports.on_loop_error)
    for _ in range(1000):
        error = OSError(errno.EMFILE, "Too many open files")
        loop.call_exception_handler({"message": "socket.accept()", "exception": error})
    loop.close()
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "ulimit -n" in said


def test_each_door_of_the_security_page_names_a_test_that_exists():
    page = (ROOT / "docs/operate/security/overview.md").read_text()
    table = page.partition("## What listens")[2].partition("\n## ")[0]
    rows = re.findall(r"^\| .* \|$", table, re.M)[2:]
    assert len(rows) > 8
    for row in rows:
        (path, name) = re.search(r"`(tests/\S+\.py)`, `(test_\w+)`", row).groups()
        assert f"def {name}(" in (ROOT / path).read_text(), row
