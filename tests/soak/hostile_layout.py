"""Sends mutated layout messages to a real ``spots serve --edit``; by default 100,000.

Half of the messages have the token. The others have none, a wrong one, or a foreign origin. Prints
one line of JSON. The exit code is 1 if a message of the others was not refused, the server ended,
its memory grew too much, an answer was an error of the server, or the layout file is invalid.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import random
import re
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

import aiohttp

from spots.keyboard.layout import load

_CLIENTS = 8
_GROWTH_MAX_KB = 20_000
_FRAGMENTS = "", '"', "\\", "[", "{", "=", "\n", "#", "9", "-", "\u00e9", "\x00", "clear", "push"
_TEXT = load("mini").text
_MESSAGES = (
    {"do": "check", "text": _TEXT},
    {"do": "push", "text": _TEXT, "base": "", "loses": []},
    {"do": "push", "text": load("digits").text, "base": "0", "loses": ["A", "B"]},
    {"do": "clear"},
)


def _mutated(choice: random.Random) -> bytes:
    """Return a message with some random changes."""
    parts = list(json.dumps(choice.choice(_MESSAGES)))
    for _ in range(choice.randrange(1, 5)):
        at = choice.randrange(len(parts))
        parts[at : at + choice.randrange(3)] = choice.choice([*_FRAGMENTS, parts[at]])
    body = "".join(parts).encode()
    return body * choice.choice((1, 1, 1, 50))


async def _client(port: int, token: str, seed: int, count: int, found: Counter) -> None:
    choice = random.Random(seed)
    url = f"http://127.0.0.1:{port}/layout"
    async with aiohttp.ClientSession() as session:
        for _ in range(count):
            allowed = choice.random() < 0.5
            sent = token if allowed else choice.choice(("", "wrong", token[:-1], token))
            foreign = not allowed and sent == token
            headers = {"Cookie": f"spots-token-{port}={sent}"}
            headers |= {"Origin": "http://evil.example"} if foreign else {}
            try:
                async with session.post(url, data=_mutated(choice), headers=headers) as answer:
                    await answer.read()
            except aiohttp.ClientConnectionError:  # a connection ends after 30 s
                found["disconnected"] += 1
                continue
            found[answer.status] += 1
            found["unrefused"] += not allowed and answer.status != 403
            found["failed"] += answer.status >= 500 and answer.status != 503


def _rss_kb(pid: int) -> int:
    return int(subprocess.check_output(["ps", "-o", "rss=", "-p", str(pid)], text=True))


async def _attack(port: int, token: str, messages: int, pid: int) -> dict:
    found: Counter = Counter()
    sizes_kb = []
    for part in range(10):
        share = max(messages // (10 * _CLIENTS), 1)
        await asyncio.gather(
            *(_client(port, token, 100 * part + i, share, found) for i in range(_CLIENTS))
        )
        sizes_kb.append(_rss_kb(pid))
    return {**{str(name): n for name, n in found.items()}, "rss_kb": sizes_kb}


def main() -> int:
    """Send the messages; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--messages", type=int, default=100_000)
    messages = parser.parse_args().messages
    with tempfile.TemporaryDirectory() as folder:
        path, log = Path(folder) / "mine.toml", Path(folder) / "log"
        with log.open("wb") as errors:
            server = subprocess.Popen(
                [sys.executable, "-u", "-m", "spots", "serve", "--port", "virtual"]
                + ["--http-port", "0", "--edit", str(path)],
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
            )
            try:
                address = re.search(r":(\d+)/\?token=([\w-]+)", server.stdout.readline())
                found = asyncio.run(_attack(int(address[1]), address[2], messages, server.pid))
                found["alive"] = server.poll() is None
            finally:
                server.terminate()
                server.communicate(timeout=60)
        if path.exists():
            load(path)  # an error here is a finding
        found["written"] = path.exists()
        found["log"] = log.read_text(errors="replace")[-600:]
    growth_kb = found["rss_kb"][-1] - found["rss_kb"][1]
    found["ok"] = (
        found["alive"]
        and not found["unrefused"]
        and not found["failed"]
        and not found["log"]
        and growth_kb < _GROWTH_MAX_KB
    )
    print(json.dumps(found))
    return 0 if found["ok"] else 1


if __name__ == "__main__":
    sys.exit(main())
