"""Runs hostile clients against a real ``spots serve --session`` of a virtual board.

The attack lasts ``--minutes``, or longer until ``--messages`` forbidden messages were sent. A
forbidden message is a calibration command that has no valid token, comes from another website, or
has invalid content. Prints one line of JSON at the end. The exit code is 1 if one of these
conditions is true: the server ended; its memory or its log grew too much; a well-behaved client got
no readings; a forbidden message had an effect.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import logging
import os
import random
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import aiohttp
import msgspec

from spots_sim.demo.virtual import start_simulator
from spots_web.calibration import PageCalibration

_CLIENTS = 24
_WARM_UP_S = 30.0
_EVERY_S = 5.0
_READING_WITHIN_S = 20.0
_GROWTH_MAX_KB = 20_000
_LOG_MAX_BYTES = 20_000

_ORDERS = (
    b'{"do":"start","kind":"rough","length_mm":85}',
    b'{"do":"start","kind":"fine","length_mm":30.5}',
    b'{"do":"answer","step":1,"text":"42.5mm 120g"}',
    b'{"do":"undo","step":1}',
    b'{"do":"cancel"}',
)
_SENDERS = 8

_HOST = b"Host: 127.0.0.1\r\n"
_UPGRADE = (
    b"Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
    b"Sec-WebSocket-Key: MDEyMzQ1Njc4OWFiY2RlZg==\r\n\r\n"
)
_LIVE = b"GET /live HTTP/1.1\r\n" + _HOST
_REQUESTS = (
    b"GET / HTTP/1.1\r\nHo",
    b"GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n",
    b"GET / HTTP/1.1\r\nHost: [::1].evil\r\n\r\n",
    b"GET / HTTP/1.1\r\n" + _HOST + _HOST + b"\r\n",
    _LIVE + b"Origin: http://evil.example\r\n" + _UPGRADE,
    b"GET /?token=wrong HTTP/1.1\r\n" + _HOST + b"\r\n",
    b"GET /static/" + b"x" * 4000 + b" HTTP/1.1\r\n" + _HOST + b"\r\n",
    b"GET /" + b"x" * 40_000 + b" HTTP/1.1\r\n" + _HOST + b"\r\n",
    b"GET / HTTP/1.1\r\n" + _HOST + b"X: " + b"x" * 200_000 + b"\r\n\r\n",
    b"GET / HTTP/1.1\r\n" + _HOST + b"X: x\r\n" * 5000 + b"\r\n",
    b"POST / HTTP/1.1\r\n" + _HOST + b"Content-Length: 99999999\r\n\r\n" + b"\xff" * 4000,
    b"POST /recording HTTP/1.1\r\n" + _HOST + b"Transfer-Encoding: chunked\r\n\r\nzz\r\n",
    b"GET /static/main.js HTTP/1.1\r\n" + _HOST + b"\r\n",  # many; answers not read
)


def _frame(choice: random.Random) -> bytes:
    """Return a random WebSocket frame; most of these frames are invalid."""
    first = choice.choice((0x80, 0x81, 0x82, 0x88, 0x89, 0x8A, 0x01, 0x02, 0xC1, 0xF3))
    body = choice.choice((b"1", b"-1", b"set gain=3", b"\xff", b"1" * 17, b"x" * 125, b""))
    return bytes((first, 0x80 | len(body), 0, 0, 0, 0)) + body


async def _hostile(port: int, seed: int, end_s: float, counts: dict) -> None:
    choice = random.Random(seed)
    while time.monotonic() < end_s:
        writer = None
        try:
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            counts["connections"] += 1
            kind = choice.randrange(4)
            if kind == 0:
                writer.write(choice.randbytes(choice.randrange(1, 4000)))
            elif kind == 1:
                writer.write(choice.choice(_REQUESTS) * choice.choice((1, 1, 50)))
            else:
                writer.write(_LIVE + _UPGRADE)
                await asyncio.wait_for(reader.read(100), 5)
                for _ in range(choice.choice((1, 1000)) if kind == 2 else 0):
                    writer.write(_frame(choice))
                    counts["messages"] += 1
            await asyncio.wait_for(writer.drain(), 2)
            if choice.random() < 0.5:
                await asyncio.wait_for(reader.read(choice.choice((1, 100_000))), 1)
            await asyncio.sleep(choice.choice((0, 0, 0.1, 3)))  # a slow reader, or half a request
        except (OSError, asyncio.TimeoutError):
            pass
        finally:
            if writer is not None:
                writer.transport.abort()


def _damaged(choice: random.Random) -> bytes:
    """Return a request with a few bytes changed, added or removed, so that it is invalid."""
    while True:
        body = bytearray(choice.choice(_ORDERS))
        for _ in range(choice.randrange(1, 4)):
            at = choice.randrange(len(body))
            body[at : at + choice.randrange(2)] = choice.randbytes(choice.randrange(3))
        try:
            msgspec.json.decode(bytes(body), type=PageCalibration.requests)
        except (ValueError, msgspec.DecodeError):
            return bytes(body)


async def _ordering(url: str, seed: int, number: int, statuses: dict) -> None:
    """Send `number` requests that must be refused: each has a wrong token, origin or content."""
    choice = random.Random(seed)
    page, token = url.split("?token=")
    cookie = f"spots-token-{page.rstrip('/').rpartition(':')[2]}"
    async with aiohttp.ClientSession() as session:
        while number:
            kind, body, headers = choice.randrange(4), choice.choice(_ORDERS), {}
            sent = token
            if kind == 0:
                sent = choice.choice(("", "wrong", token[:-1], token + "x", token.swapcase()))
            elif kind == 1:
                origin = choice.choice(("http://evil.example", "null", "https://127.0.0.1"))
                headers["Origin"] = origin
            else:
                body = _damaged(choice)
            headers["Cookie"] = f"{cookie}={sent}"
            try:
                async with session.post(page + "calibration", data=body, headers=headers) as answer:
                    name = f"{('no token', 'website', 'damaged')[min(kind, 2)]} {answer.status}"
            except aiohttp.ClientError:  # the server had too many connections
                continue
            statuses[name] = statuses.get(name, 0) + 1
            number -= 1


async def _well_behaved(port: int, end_s: float, counts: dict) -> None:
    """Visit the web UI repeatedly; each visit must get readings within `_READING_WITHIN_S`."""
    while time.monotonic() < end_s:
        begun_s = time.monotonic()
        try:
            await asyncio.wait_for(_one_visit(port, counts), _READING_WITHIN_S)
            counts["visits"] += 1
        except (aiohttp.ClientError, asyncio.TimeoutError, OSError):
            counts["visits_failed"] += 1
        counts["slowest_visit_s"] = max(counts["slowest_visit_s"], time.monotonic() - begun_s)
        await asyncio.sleep(0.5)


async def _one_visit(port: int, counts: dict) -> None:
    url = f"http://127.0.0.1:{port}/"
    async with aiohttp.ClientSession() as session:
        async with session.get(url) as answer:
            assert answer.status == 200
        async with session.ws_connect(url + "live") as socket:
            got = 0
            while got < 5:
                message = await socket.receive_json()
                await socket.send_str(str(message["n"]))
                got += "touch" in message
            counts["readings"] += got


def _rss_kb(pid: int) -> int:
    run = ["ps", "-o", "rss=", "-p", str(pid)]
    return int(subprocess.run(run, capture_output=True, text=True, check=True).stdout or 0)


async def _watch(server: subprocess.Popen, end_s: float, sizes_kb: list) -> None:
    while time.monotonic() < end_s and server.poll() is None:
        await asyncio.sleep(_EVERY_S)
        sizes_kb.append(_rss_kb(server.pid))


async def _attack(server: subprocess.Popen, url: str, seconds: float, messages: int) -> dict:
    counts = dict.fromkeys(
        ("connections", "messages", "visits", "visits_failed", "readings", "slowest_visit_s"), 0
    )
    counts["orders"] = {}
    port = int(re.search(r":(\d+)/", url)[1])
    sizes_kb, end_s = [], time.monotonic() + seconds
    each = -(-messages // _SENDERS)
    ordering = [_ordering(url, seed, each, counts["orders"]) for seed in range(_SENDERS)]
    hostile = [_hostile(port, seed, end_s, counts) for seed in range(_CLIENTS)]
    await asyncio.gather(
        *hostile, *ordering, _well_behaved(port, end_s, counts), _watch(server, end_s, sizes_kb)
    )
    warm = sizes_kb[int(_WARM_UP_S / _EVERY_S) :] or sizes_kb
    tenth = max(1, len(warm) // 10)  # medians, because freed memory is sometimes returned late
    first, last = (sorted(part)[len(part) // 2] for part in (warm[:tenth], warm[-tenth:]))
    return {**counts, "rss_first_kb": first, "rss_last_kb": last, "rss_max_kb": max(sizes_kb)}


def main() -> int:
    """Run the attack; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--messages", type=int, default=100_000)
    options = parser.parse_args()
    logging.getLogger("asyncio").setLevel(logging.ERROR)  # the server closes many connections here
    with tempfile.TemporaryDirectory() as folder:
        log, session = Path(folder) / "log", Path(folder) / "calibration.jsonl"
        board, end = start_simulator("default", "demo", 0)
        with log.open("wb") as errors:
            arguments = ["serve", "--port", board["port"], "--http-port", "0"]
            arguments += ["--session", str(session)]
            server = subprocess.Popen(
                [sys.executable, "-m", "spots", *arguments],
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                env=os.environ | {"PYTHONUNBUFFERED": "1"},
            )
            try:
                url = re.search(r"http\S+", server.stdout.readline())[0]
                seconds = 60 * options.minutes
                found = asyncio.run(_attack(server, url, seconds, options.messages))
                found["alive"] = server.poll() is None
            finally:
                server.terminate()
                server.communicate(timeout=60)
                end()
        found["calibrated"] = session.exists()
        found["log_bytes"] = log.stat().st_size
        found["log_tail"] = log.read_text(errors="replace")[-600:]
    found["ok"] = (
        found["alive"]
        and not found["calibrated"]
        and all(name.endswith(("400", "403", "413")) for name in found["orders"])
        and found["visits"] > 0
        and found["visits_failed"] == 0
        and found["rss_last_kb"] - found["rss_first_kb"] < _GROWTH_MAX_KB
        and found["log_bytes"] < _LOG_MAX_BYTES
    )
    print(json.dumps(found))
    return 0 if found["ok"] else 1


if __name__ == "__main__":
    sys.exit(main())
