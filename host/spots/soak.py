"""Hours of a scenario with faults in simulated time, and a ledger of every frame.

What the board sent is tapped before its bytes are damaged, and compared with what a program gets.
"""

from __future__ import annotations

import json
from collections import Counter, deque

import numpy as np
from rich.console import Console
from rich.progress import Progress

from tactile.decode import LED_OFF

from .board import Board
from .calibrate.stage import calibrate
from .connect import prepare
from .errors import SpotsError
from .frames import Decoder, Frame, Touch
from .link import Link
from .sim.faults import WAYS, Faults, FaultyLink, Ledger
from .sim.files import ScenarioFile, SensorFile, load
from .sim.lockstep import LockstepLink
from .sim.scenario import Scenario

# What interrupts readings, and for how long after its begin an interruption may begin.
_INTERRUPTS = ("power.", "i2c.", "clock.")
_ONSET_S = 0.15
_BEFORE_S = 0.03


class Tap:
    """A link that shows what is read from it to ``look(data, now_s)``."""

    def __init__(self, link: Link, look):
        self._link = link
        self._look = look
        self.name, self.now_s, self.write = link.name, link.now_s, link.write
        self.close = link.close

    def read(self, timeout_s: float) -> bytes:
        data = self._link.read(timeout_s)
        self._look(data, self.now_s())
        return data


class Audit:
    """Compares the frames that were sent with those that arrived.

    Parameters
    ----------
    touched : collections.deque of int
        Numbers of the bytes that were damaged, ascending; those that were looked at are removed.

    Attributes
    ----------
    sent, delivered : collections.Counter
        Frames by type.
    lost : collections.Counter
        Frames by cause: ``damaged``, or ``undamaged``, which there must not be.
    wrong : list of Frame
        Frames that arrived and were not sent so, or not in this order.
    arrivals_s : list of float
        When readings arrived, those with the LED off left out.
    """

    def __init__(self, touched: deque[int]):
        self._touched = touched
        self._clean, self._heard = Decoder(), Decoder()
        self._pending: deque[tuple[Frame, int, int]] = deque()
        self._rest, self._at = b"", 0
        self.sent, self.delivered, self.lost = Counter(), Counter(), Counter()
        self.wrong: list[Frame] = []
        self.arrivals_s: list[float] = []

    @property
    def cut(self) -> int:
        """Frames that the board did not send to their end, as when its power fails."""
        return self._clean.stats.bad_crc

    def send(self, data: bytes, now_s: float) -> None:
        """Take bytes as the board sent them."""
        *pieces, self._rest = (self._rest + data).split(b"\0")
        for piece in pieces:
            end = self._at + len(piece)
            for frame in self._clean.feed(piece + b"\0"):
                self.sent[type(frame).__name__] += 1
                self._pending.append((frame, self._at, end))
            self._at = end + 1

    def receive(self, data: bytes, now_s: float) -> None:
        """Take bytes as they arrived."""
        for frame in self._heard.feed(data):
            i = next((i for i, sent in enumerate(self._pending) if sent[0] == frame), None)
            if i is None:
                self.wrong.append(frame)
                continue
            self._lose(i)
            self._pending.popleft()
            self.delivered[type(frame).__name__] += 1
            if isinstance(frame, Touch) and not frame.flags & LED_OFF:
                self.arrivals_s.append(now_s)

    def finish(self) -> None:
        """Count as lost what has not arrived by now."""
        self._lose(len(self._pending))

    def _lose(self, count: int) -> None:
        for _ in range(count):
            _, start, end = self._pending.popleft()
            # The delimiter before it belongs to it, too: without that one, it is joined to
            # whatever came before.
            while self._touched and self._touched[0] < start - 1:
                self._touched.popleft()
            hurt = bool(self._touched) and self._touched[0] <= end
            self.lost["damaged" if hurt else "undamaged"] += 1


def recoveries(ledger: Ledger, arrivals_s: list[float]) -> dict[str, dict]:
    """Return, by kind of fault, how long after its begin readings arrived again.

    Returns
    -------
    dict
        ``count``, ``median_s`` and ``longest_s`` by kind; those after which nothing arrived any
        more are left out.
    """
    arrivals = np.array(arrivals_s)
    times: dict[str, list[float]] = {}
    for kind, begin_us, _ in ledger.spells:
        begin_s = begin_us * 1e-6
        i = np.searchsorted(arrivals, begin_s - _BEFORE_S)
        j = np.searchsorted(arrivals, begin_s + _ONSET_S, side="right")
        if not kind.startswith(_INTERRUPTS) or j >= len(arrivals) or i == j:
            continue
        gaps = np.diff(arrivals[i : j + 1])
        again_s = arrivals[i + 1 + gaps.argmax()]
        times.setdefault(kind, []).append(max(0.0, again_s - begin_s))
    return {
        kind: {
            "count": len(took),
            "median_s": round(float(np.median(took)), 3),
            "longest_s": round(max(took), 3),
        }
        for kind, took in sorted(times.items())
    }


def soak(
    hours: float, scenario: str, seed: int, sensor: str = "default", console: Console | None = None
) -> dict:
    """Run a virtual board in simulated time and return the ledger.

    Parameters
    ----------
    hours : float
        Of simulated time.
    scenario, sensor : str
        Files, by path or name; the scenario has to have faults.
    seed : int
        Of sensor's noise and faults.
    console : rich.console.Console, optional
        Where progress is shown, if it is a terminal.

    Raises
    ------
    SpotsError
        If the scenario has no faults.
    """
    file, strip = load(ScenarioFile, scenario), load(SensorFile, sensor)
    if file.faults is None:
        raise SpotsError(f"the scenario {scenario} has no [faults]; try 'fire'")
    faults = Faults(file.faults, file.seconds, seed)
    audit = Audit(faults.to_host.touched)
    bare = LockstepLink(strip, Scenario(file), seed, faults=faults)
    link = Tap(FaultyLink(Tap(bare, audit.send), faults), audit.receive)
    seconds = 3600 * hours
    with Board(link) as board:
        prepare(board, calibrate(strip))
        board.command("save")  # or a restart would cost the calibration
        began_s = link.now_s()
        with Progress(console=console or Console(stderr=True), transient=True) as progress:
            task = progress.add_task("simulated time", total=seconds)
            for touch in board.touches(seconds):
                if touch.sequence % 256 == 0:
                    progress.update(task, completed=link.now_s() - began_s)
        audit.finish()
        lasted_s = link.now_s() - began_s
        rate_hz = 1e6 / board.info["exposure_us"] / board.info["average"]
        stats = board.stats
    damaged = sum(faults.ledger.counts[f"to_host.{way}"] for way in WAYS)
    return {
        "scenario": scenario,
        "seed": seed,
        "simulated_s": round(lasted_s, 1),
        "bytes": faults.to_host.passed,
        "damaged_bytes_percent": round(100 * damaged / faults.to_host.passed, 3),
        "sent": dict(audit.sent),
        "delivered": dict(audit.delivered),
        "lost": {
            "damaged": audit.lost["damaged"],
            "undamaged": audit.lost["undamaged"],
            "cut_by_the_board": audit.cut,
        },
        "wrong": len(audit.wrong),
        "wrong_frames": [str(frame) for frame in audit.wrong],
        "refused_pieces": stats.bad_crc,
        "restarts_noticed": stats.restarts,
        "readings_percent": round(100 * len(audit.arrivals_s) / (lasted_s * rate_hz), 2),
        "faults": dict(sorted(faults.ledger.counts.items())),
        "recoveries": recoveries(faults.ledger, audit.arrivals_s),
    }


def run(hours: float, scenario: str, seed: int, sensor: str, as_json: bool) -> None:
    """Print the ledger.

    Raises
    ------
    SpotsError
        After that, if a frame arrived that was not sent, or one was lost for no reason.
    """
    ledger = soak(hours, scenario, seed, sensor)
    print(json.dumps(ledger) if as_json else _table(ledger))
    if ledger["wrong"] or ledger["lost"]["undamaged"]:
        raise SpotsError(
            f"{ledger['wrong']} wrong frames were delivered, {ledger['lost']['undamaged']} were "
            "lost without damage; there must be none of either"
        )


def _table(ledger: dict) -> str:
    sent, delivered = sum(ledger["sent"].values()), sum(ledger["delivered"].values())
    lost = ledger["lost"]
    lines = [
        f"{ledger['simulated_s']:g} s of '{ledger['scenario']}', seed {ledger['seed']}: "
        f"{ledger['bytes']} bytes, {ledger['damaged_bytes_percent']:g} % of them damaged",
        f"frames     sent {sent}, delivered {delivered}, wrong {ledger['wrong']}",
        f"lost       by damage {lost['damaged']}, without {lost['undamaged']}; "
        f"cut short by the board {lost['cut_by_the_board']}",
        f"readings   {ledger['readings_percent']:g} % of those that a board without faults sends",
        f"restarts   {ledger['restarts_noticed']} noticed",
        "",
        f"{'fault':<26}{'count':>8}{'median s':>10}{'longest s':>11}   until readings arrive again",
    ]
    for kind, count in ledger["faults"].items():
        row = f"{kind:<26}{count:>8}"
        if kind in ledger["recoveries"]:
            took = ledger["recoveries"][kind]
            row += f"{took['median_s']:>10.3f}{took['longest_s']:>11.3f}"
        lines.append(row)
    return "\n".join(lines)
