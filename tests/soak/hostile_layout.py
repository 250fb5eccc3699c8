"""Sends mutated messages to a real ``spots serve`` with all editors; by default 100,000.

Half of the messages have the server's access token. The server must refuse the other half, because
they have no token, a wrong token, or a foreign origin. Prints one line of JSON. The exit code is 1
if one of these conditions is true: a message of the other half was not refused; the server ended;
its memory grew too much; an answer was a server error (5xx except 503); a written file is invalid;
the server wrote a file that no option names.
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
from spots_device.board.settings import checksum
from spots_web.editors import KINDS

sys.path.insert(0, str(Path(__file__).parents[1]))

from support.fuzzing import mutated

_CLIENTS = 8
_GROWTH_MAX_KB = 20_000
_TEXT = load("mini").text
_SETTINGS = {name: kind.usual.read_text(encoding="utf-8") for name, kind in KINDS.items()}
_BASES = {name: checksum([text]) for name, text in _SETTINGS.items()}
_WORDS = "start", "stop", "list", "live", "play\n../mine.toml", "compare\n../a.spots\n/etc/passwd"
_MESSAGES = (
    ("layout", json.dumps({"do": "check", "text": _TEXT})),
    ("layout", json.dumps({"do": "check", "content": load("digits").content})),
    ("layout", json.dumps({"do": "check", "text": _TEXT, "content": load("digits").content})),
    ("layout", json.dumps({"do": "push", "text": _TEXT, "base": "", "loses": []})),
    ("layout", json.dumps({"do": "push", "text": _TEXT, "base": "0", "loses": ["A", "B"]})),
    ("layout", json.dumps({"do": "clear"})),
    *((name, json.dumps({"do": "check", "text": text})) for name, text in _SETTINGS.items()),
    *(
        (name, json.dumps({"do": "save", "text": text, "base": _BASES[name]}))
        for name, text in _SETTINGS.items()
    ),
    *(("recording", word) for word in _WORDS),
    ("strip", "0"),
    ("strip", "1"),
)


def _mutated(choice: random.Random) -> tuple[str, bytes]:
    """Choose a message; return its URL path, and the message with some random changes."""
    path, message = choice.choice(_MESSAGES)
    return path, mutated(choice, message).encode() * choice.choice((1, 1, 1, 50))


async def _client(port: int, token: str, seed: int, count: int, found: Counter) -> None:
    choice = random.Random(seed)
    async with aiohttp.ClientSession() as session:
        for _ in range(count):
            allowed = choice.random() < 0.5
            sent = token if allowed else choice.choice(("", "wrong", token[:-1], token))
            foreign = not allowed and sent == token
            headers = {"Cookie": f"spots-token-{port}={sent}"}
            headers |= {"Origin": "http://evil.example"} if foreign else {}
            path, body = _mutated(choice)
            url = f"http://127.0.0.1:{port}/{path}"
            try:
                async with session.post(url, data=body, headers=headers) as answer:
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


def _name(kind: str) -> str:
    return f"{kind}.toml"


def main() -> int:
    """Send the messages; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--messages", type=int, default=100_000)
    messages = parser.parse_args().messages
    with tempfile.TemporaryDirectory() as folder:
        path, log, inside = (Path(folder) / name for name in ("mine.toml", "log", "inside"))
        inside.mkdir()
        edited = {name: Path(folder) / _name(name) for name in KINDS}
        editors = [text for name, at in edited.items() for text in (f"--edit-{name}", str(at))]
        with log.open("wb") as errors:
            server = subprocess.Popen(
                [sys.executable, "-u", "-m", "spots", "serve", "--port", "virtual"]
                + ["--http-port", "0", "--edit", str(path), "--record-to", str(inside), *editors],
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
        for name, kind in KINDS.items():
            if edited[name].exists():
                kind.read(edited[name].read_text(encoding="utf-8"), edited[name])
        made = {one.name for one in Path(folder).iterdir()}
        found["foreign"] = sorted(made - {path.name, log.name, inside.name, *map(_name, KINDS)})
        found["written"] = sorted(made)
        found["log"] = log.read_text(errors="replace")[-600:]
    growth_kb = found["rss_kb"][-1] - found["rss_kb"][1]
    found["ok"] = (
        found["alive"]
        and not found["unrefused"]
        and not found["failed"]
        and not found["log"]
        and not found["foreign"]
        and growth_kb < _GROWTH_MAX_KB
    )
    print(json.dumps(found))
    return 0 if found["ok"] else 1


if __name__ == "__main__":
    sys.exit(main())
