"""Runs hostile Zenoh peers against `monitor`, `serve`, `subscribe` and `keyboard --dry-run`.

    python tests/soak/hostile_zenoh.py --minutes 60

The last line of the output is JSON. The exit code is 1 if an attacked process ended, its memory
grew, it got no more readings, or a key stayed down.
"""

from __future__ import annotations

import argparse
import asyncio
import json
import os
import random
import re
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import aiohttp
import zenoh

sys.path.insert(0, str(Path(__file__).parents[1]))

from support.boards import running
from support.net import REQUEST, Announced, Net, frames, service_key, session, topic_key

import spots
from spots.link.connect import prepare
from spots_net.ros2.messages import frame_message, types
from spots_net.ros2.types import packed
from spots_sim.person.stage import calibrate, set_as_calibrated
from spots_sim.strip.files import SensorFile, load

SAMPLE_EVERY_S = 5.0
WARM_UP_SHARE = 0.25  # share of the duration after which growth of memory is counted
GROWTH_MAX = 24 << 20
STALE_MAX_S = 15.0
HELD_MAX_S = 15.0  # the scenario holds a key for less than a second
DEEP = b'{"a":' * 20_000 + b"1" + b"}" * 20_000
PAYLOADS = (b"", b"\0" * 50, b"\xff" * 700, b"{}", b"[]", DEEP, b"\0" + b"x" * 2_000_000)
PAYLOADS += bytes(104), bytes(4) + b"\xff" * 100, bytes(8) + b"\xff\xff\xff\x7f"
HEADERS = None, b"", b"x", b"\xff" * 100_000, REQUEST["attachment"]


def attack(config: Path, board_id: str, seed: int) -> None:
    """Send invalid and hostile messages to a board's subscribers until this process is killed."""
    chance, peer = random.Random(seed), session(config)
    ignore = zenoh.handlers.Callback(lambda reply: None, indirect=False)
    for command, text in {"hello": DEEP.decode(), "get": "{}", "sync": '{"t_us": 1}'}.items():
        Announced(peer, "x").replies(command, text)
    for command in ("hello", "get", "sync"):
        Announced(peer, board_id).replies_cdr(command, b"\xff" * 5000)
    announced = []

    def put() -> None:
        name = chance.randrange(10 ** chance.randrange(1, 7))
        places = (
            *(topic_key(f"b{name}", kind, chance.randrange(9)) for kind in types()),
            *(topic_key(board_id, kind, sensor) for kind in types() for sensor in (0, 7)),
            *("0/" + "y" * 300, "0/\u202e/\x1b[2J/point/a/b", frames(f"b{name}").key(0)),
            *(topic_key("a1", kind).replace("spots_a1", "\x1b[2J") for kind in types()),
        )
        peer.put(chance.choice(places), chance.choice(PAYLOADS), attachment=chance.choice(HEADERS))

    def ask() -> None:
        place = chance.choice(("hello", "get", "sync", "*", "reboot"))
        for _ in range(200):
            peer.get(service_key(board_id, place), handler=ignore, timeout=1.0, **REQUEST)

    def name() -> None:
        announced.append(Announced(peer, f"t{chance.randrange(9999)}").__enter__())
        if len(announced) > 2000:
            announced.pop(0).__exit__()

    def break_in() -> None:
        # Rare, because a message of a publisher that is announced counts as a restart of the board.
        with Announced(peer, board_id) as second:
            second.put(packed(frame_message(chance.choice(PAYLOADS)[:60_000], 0)))
        place = frames(board_id).key(0)
        peer.put(place, chance.choice(PAYLOADS), attachment=chance.choice(HEADERS))

    acts = (put, ask, name, break_in)
    while True:
        chance.choices(acts, (300, 3, 20, 1))[0]()
        time.sleep(0.002)


class Victim:
    """A process under attack; records its memory, and the time at which it last got a reading."""

    def __init__(self, config: Path, reading: str, *arguments: str):
        self.name, self._reading = arguments[0], re.compile(reading)
        self.rss: list[int] = []
        self.heard_s, self.readings, self.stale_s = time.monotonic(), 0, 0.0
        self.url, self.last = "", ""
        self.down_s: dict[str, float] = {}
        self.held_s = 0.0
        command = [sys.executable, "-m", "spots", *arguments, "--zenoh-config", str(config)]
        self.process = subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace"
        )
        threading.Thread(target=self._hear, daemon=True).start()

    def _hear(self) -> None:
        for line in self.process.stdout:
            self.last = line[:300]
            if found := re.search(r"http://\S+", line):
                self.url = found[0]
            if self._reading.search(line):
                self.took()
            self._key(*line.split())

    def _key(self, word: str = "", name: str = "", *_) -> None:
        if word == "down":
            self.down_s[name] = time.monotonic()
        elif word == "up":
            self.held_s = max(self.held_s, time.monotonic() - self.down_s.pop(name))

    def took(self) -> None:
        self.readings += 1
        self.heard_s = time.monotonic()

    def sample(self) -> None:
        statm = Path(f"/proc/{self.process.pid}/statm").read_text()
        self.rss.append(int(statm.split()[1]) * os.sysconf("SC_PAGE_SIZE"))
        self.stale_s = max(self.stale_s, time.monotonic() - self.heard_s)
        self.held_s = max([self.held_s, *(time.monotonic() - s for s in [*self.down_s.values()])])

    def figures(self) -> dict:
        warm = self.rss[int(WARM_UP_SHARE * len(self.rss)) :] or [0]
        third = max(1, len(warm) // 3)
        grown = max(warm[-third:]) - max(warm[:third])
        alive = self.process.poll() is None
        return {
            "alive": alive,
            "rss_MB": [round(one / 1e6, 1) for one in (warm[0], max(warm), warm[-1])],
            "grown_MB": round(grown / 1e6, 1),
            "readings": self.readings,
            "longest_without_s": round(self.stale_s, 1),
            "longest_held_s": round(self.held_s, 1),
            "down": [*self.down_s],
            "ok": alive
            and grown < GROWTH_MAX
            and self.stale_s < STALE_MAX_S
            and self.held_s < HELD_MAX_S
            and not self.down_s,
            **({} if alive else {"last_line": self.last}),
        }


def watch_page(victim: Victim) -> None:
    """Act as a browser with the web UI of `serve`; reconnect after each disconnect."""

    async def look() -> None:
        async with aiohttp.ClientSession() as client:
            url = victim.url.replace("http", "ws") + "live"
            async with client.ws_connect(url, max_msg_size=0) as page:
                async for message in page:
                    content = message.json()
                    await page.send_str(str(content["n"]))
                    if content.get("touch"):
                        victim.took()

    while True:
        try:
            asyncio.run(look())
        except (aiohttp.ClientError, OSError, ValueError):
            pass
        time.sleep(0.5)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--attack", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.attack:
        config, board_id, seed = options.attack
        attack(Path(config), board_id, int(seed))
    with tempfile.TemporaryDirectory() as folder, running("") as start:
        file = load(SensorFile, "default")
        with spots.open(start["port"]) as board:
            set_as_calibrated(board, file)
            prepare(board, calibrate(file))
        net = Net(Path(folder))
        own = [sys.executable, "-m", "spots", "publish", "--port", start["port"]]
        own += ["--zenoh-config", str(net.hub)]
        publisher = subprocess.Popen(own, stdout=subprocess.PIPE, text=True)
        board_id = publisher.stdout.readline().split()[2].rstrip(",")
        port = "--port", f"zenoh:{board_id}"
        victims = [
            Victim(net.leaf, r" mm +[\d.]+ N|no touch", "monitor", *port),
            Victim(net.leaf, r"(?!)", "serve", *port, "--http-port", "0"),
            Victim(net.leaf, rf"^{board_id}  ", "subscribe", "/**"),
            Victim(net.leaf, "^down", "keyboard", *port, "--layout", "digits", "--dry-run"),
        ]
        while not victims[1].url:
            time.sleep(0.1)
        threading.Thread(target=watch_page, args=(victims[1],), daemon=True).start()
        time.sleep(5.0)
        again = [sys.executable, __file__, "--attack", str(net.leaf), board_id]
        hostile = [subprocess.Popen([*again, str(seed)]) for seed in range(2)]
        try:
            end_s = time.monotonic() + 60 * options.minutes
            while time.monotonic() < end_s and all(v.process.poll() is None for v in victims):
                time.sleep(SAMPLE_EVERY_S)
                for victim in victims:
                    if victim.process.poll() is None:
                        victim.sample()
            figures = {"publish": {"ok": publisher.poll() is None}}
            figures["attackers"] = {"ok": all(one.poll() is None for one in hostile)}
            # The keyboard must release its keys when the board is lost.
            publisher.kill()
            time.sleep(SAMPLE_EVERY_S)
            figures |= {victim.name: victim.figures() for victim in victims}
        finally:
            for one in (*hostile, *(victim.process for victim in victims), publisher):
                one.kill()
                one.wait()
    ok = all(one["ok"] for one in figures.values())
    print(json.dumps({"minutes": options.minutes, "ok": ok, **figures}))
    return 0 if ok else 1


if __name__ == "__main__":
    sys.exit(main())
