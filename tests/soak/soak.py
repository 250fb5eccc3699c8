"""Runs a scenario with faults for hours of simulated time; checks every frame and every key.

The frames that the board sends are recorded before damage, and compared with the received frames.
Three keyboards are checked: the key engine on the host, the KEY frames, and the board's USB
keyboard. The memory that a run needs does not depend on its duration.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import msgspec
from rich.console import Console
from rich.progress import Progress

from spots.errors import SpotsError
from spots.keyboard.key_engine import KeyEngine
from spots.keyboard.layout import compiled
from spots.link.board import Board
from spots.link.connect import prepare, upload_lines
from spots.link.frames import Key, Touch
from spots.link.lines import of_sensor
from spots.outputs.usages import KEYBOARD
from spots_sim.board.faults import (
    WAYS,
    Faults,
    FaultyBus,
    FaultyLink,
)
from spots_sim.board.link_wrapper import Tap
from spots_sim.board.lockstep import LockstepLink
from spots_sim.person.stage import calibrate, strip_lines
from spots_sim.person.typist import fast_typing
from spots_sim.strip.files import ScenarioFile, SensorFile, load
from spots_sim.strip.scenario import Scenario

from .audit import Audit, Keys, Memory, Recoveries, usages_of

_TICK_S = 0.05
# Layout of ten keys for each strip; no key is in both. A board without a layout uses the first one.
_LAYOUTS = [
    compiled(
        Path(name),
        f'name = "{name}"\n[[layer]]\nname = "{name}"\nkeys = {json.dumps(list(keys))}\n',
    )
    for name, keys in {"digits": "1234567890", "letters": "ABCDEFGHIJ"}.items()
]
_COMMON = ("power.brown_outs", "clock.stalls")  # faults that affect all strips of a board
_RECOVERED_S = 1.0  # longest time without readings after the end of a fault
_HOUR_S = 3600.0
_INTERFACE = 0  # of the USB keyboard


class Watch:
    """Checks the keyboards and the memory during a soak test.

    Parameters
    ----------
    board : board.Board
        Board with a calibration, connected through a link with faults.
    bare : spots_sim.board.lockstep.LockstepLink
        Link to the same board, before the faults are applied.
    faults : spots_sim.board.faults.Faults
        Faults of the run.
    file : spots_sim.strip.files.ScenarioFile
        Scenario of the run.
    mark_s : float
        Time after the start at which memory is measured for comparison with the end, in seconds.

    Attributes
    ----------
    strips : list of dict
        The keyboards of each strip: the items ``host``, ``frames`` and ``usb``.
    """

    def __init__(self, board, bare, faults, file, mark_s):
        self._board, self._bare, self._faults = board, bare, faults
        self._began_s, self._mark_s = board.now_s(), mark_s
        self.strips = [
            {name: Keys(file, bare.now_s) for name in ("host", "frames", "usb")}
            for _ in board.sensors
        ]
        self.memory = Memory()
        self.free_bytes: list[int] = []  # free heap of the board: minima before and after `mark_s`
        self._engines, self._usages = [], []
        for sensor, layout in zip(board.sensors, _LAYOUTS):
            info = board.command(of_sensor("hello", sensor))
            host = self.strips[sensor]["host"]
            self._engines.append(
                KeyEngine(layout, info["length_um"], host, info["decay"], cross=info["cross"])
            )
            self._usages.append({action & 0xFF for action in layout.typed})
        self._gaps = self._told_gaps()
        self._brown_outs = 0
        self._frames = None  # created when the streams are chosen

    def run(self, seconds: float) -> None:
        """Process the frames of the next `seconds` of simulated time."""
        board = self._board
        self._frames = self._frames or board.frames()
        end_s = board.now_s() + seconds
        while board.now_s() < end_s:
            for frame in self._frames.within(min(_TICK_S, end_s - board.now_s())):
                self._take(frame)
            self._look()

    def settle(self, most_s: float) -> None:
        """Process frames until no key is down, for at most `most_s` seconds."""
        end_s = self._board.now_s() + most_s
        while any(keys.down for keys in self.keyboards()) and self._board.now_s() < end_s:
            self.run(_TICK_S)

    def keyboards(self) -> Iterator[Keys]:
        """Yield all keyboards of all strips."""
        for strip in self.strips:
            yield from strip.values()

    def _take(self, frame) -> None:
        gaps = self._told_gaps()
        if gaps != self._gaps:  # see docs/extend/protocol.md: a dropped KEY frame is not sent again
            self._gaps = gaps
            for strip in self.strips:
                strip["frames"].release()
        if isinstance(frame, Touch):
            self._engines[frame.sensor].take(frame, self._board.now_s())
        elif isinstance(frame, Key):
            keys = self.strips[frame.sensor]["frames"]
            keys.key(frame.page, frame.usage, frame.modifiers, frame.pressed)

    def _told_gaps(self) -> tuple[int, int]:
        return self._board.stats.lost, self._board.stats.restarts

    def _look(self) -> None:
        for engine in self._engines:
            engine.tick(self._board.now_s())
        brown_outs = self._faults.ledger.counts["power.brown_outs"]
        if brown_outs != self._brown_outs:  # a computer releases the keys of a removed keyboard
            self._brown_outs = brown_outs
            for strip in self.strips:
                strip["usb"].release()
        for interface, report in self._bare.usb.reports:
            if interface == _INTERFACE:
                down = set(usages_of(report))
                for strip, own in zip(self.strips, self._usages):
                    strip["usb"].report(KEYBOARD, down & own)
        self._bare.usb.reports.clear()
        for keys in self.keyboards():
            keys.look()
        self._note_free()
        now_s = self._board.now_s()
        if now_s - self._began_s >= self._mark_s and not self.memory.marks:
            self.memory.mark()

    def _note_free(self) -> None:
        free_bytes = self._bare.free_bytes
        if free_bytes is not None:
            i = len(self.memory.marks)
            self.free_bytes += [free_bytes] * (i + 1 - len(self.free_bytes))
            self.free_bytes[i] = min(self.free_bytes[i], free_bytes)


def with_typing(
    file: ScenarioFile, words_per_min: float, length_mm: float, seed: int
) -> ScenarioFile:
    """Replace the touches of a scenario by fast typing, in which many touches overlap.

    Parameters
    ----------
    file : spots_sim.strip.files.ScenarioFile
        Scenario; its duration and its faults stay the same.
    words_per_min : float
        Speed in words a minute; a word has five keys.
    length_mm : float
        Length of the strip, in mm.
    seed : int
        Random seed of the text and of its touches.
    """
    touches = round(file.seconds * words_per_min / 12)
    typed = fast_typing(_LAYOUTS[0], words_per_min, touches, length_mm, seed)
    within = [touch for touch in typed.touch if touch.points[-1][0] < file.seconds]
    return msgspec.structs.replace(file, touch=within)


def soak(
    hours: float,
    scenario: str,
    seed: int,
    sensor: str = "default",
    words_per_min: float | None = None,
    strips: int = 1,
    console: Console | None = None,
) -> dict:
    """Run a virtual board in simulated time and return the results.

    Parameters
    ----------
    hours : float
        Simulated time in hours.
    scenario, sensor : str
        Scenario file with faults, and sensor file: a path or a name.
    seed : int
        Random seed of noise and faults.
    words_per_min : float, optional
        Speed of fast typing that replaces the touches of the scenario, see `with_typing`.
    strips : int
        Number of strips on the board, 1 or 2. Both have the same fingers, but their own faults.
    console : rich.console.Console, optional
        Console that shows the progress, if it is a terminal; stderr by default.

    Returns
    -------
    dict
        Numbers of sent, delivered, lost and wrong frames, see `Audit`; faults and recovery times by
        kind of fault; presses and stuck keys by keyboard; memory of the board and of this process.

    Raises
    ------
    SpotsError
        If the scenario has no faults.
    """
    file, strip = load(ScenarioFile, scenario), load(SensorFile, sensor)
    if file.faults is None:
        raise SpotsError(f"the scenario {scenario} has no [faults] table: use 'fire'")
    if words_per_min is not None:
        file = with_typing(file, words_per_min, strip.length_mm, seed)
    faults = Faults(file.faults, file.seconds, seed)
    ledgers, second = [faults.ledger], None
    if strips == 2:
        other = Faults(file.faults, file.seconds, seed + 1)
        ledgers.append(other.ledger)
        faults.ledger.spells = _Spells(other.ledger.spells)
        second = Scenario(file), seed + 1
    bare = LockstepLink(strip, Scenario(file), seed, faults=faults, second=second)
    if second:
        bare.second = FaultyBus(bare.second, other)
    recoveries = [Recoveries(ledger.spells) for ledger in ledgers]

    def arrived(reading: Touch, now_s: float) -> None:
        recoveries[reading.sensor].arrived(now_s)

    audit = Audit(faults.to_host.touched, arrived)
    link = Tap(FaultyLink(Tap(bare, audit.send), faults), audit.receive)
    seconds = _HOUR_S * hours
    with Board(link) as board:
        for i in range(strips):
            if i:
                upload_lines(board, "layout", _LAYOUTS[i].lines, i)
            prepare(board, strip_lines(calibrate(strip), i), i)
            board.command(of_sensor("set keys=1", i))
        board.command("save")  # otherwise a restart would lose the calibration
        watch = Watch(board, bare, faults, file, min(_HOUR_S, seconds / 2))
        began_s = link.now_s()
        board.stream("touch")
        with Progress(console=console or Console(stderr=True), transient=True) as progress:
            task = progress.add_task("simulated time", total=seconds)
            while (left_s := began_s + seconds - link.now_s()) > 0:
                watch.run(min(1.0, left_s))
                progress.update(task, completed=link.now_s() - began_s)
        watch.settle(file.seconds)
        audit.finish()
        for recovery in recoveries:
            recovery.finish(link.now_s())
        lasted_s = link.now_s() - began_s
        rate_hz = 1e6 / board.info["exposure_us"] / board.info["average"]
        stats = board.stats
    watch.memory.mark()
    counts = Counter(faults.ledger.counts)
    for i, ledger in enumerate(ledgers[1:], 1):
        counts.update({_of_strip(kind, i): count for kind, count in ledger.counts.items()})
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
        "wrong": audit.wrong,
        "wrong_frames": [str(frame) for frame in audit.wrong_frames],
        "crashes": audit.crashes,
        "refused_pieces": stats.bad_crc,
        "restarts_noticed": stats.restarts,
        "readings_percent": round(100 * audit.readings / (lasted_s * rate_hz * strips), 2),
        "faults": dict(sorted(counts.items())),
        "recoveries": {
            _of_strip(kind, i): took
            for i, recovery in enumerate(recoveries)
            for kind, took in recovery.summary().items()
        },
        "keys": {
            _of_strip(name, i): {**keys.summary(), "down_at_the_end": keys.down}
            for i, strip_keys in enumerate(watch.strips)
            for name, keys in strip_keys.items()
        },
        "memory": {"board_free_bytes": watch.free_bytes, "host": watch.memory.marks},
    }


class _Spells(list):
    """The faults of strip 0; appends those of `_COMMON` to the list of strip 1, too."""

    def __init__(self, other: list):
        super().__init__()
        self._other = other

    def append(self, spell) -> None:
        super().append(spell)
        if spell[0] in _COMMON:
            self._other.append(spell)


def _of_strip(name: str, strip: int) -> str:
    return f"{name} of strip {strip}" if strip else name


def soak_command(
    hours: float,
    scenario: str,
    seed: int,
    sensor: str,
    words_per_min: float | None,
    as_json: bool,
    strips: int = 1,
) -> None:
    """Run a soak test and print its results; the parameters are those of `soak`.

    Raises
    ------
    SpotsError
        After the results are printed, if `broken_promises` yields a failure.
    """
    ledger = soak(hours, scenario, seed, sensor, words_per_min, strips)
    print(json.dumps(ledger) if as_json else _table(ledger))
    broken = list(broken_promises(ledger))
    if broken:
        raise SpotsError("the soak test failed: " + "; ".join(broken))


def broken_promises(ledger: dict) -> Iterator[str]:
    """Yield a sentence for each failure in the results of `soak`."""
    if ledger["wrong"]:
        yield f"{ledger['wrong']} wrong frames were delivered"
    if ledger["lost"]["undamaged"]:
        yield f"{ledger['lost']['undamaged']} frames were lost without damage"
    if crashes := ledger["crashes"]:
        yield f"the board crashed {len(crashes)} times, first: {crashes[0]!r}"
    for name, keys in ledger["keys"].items():
        stuck = keys["stuck"] + keys["down_at_the_end"]
        if stuck:
            yield f"{stuck} keys of the keyboard '{name}' were stuck"
    for kind, took in ledger["recoveries"].items():
        if took["longest_s"] >= _RECOVERED_S:
            yield (
                f"readings took {took['longest_s']:g} s to return after {kind}, "
                f"which began at {took['longest_at_s']:g} s"
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
        *(_keys_line(name, keys) for name, keys in ledger["keys"].items()),
        *_memory_lines(ledger["memory"]),
        "",
        f"{'fault':<36}{'count':>8}{'median s':>10}{'longest s':>11}   from its end to readings",
    ]
    for kind, count in ledger["faults"].items():
        row = f"{kind:<36}{count:>8}"
        if kind in ledger["recoveries"]:
            took = ledger["recoveries"][kind]
            row += f"{took['median_s']:>10.3f}{took['longest_s']:>11.3f}"
        lines.append(row)
    return "\n".join(lines)


def _keys_line(name: str, keys: dict) -> str:
    return (
        f"keys {name:<18}presses {keys['presses']}, releases {keys['releases']}, "
        f"stuck {keys['stuck']}, down at the end {keys['down_at_the_end']}"
    )


def _memory_lines(memory: dict) -> Iterator[str]:
    mark, end = memory["host"]
    yield (
        f"memory     host: peak {mark['peak_kB']} kB and {mark['objects']} objects at the mark, "
        f"{end['peak_kB']} kB and {end['objects']} at the end"
    )
    if memory["board_free_bytes"]:
        places = zip(memory["board_free_bytes"], ("before the mark", "after it"))
        least = ", ".join(f"{free_bytes} bytes free {place}" for free_bytes, place in places)
        yield f"           board: at least {least}"
