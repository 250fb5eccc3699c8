"""Runs `monitor`, `serve` and `keyboard` as real processes with hostile boards, for hours.

    python tests/soak/hostile_board.py --minutes 60

Each program has its own board. The board changes its kind of misbehaviour, the *mood*, every 4 s. A
program may end with an error message and exit code 2; it is then started again. A program fails if
it ends in another way, if a key stays down while its board sends nothing, or if its memory grows.
The last line of the output is JSON. The exit code is 1 if a program failed.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import random
import select
import struct
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from fuzz.kept import kept
from support.fault_streams import encoded, frames
from support.plugs import Plug

MOOD_S = 4.0
OFF_S = 1.0
RELEASED_S = 2.0  # longest time for which a key may stay down while the board sends nothing
WARM_S = 60.0  # after this time, a program must not need more memory
GROWTH_KB = 8_000
KEPT_TEXT = 400
PROGRAMS = {
    "monitor": ["monitor"],
    "serve": ["serve", "--http-port", "0"],
    "keyboard": ["keyboard", "--dry-run"],
}
MOODS = [
    "noise", "absurd", "other", "flood", "stall", "wrong_replies", "huge_replies", "backwards",
    "brown_out",
]  # fmt: skip
CORPUS = [*kept("decoder").values()]


class Hostile(Plug):
    """A board that misbehaves. Its port has a symbolic link, whose name never changes."""

    def __init__(self, link: Path, seed: int):
        super().__init__(f"hostile{seed}")
        self.link, self.rng = link, random.Random(seed)
        self.mood, self.until_s, self.since_s = self.good, 0.0, 0.0
        self.moods = Counter()
        self.plug()

    def plug(self):
        super().plug()
        self.link.unlink(missing_ok=True)
        self.link.symlink_to(self.name)

    def live(self):
        now_s = time.monotonic()
        if now_s >= self.until_s:
            if self.fd is None:
                self.plug()
                self.free_names()  # a long run has more than a process can keep open
            mood = self.rng.choice(MOODS) if self.mood == self.good else "good"
            self.mood = getattr(self, mood)
            self.moods[self.mood.__name__] += 1
            self.since_s, self.until_s = now_s, now_s + MOOD_S * self.rng.uniform(0.5, 1.5)
            if self.mood == self.brown_out:
                self.brown_out_begins()
        if self.fd is not None:
            self.read()
            self.mood()

    def write(self, data: bytes):
        with contextlib.suppress(OSError):
            os.write(self.fd, data)

    def good(self):
        self.tick()

    def noise(self):
        self.write(self.rng.choice((self.rng.randbytes(300), self.rng.choice(CORPUS), b"\0" * 50)))

    def absurd(self):
        rng = self.rng
        kind = rng.choice((0, 1, 1, 1, 2, 3, 4, 99))
        header = struct.pack("<BHI", kind, rng.getrandbits(16), rng.getrandbits(32))
        self.write(encoded(header + rng.randbytes(rng.choice((0, 5, 15, 15, 15, 40)))))

    def other(self):
        self.write(b"".join(frames(5, self.rng.getrandbits(20))))

    def flood(self):
        for _ in range(300):
            self._send(1, struct.pack("<BiiiH", 9, 0, 0, self.rng.randrange(85_000), 900))

    def stall(self):
        pass

    def wrong_replies(self):
        self.tick()

    def huge_replies(self):
        self.tick()

    def backwards(self):
        self._booted_s += 0.02  # the board's clock runs backwards
        self.tick()

    def brown_out(self):
        self.tick()

    def brown_out_begins(self):
        if self.rng.random() < 0.5:
            self.unplug()
            self.until_s = time.monotonic() + OFF_S
        else:
            self._booted_s, self._streams, self._sequence = time.monotonic(), [], 0

    def _answer(self, name, *words):
        if self.mood == self.stall:
            return
        if self.mood == self.wrong_replies:
            value = self.rng.choice((None, [], -1, 1e300, 1 << 70, "x" * 100, {"a": []}))
            reply = {"re": self.rng.choice((name, "hello", value)), "protocol": value}
            reply |= {"id": value, "exposure_us": value, "average": value, "t_us": value}
            self._send(3, json.dumps(reply).encode())
        elif self.mood == self.huge_replies:
            self._send(3, json.dumps({"re": name, "text": "x" * 60_000}).encode())
        else:
            super()._answer(name, *words)


class Program:
    """One of the tested programs; it is restarted each time it ends."""

    def __init__(self, name: str, board: Hostile):
        self.name, self.board = name, board
        self.sentences, self.died, self.stuck = Counter(), [], []
        self.starts, self.presses = 0, 0
        self.rss_kB: list[int] = []  # of this process, after `WARM_S`
        self.growth_kB = self.peak_kB = 0
        self.start()

    def start(self):
        self.starts += 1
        self.process = subprocess.Popen(
            [sys.executable, "-m", "spots", *PROGRAMS[self.name], "--port", str(self.board.link)],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        )
        os.set_blocking(self.process.stdout.fileno(), False)
        self.started_s = self.next_s = time.monotonic()
        self.rss_kB, self.down, self.text = [], set(), ""

    def live(self):
        self.read()
        if self.process.poll() is not None:
            self.ended()
            self.start()
        now_s = time.monotonic()
        board = self.board
        silent = board.mood == board.stall and now_s - board.since_s > RELEASED_S
        if self.down and silent:
            self.stuck.append(sorted(self.down))
            self.down.clear()
        if now_s >= self.next_s:
            self.next_s = now_s + 1
            self.measure(now_s)

    def measure(self, now_s):
        with contextlib.suppress(OSError, ValueError, StopIteration):
            status = Path(f"/proc/{self.process.pid}/status").read_text().splitlines()
            rss_kB = int(next(line for line in status if line.startswith("VmRSS")).split()[1])
            self.peak_kB = max(self.peak_kB, rss_kB)
            if now_s - self.started_s > WARM_S:
                self.rss_kB.append(rss_kB)
                self.growth_kB = max(self.growth_kB, rss_kB - self.rss_kB[0])

    def read(self):
        with contextlib.suppress(BlockingIOError, ValueError):
            while data := os.read(self.process.stdout.fileno(), 1 << 16):
                *lines, self.text = (self.text + data.decode(errors="replace")).split("\n")
                for line in lines:
                    word, _, key = line.partition(" ")
                    if word == "down":
                        self.presses += 1
                        self.down.add(key.strip())
                    elif word == "up":
                        self.down.discard(key.strip())
                    self.last = line[-KEPT_TEXT:]
                self.text = self.text[-KEPT_TEXT:]

    def ended(self):
        self.read()
        code, last = self.process.returncode, getattr(self, "last", "")
        if code == 2 and last.startswith("spots: "):
            self.sentences[last[:60]] += 1
        else:
            self.died.append([code, last])
        if self.down:
            self.stuck.append(sorted(self.down))
        self.process.stdout.close()

    def end(self):
        self.process.terminate()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self.process.wait(15)
        if self.process.poll() is None:
            self.died.append([None, "does not end"])
            self.process.kill()
            self.process.wait()
        self.read()
        if self.down:
            self.stuck.append(sorted(self.down))
        self.process.stdout.close()

    def figures(self) -> dict:
        return {
            "starts": self.starts,
            "presses": self.presses,
            "died": self.died[:5],
            "stuck": self.stuck[:5],
            "growth_kB": self.growth_kB,
            "peak_kB": self.peak_kB,
            "moods": self.board.moods,
            "sentences": dict(self.sentences.most_common(8)),
        }


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--minutes", type=float, default=60)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="spots-hostile-") as folder:
        programs = []
        for i, name in enumerate(PROGRAMS):
            board = Hostile(Path(folder) / name, 100 * options.seed + i)
            programs.append(Program(name, board))
        end_s = time.monotonic() + 60 * options.minutes
        try:
            while time.monotonic() < end_s:
                for program in programs:
                    program.board.live()
                    program.live()
                select.select([], [], [], 0.002)
        finally:
            for program in programs:
                program.end()
    figures = {program.name: program.figures() for program in programs}
    bad = any(
        one.died or one.stuck or one.growth_kB > GROWTH_KB or not one.starts for one in programs
    )
    print(json.dumps({"minutes": options.minutes, "bad": bad, **figures}))
    return int(bad)


if __name__ == "__main__":
    sys.exit(main())
