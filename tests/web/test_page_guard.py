"""Access control of the web UI: who can open it, and who can send commands."""

from __future__ import annotations

import re
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import aiohttp
import pytest
from playwright.sync_api import expect
from support.serving import Serving, apart, run
from yarl import URL

from spots.cli import main
from spots.errors import SpotsError
from spots.keyboard.layout import FOLDER as LAYOUTS
from spots_sim.strip.scenario import Held
from spots_web import app
from spots_web.serve import _announced
from spots_web.state import PageState

LONG_MS = 60_000
STATIC = Path(app.__file__).parent / "static"


def status(url, path="", **headers):
    """Send a GET request; return the HTTP status, the headers and the text of the answer."""

    async def ask():
        async with (
            aiohttp.ClientSession() as session,
            session.get(
                URL(url + path, encoded=True), headers=headers, allow_redirects=False
            ) as answer,
        ):
            return answer.status, answer.headers, await answer.text()

    return run(ask())


UPGRADE = {
    "Connection": "Upgrade",
    "Upgrade": "websocket",
    "Sec-WebSocket-Version": "13",
    "Sec-WebSocket-Key": "MDEyMzQ1Njc4OWFiY2RlZg==",
}


@pytest.mark.parametrize("path", ["", "live", "static/main.js", "nowhere"])
@pytest.mark.parametrize(
    "host",
    [
        "evil.example",
        "evil.example:8765",
        "127.0.0.1.evil.example",
        "192.168.1.9",
        "[",
        "localhost.x",
        "[::1].evil",
        "[::1]evil.example",
        "x@localhost",
        "localhost/evil",
        "localhost?evil",
        "localhost#evil",
        "localhost:80:80",
        "localhost:",
        "localhost:99999",
        "localhost:+80",
        "[127.0.0.1]",
        "::1",
        "",
    ],
)
def test_a_foreign_host_is_refused(serve, host, path):
    server = serve(PageState())
    assert code(raw(server, f"GET /{path} HTTP/1.1", f"Host: {host}")) in (400, 403)


def raw(server, *lines, body=b""):
    """Send an HTTP request with exactly these header lines; return the complete answer (bytes)."""
    head = "\r\n".join([*lines, "Connection: close", "", ""]).encode(errors="surrogateescape")
    with socket.create_connection(("127.0.0.1", server.port), timeout=60) as connection:
        connection.sendall(head + body)
        return b"".join(iter(lambda: connection.recv(1 << 16), b""))


def code(answer):
    """Return the HTTP status in an answer of `raw`."""
    return int(answer.split()[1])


@pytest.mark.parametrize("path", ["/", "/live", "/static/main.js"])
def test_a_request_names_one_host_and_at_most_one_origin(serve, path):
    server = serve(PageState())
    host = f"Host: 127.0.0.1:{server.port}"
    origin = f"Origin: http://127.0.0.1:{server.port}"
    evil = "Origin: http://evil.example"
    begin = f"GET {path} HTTP/1.1"
    upgrade = [f"{name}: {value}" for name, value in UPGRADE.items()][1:]
    for headers in (
        [],
        [host, host],
        [host, "Host: evil.example"],
        ["Host: evil.example", host],
        [host, origin, evil],
        [host, evil, origin],
        [host, origin, origin],
        [host, "Origin:"],
        [host, f"{origin}, http://evil.example"],
    ):
        assert code(raw(server, begin, *headers, *upgrade)) in (400, 403), headers
    assert code(raw(server, "GET / HTTP/1.0")) in (400, 403)
    assert code(raw(server, begin, host, origin)) in (200, 400)  # 400: /live needs a WebSocket


NO_FILE = (
    "/static/" + "x" * 300,
    "/static/" + "x" * 5000,
    "/static/%00",
    "/static/%ff",
    "/static/main.js/x",
    "/static//etc/passwd",
    "/static/.",
    "/static/" + "../" * 50,
    "/%ff",
)


@pytest.mark.parametrize("path", NO_FILE)
def test_a_path_that_no_file_has_is_quietly_not_found(serve, caplog, path):
    server = serve(PageState())
    assert code(raw(server, f"GET {path} HTTP/1.1", f"Host: 127.0.0.1:{server.port}")) == 404
    assert caplog.records == []


BAD = {
    "no HTTP": b"\x16\x03\x01\x02\x00\x01\x00\r\n\r\n",
    "a long header": b"GET / HTTP/1.1\r\nHost: localhost\r\nX: " + b"x" * 100_000 + b"\r\n\r\n",
    "a bad length": b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: x\r\n\r\n",
    "bad chunks": b"POST /recording HTTP/1.1\r\nHost: localhost\r\n"
    b"Transfer-Encoding: chunked\r\n\r\nzz\r\n",
    "a bad Expect": b"GET / HTTP/1.1\r\nHost: localhost\r\nExpect: x\r\n\r\n",
    "no path": b"GET nowhere HTTP/1.1\r\nHost: localhost\r\n\r\n",
    "bad brackets": b"GET http://[ HTTP/1.1\r\nHost: localhost\r\n\r\n",
    "a bad port": b"GET http://x:99999999/ HTTP/1.1\r\nHost: localhost\r\n\r\n",
    "a bad WebSocket": b"GET /live HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\n"
    b"Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\nSec-WebSocket-Key: x\r\n\r\n",
    "a bad range": b"GET / HTTP/1.1\r\nHost: localhost\r\nRange: bytes=9-2\r\n\r\n",
    "a bad date": b"GET / HTTP/1.1\r\nHost: localhost\r\nIf-Modified-Since: \xff\r\n\r\n",
}


@pytest.mark.parametrize("request_", BAD.values(), ids=BAD)
def test_a_bad_request_is_refused_and_leaves_no_line_in_the_log(serve, caplog, request_):
    server = serve(PageState())
    with socket.create_connection(("127.0.0.1", server.port), timeout=60) as connection:
        connection.sendall(request_)
        connection.shutdown(socket.SHUT_WR)
        answer = b"".join(iter(lambda: connection.recv(1 << 16), b""))
    assert not answer or code(answer) < 500
    assert b"Traceback" not in answer
    assert caplog.records == []
    assert status(server.url)[0] == 200


def test_the_names_of_home_are_taken(serve):
    server = serve(PageState())
    for host in ("localhost", "127.0.0.1", "[::1]"):
        assert status(server.url, Host=f"{host}:{server.port}")[0] == 200
        assert status(server.url, Host=f"{host}:9")[0] == 200  # through a tunnel


@pytest.mark.parametrize("path", ["", "live", "static/main.js"])
def test_a_foreign_origin_is_refused(serve, path):
    server = serve(PageState())
    for origin in (
        "http://evil.example",
        "null",
        "http://127.0.0.1:1",
        f"https://127.0.0.1:{server.port}",
        f"http://127.0.0.1:{server.port}.evil.example",
    ):
        assert status(server.url, path, Origin=origin, **UPGRADE)[0] == 403


def test_a_page_of_another_site_gets_nothing_in_a_real_browser(serve, browser, other_site):
    server = serve(PageState())
    page = browser.new_page()
    try:
        connect = """(url) => new Promise((done) => {
          const socket = new WebSocket(url);
          socket.onopen = () => done("open");
          socket.onerror = () => done("refused");
        })"""
        live = f"ws://127.0.0.1:{server.port}/live"
        page.goto(f"http://127.0.0.1:{other_site}/")
        assert page.evaluate(connect, live) == "refused"
        read = "(url) => fetch(url).then((answer) => answer.text(), () => 'refused')"
        assert page.evaluate(read, server.url) == "refused"
        page.goto(server.url)
        assert page.evaluate(connect, live) == "open"
    finally:
        page.close()


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS"])
def test_only_looking_is_a_method(serve, method):
    url = serve(PageState()).url

    async def ask():
        async with aiohttp.ClientSession() as session, session.request(method, url) as answer:
            return answer.status

    assert run(ask()) == 403


@pytest.mark.parametrize("message", ["set gain=3", "set keys=1", "-1", "", "1" * 17, b"1", "²"])
def test_what_a_page_sends_reaches_no_board(bench, serve, message):
    one = bench(Held())
    server = serve(one.state)

    async def send():
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(f"http://127.0.0.1:{server.port}/live") as socket,
        ):
            while "touch" not in (await socket.receive_json(timeout=60)):
                await socket.send_str("1000000")
            written = list(one.link.written)
            await (socket.send_bytes if isinstance(message, bytes) else socket.send_str)(message)
            async for _ in socket:
                pass
            return written, socket.close_code

    written, code = run(send())
    assert code in (1008, 1009)
    assert one.link.written == written
    assert not any(b"set" in line or b"keys" in line for line in written[-3:])


def test_nothing_in_the_page_needs_an_exception_from_its_policy(serve):
    server = serve(PageState())
    for path in ("", "static/main.js", "nowhere"):
        headers = status(server.url, path)[1]
        policy = headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert "*" not in policy
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Referrer-Policy"] == "no-referrer"
        assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
    text = (STATIC / "index.html").read_text(encoding="utf-8")
    assert not re.search(r"<script(?![^>]*\bsrc=)|\sstyle=|\son\w+=|<style", text)


def test_the_page_asks_nothing_of_any_other_machine():
    for path in STATIC.rglob("*.*"):
        text = path.read_text(encoding="utf-8").replace("http://www.w3.org/2000/svg", "")
        assert not re.search(r"https?://|url\(|@import|innerHTML|eval\(", text), path


def test_files_beside_the_page_are_not_served(serve):
    url = serve(PageState()).url
    for path in (
        "static/serve.py",
        "static/../serve.py",
        "static/%2e%2e/serve.py",
        "static/",
        "static/..%2fserve.py",
    ):
        assert status(url, path)[0] in (403, 404)


def test_another_address_asks_for_the_token(serve, open_page):
    server = serve(PageState(), address="0.0.0.0")
    _, token = server.url.split("?token=")
    home = f"http://127.0.0.1:{server.port}/"
    assert len(token) >= 20
    for path in ("", "live", "static/main.js", "?token=wrong", "?token=", "?token=%C3%BC"):
        assert status(home, path)[0] == 401
    cookie = f"spots-token-{server.port}"
    for wrong in ("wrong", "", "\u00fc", "\u00ff\udcff"):
        assert status(home, Cookie=f"{cookie}={wrong}")[0] == 401
    assert status(home, Cookie=f"spots-token-{server.port + 1}={token}")[0] == 401
    assert status(home, f"?token={token}", Host="evil.example")[0] == 403
    assert status(home, f"?token={token}", Origin="http://evil.example")[0] == 403
    assert status(home, Cookie=f"{cookie}={token}")[0] == 200
    page = open_page(f"{home}?token={token}")
    assert "token" not in page.url
    expect(page.locator("body")).to_have_attribute("data-link", "live", timeout=LONG_MS)


def live(home, token, host, origin):
    """Open the page and its WebSocket as a browser does; return the status of each."""
    cookie = f"spots-token-{host.partition(':')[2] or 80}={token}"
    page = status(home, f"?token={token}", Host=host)[0]
    socket = status(home, "live", **UPGRADE, Host=host, Origin=origin, Cookie=cookie)[0]
    return page, socket


@pytest.mark.parametrize("name", ["{}", "{}.local", "{}.lan", "{}.fritz.box", "{}.tail12.ts.net"])
def test_a_name_that_the_network_gives_this_machine_is_known(serve, monkeypatch, name):
    monkeypatch.setattr(socket, "gethostname", lambda: "Bench")
    server = serve(PageState(), address="0.0.0.0")
    home, token = server.url.split("?token=")
    home = f"http://127.0.0.1:{server.port}/"
    host = f"{name.format('bench')}:{server.port}"
    assert live(home, token, host, f"http://{host}") == (303, 101)
    assert live(home, token, host, f"https://{host}") == (303, 403)
    assert status(home, Host=host)[0] == 401
    # On this machine only, such a name can be the one of an attacker.
    assert status(serve(PageState()).url, Host=host)[0] == 403


def test_all_addresses_are_those_of_ip_4_too(serve):
    server = serve(PageState(), address="::")
    assert status(f"http://127.0.0.1:{server.port}/")[0] == 401
    assert status(f"http://[::1]:{server.port}/")[0] == 401


@pytest.mark.parametrize("address", ["127.0.0.1", "0.0.0.0"])
def test_a_given_name_is_known_also_through_an_https_proxy(serve, address):
    server = serve(PageState(), address=address, hosts=["Spots.example.org", "x.example:8443"])
    home, token = f"http://127.0.0.1:{server.port}/", server.url.split("?token=")[1]
    for host in ("spots.example.org", "x.example:8443"):
        for scheme in ("http", "https"):
            assert live(home, token, host, f"{scheme}://{host}") == (303, 101)
            # The proxy replaces the name.
            assert live(home, token, f"127.0.0.1:{server.port}", f"{scheme}://{host}") == (303, 101)
        assert status(home, Host=host)[0] == 401  # a proxy lets other machines in
    for origin in (
        "https://evil.example",
        "https://spots.example.org.evil.example",
        "https://spots.example.org:8443",
        "ftp://spots.example.org",
        "https://127.0.0.1",
        "spots.example.org",
        "null",
    ):
        assert live(home, token, "spots.example.org", origin)[1] == 403
    assert live(home, token, "evil.example", "https://spots.example.org") == (403, 403)
    assert status(home)[0] == 401


def test_home_needs_no_token():
    for address in ("127.0.0.1", "127.0.0.2"):
        server = Serving(PageState(), address=address)
        try:
            assert "token" not in server.url
            assert status(server.url)[0] == 200
        finally:
            server.stop()


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--address", "example.org"], "is not an IP address"),
        (["--address", "192.0.2.1"], "cannot serve on 192.0.2.1"),
        (["--layout", "nowhere"], "cannot read the layout"),
        (["--port", "virtual", "--sensor", "nowhere"], "cannot read the sensor file"),
        (["--port", "virtual", "--scenario", "nowhere"], "cannot read the scenario file"),
        (["--edit", "mine.toml", "--port", "recording:run.spots"], "--edit works with one board"),
        (["--edit", "mini", "--port", "virtual"], "give a name that ends in .toml"),
        (["--edit-controller", "c.txt"], "'c.txt' is not a controller settings file: give a name"),
        (["--edit-gestures", "g.toml", "--port", "recording:x"], "--edit-gestures works with one"),
        (["--host", "http://x.example"], "'http://x.example' is not a host name"),
        (["--session", "s.toml"], "--session and the calibration of --session name the same file"),
        (["--session", "a.jsonl", "--edit", "a.toml"], "--edit and the calibration of --session"),
        (
            ["--edit-gestures", "x/../a.toml", "--edit-controller", "a.toml"],
            "--edit-controller and --edit-gestures name the same file",
        ),
    ],
)
def test_a_mistake_is_one_sentence(capsys, arguments, says):
    assert apart(main, ["serve", "--http-port", "0", *arguments]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


def test_a_session_whose_calibration_would_replace_a_layout_is_refused(tmp_path, capsys):
    layout = tmp_path / "mine.toml"
    layout.write_text(before := (LAYOUTS / "mini.toml").read_text())
    words = ["serve", "--http-port", "0", "--session", str(tmp_path / "mine.jsonl")]
    assert apart(main, words) == 2
    assert "mine.toml would be replaced, but it is not a calibration" in capsys.readouterr().err
    assert layout.read_text() == before


def test_a_port_that_is_taken_is_told(serve, capsys):
    assert apart(main, ["serve", "--http-port", str(serve(PageState()).port)]) == 2
    assert "--http-port" in capsys.readouterr().err


@pytest.mark.board
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_the_end_is_quiet(number):
    arguments = ["serve", "--port", "/dev/nowhere", "--http-port", "0"]
    program = subprocess.Popen(
        [sys.executable, "-m", "spots", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    line = program.stdout.readline()
    assert status(re.search(r"http://\S+", line).group())[0] == 200
    program.send_signal(number)
    _, error = program.communicate(timeout=60)
    waits = "spots: waiting for a board: there is no port /dev/nowhere: "
    assert program.returncode == 0
    assert [line.startswith(waits) for line in error.splitlines()] in ([], [True])


def test_why_there_is_no_board_is_printed_once_for_each_reason(capsys):
    reasons = iter(["no port", "no port", "busy", "", "busy"])

    def open_board(board_id):
        if reason := next(reasons):
            raise SpotsError(reason)
        return board_id

    opened = _announced(open_board)
    for attempt in range(5):
        with suppress(SpotsError):
            assert opened(f"board {attempt}") == "board 3"
    waits = [f"spots: waiting for a board: {reason}" for reason in ("no port", "busy", "busy")]
    assert capsys.readouterr().err.splitlines() == waits


@pytest.mark.parametrize("package", ["aiohttp", "tomlkit"])
def test_a_missing_package_is_reported(monkeypatch, capsys, package):
    monkeypatch.setitem(sys.modules, package, None)
    for name in ("serve", "editors", "toml_text"):
        monkeypatch.delitem(sys.modules, f"spots_web.{name}", raising=False)
    assert main(["serve"]) == 2
    message = f"the web UI needs {package}: pip install "
    assert message in capsys.readouterr().err
