"""Checks the frames, keys, recovery times and memory of a soak test.

The memory that these checks need does not grow with the duration of the test. A fault
(`spots_sim.board.faults`) can cause an outage: a time without readings.
"""

from __future__ import annotations

import gc
import sys
from collections import Counter, deque
from collections.abc import Callable, Iterable

from spots.link.decoder import Decoder
from spots.link.frames import Frame, Text, Touch
from spots.outputs.usages import MODIFIERS, MODIFIERS_FROM
from spots_device.reading.decode import LED_OFF
from spots_sim.strip.files import ScenarioFile

# Faults that interrupt readings. A fault that starts during an outage belongs to this outage.
_INTERRUPTS = ("power.", "i2c.", "clock.")
# Faults that last until the board removes them: their recovery time is counted from their start.
_FROM_THE_BEGIN = ("i2c.sda_low", "power.sensor_resets")
# Longest time from the start of a fault to the start of its outage.
_ONSET_S = 0.15
_OUTAGES_KEPT = 64
# Longest time for which a key may stay down after its finger was lifted: 0.3 s until the host
# releases a key without readings, plus the recovery time of a board without power or sensor.
_LATE_S = 1.0


def _ignore(reading: Touch, now_s: float) -> None:
    pass


class Audit:
    """Compares the frames that the board sent with the frames that arrived.

    Parameters
    ----------
    touched : collections.deque of int
        Ascending indices of the damaged bytes in the stream. `Audit` removes processed indices.
    arrived : callable
        ``arrived(reading, now_s)`` is called for each reading that arrives, except those with the
        LED off.

    Attributes
    ----------
    sent, delivered : collections.Counter
        Number of frames by type, such as ``"Touch"``.
    lost : collections.Counter
        Number of frames that did not arrive: ``damaged``, and ``undamaged``, which must be 0.
    wrong : int
        Number of frames that arrived although they were not sent, or arrived in another order.
    wrong_frames : collections.deque of Frame
        The last wrong frames.
    crashes : list of str
        The log lines in which the board reported a crash, from the stream before damage.
    readings : int
        Number of readings for which `arrived` was called.
    """

    def __init__(self, touched: deque[int], arrived: Callable[[Touch, float], None] = _ignore):
        self._touched = touched
        self._arrived = arrived
        self._clean, self._heard = Decoder(), Decoder()
        self._pending: deque[tuple[bytes, Frame, int, int]] = deque()
        self._rest, self._at = b"", 0
        self._heard_rest = b""
        self.sent, self.delivered, self.lost = Counter(), Counter(), Counter()
        self.wrong = self.readings = 0
        self.wrong_frames: deque[Frame] = deque(maxlen=10)
        self.crashes: list[str] = []

    @property
    def cut(self) -> int:
        """Number of frames that the board sent incompletely, for example at a power failure."""
        return self._clean.stats.bad_crc

    def send(self, data: bytes, now_s: float) -> None:
        """Record bytes of the stream that the board sent, before damage."""
        *pieces, self._rest = (self._rest + data).split(b"\0")
        for piece in pieces:
            end = self._at + len(piece)
            for frame in self._clean.feed(piece + b"\0"):
                self.sent[type(frame).__name__] += 1
                if isinstance(frame, Text) and "crashed" in (line := frame.content.get("text", "")):
                    self.crashes.append(line)
                self._pending.append((piece, frame, self._at, end))
            self._at = end + 1

    def receive(self, data: bytes, now_s: float) -> None:
        """Compare bytes that arrived at the time `now_s` with the sent frames."""
        *pieces, self._heard_rest = (self._heard_rest + data).split(b"\0")
        for piece in pieces:
            # Equal bytes are equal frames; only other bytes must be decoded for the comparison.
            i = next((i for i, sent in enumerate(self._pending) if sent[0] == piece), None)
            if i is not None:
                self._deliver(i, now_s)
                continue
            for frame in self._heard.feed(piece + b"\0"):
                i = next((i for i, sent in enumerate(self._pending) if sent[1] == frame), None)
                if i is None:
                    self.wrong += 1
                    self.wrong_frames.append(frame)
                else:
                    self._deliver(i, now_s)

    def finish(self) -> None:
        """Count all frames that have not arrived yet as lost; call it at the end of the test."""
        self._lose(len(self._pending))

    def _deliver(self, i: int, now_s: float) -> None:
        self._lose(i)
        _, frame, _, _ = self._pending.popleft()
        self.delivered[type(frame).__name__] += 1
        if isinstance(frame, Touch) and not frame.flags & LED_OFF:
            self.readings += 1
            self._arrived(frame, now_s)

    def _lose(self, count: int) -> None:
        for _ in range(count):
            _, _, start, end = self._pending.popleft()
            # The delimiter before a frame counts as a part of it: without this delimiter, the frame
            # is joined to the bytes before it.
            while self._touched and self._touched[0] < start - 1:
                self._touched.popleft()
            hurt = bool(self._touched) and self._touched[0] <= end
            self.lost["damaged" if hurt else "undamaged"] += 1


class _Outage:
    def __init__(self, kind: str, begin_s: float, end_s: float):
        self.kind, self.begin_s, self.end_s = kind, begin_s, end_s
        self.onset_s = max(end_s, begin_s + _ONSET_S)
        self.gap_s = 0.0  # longest gap between two readings that begins before `onset_s`
        self.again_s = begin_s  # end of this gap


class Recoveries:
    """Measures the time from the end of each fault until readings arrive again.

    If a second fault starts before readings arrive, the recovery times of both faults are counted
    from the moment at which both faults have ended. Only faults of the kinds `_INTERRUPTS` are
    measured. A fault of `_FROM_THE_BEGIN` counts as ended at its start.

    Parameters
    ----------
    spells : list of (str, float, float)
        The list `spells` of a `spots_sim.board.faults.FaultLedger`; processed items are removed.

    Attributes
    ----------
    took_ms : dict of collections.Counter
        Histogram of the recovery times in ms, by kind of fault.
    longest : dict of (float, float)
        Longest recovery time and start of its fault, in seconds, by kind of fault.
    """

    def __init__(self, spells: list[tuple[str, float, float]]):
        self._spells = spells
        self._open: list[_Outage] = []
        self._recent: deque[tuple[float, float]] = deque(maxlen=_OUTAGES_KEPT)
        self._before_s = 0.0
        self.took_ms: dict[str, Counter] = {}
        self.longest: dict[str, tuple[float, float]] = {}

    def arrived(self, now_s: float) -> None:
        """Record the arrival of a reading; `now_s` is its time in seconds."""
        self._take_spells()
        before_s, self._before_s = self._before_s, now_s
        if not self._open:
            return
        still = []
        for outage in self._open:
            if before_s > outage.onset_s:
                self._close(outage)
                continue
            if now_s >= outage.begin_s and now_s - before_s > outage.gap_s:
                outage.gap_s, outage.again_s = now_s - before_s, now_s
            still.append(outage)
        self._open = still

    def finish(self, now_s: float) -> None:
        """Count faults that ended before `now_s` without a recovery as recovered at `now_s`."""
        self.arrived(now_s)
        for outage in self._open:
            if outage.end_s < now_s:
                self._close(outage)
        self._open = []

    def summary(self) -> dict[str, dict]:
        """Return, for each kind of fault, the number of faults and their recovery times.

        ``longest_at_s`` is the start of the fault with the longest recovery time ``longest_s``.
        """
        return {
            kind: {
                "count": took.total(),
                "median_s": _median(took) / 1000,
                "longest_s": round(self.longest[kind][0], 3),
                "longest_at_s": round(self.longest[kind][1], 3),
            }
            for kind, took in sorted(self.took_ms.items())
        }

    def _take_spells(self) -> None:
        for kind, begin_us, end_us in self._spells:
            begin_s = begin_us * 1e-6
            end_s = begin_s if kind in _FROM_THE_BEGIN else end_us * 1e-6
            if kind.startswith(_INTERRUPTS):
                self._recent.append((begin_s, end_s))
                self._open.append(_Outage(kind, begin_s, end_s))
        self._spells.clear()

    def _close(self, outage: _Outage) -> None:
        end_s = outage.end_s
        for begin_s, another_s in self._recent:
            if outage.begin_s <= begin_s < outage.again_s or begin_s <= outage.begin_s < another_s:
                end_s = max(end_s, another_s)
        took_s = max(0.0, outage.again_s - end_s)
        self.took_ms.setdefault(outage.kind, Counter())[round(1000 * took_s)] += 1
        longest = self.longest.get(outage.kind, (-1.0, 0.0))
        self.longest[outage.kind] = max(longest, (took_s, outage.begin_s))


def _median(counts: Counter) -> int:
    left = (counts.total() + 1) // 2
    for value in sorted(counts):
        left -= counts[value]
        if left <= 0:
            return value
    return 0


class Keys:
    """Counts the keys of one keyboard that stay down after their finger was lifted.

    Parameters
    ----------
    file : spots_sim.strip.files.ScenarioFile
        Scenario with the fingers.
    now_s : callable
        Returns the time since the start of the scenario, in seconds.

    Attributes
    ----------
    presses, releases : int
        Number of presses and of releases.
    stuck : int
        Number of keys that were down `_LATE_S` after their finger was lifted. The finger of a key
        is the last one that touched the strip before the key press.
    """

    def __init__(self, file: ScenarioFile, now_s: Callable[[], float]):
        self._now_s = now_s
        self._seconds = file.seconds
        self._fingers = [(touch.points[0][0], touch.points[-1][0]) for touch in file.touch]
        # Times from which each key counts as stuck: one time for each finger that presses the key.
        self._down: dict[tuple[int, int], list[float]] = {}
        self.presses = self.releases = self.stuck = 0

    def key(self, page: int, usage: int, modifiers: int, pressed: bool) -> None:
        """Process a key event, see `keyboard.key_engine.KeySink`."""
        if pressed:
            self.presses += 1
            self._down.setdefault((page, usage), []).append(self._leaves_s() + _LATE_S)
        elif late_s := self._down.get((page, usage)):
            self.releases += 1
            late_s.pop(0)

    def report(self, page: int, usages: Iterable[int]) -> None:
        """Process a keyboard report: the usages of all keys that are down on a HID usage page."""
        now = {(page, usage) for usage in usages}
        before = {event for event, late_s in self._down.items() if late_s}
        for event in before - now:
            self.key(*event, 0, False)
        for event in now - before:
            self.key(*event, 0, True)

    def release(self) -> None:
        """Count all keys as released."""
        self.releases += self.down
        self._down.clear()

    def look(self) -> None:
        """Count the keys that are stuck now; each of them is counted only one time."""
        now_s = self._now_s()
        for event, late_s in self._down.items():
            still = [one_s for one_s in late_s if now_s <= one_s]
            self.stuck += len(late_s) - len(still)
            self._down[event] = still

    @property
    def down(self) -> int:
        """Number of keys that are down now, without those that were counted as stuck."""
        return sum(map(len, self._down.values()))

    def summary(self) -> dict[str, int]:
        return {"presses": self.presses, "releases": self.releases, "stuck": self.stuck}

    def _leaves_s(self) -> float:
        turn, phase_s = divmod(self._now_s(), self._seconds)
        ends_s = [end for begin, end in self._fingers if begin <= phase_s]
        if not ends_s:  # the last finger belongs to the previous repetition
            turn -= 1
            ends_s = [end for _, end in self._fingers]
        return turn * self._seconds + max(ends_s, default=0.0)


def usages_of(report: bytes) -> list[int]:
    """Return the usages of all keys in a boot keyboard report, including modifier keys."""
    modifiers = [MODIFIERS_FROM + i for i in range(MODIFIERS) if report[0] >> i & 1]
    return modifiers + [usage for usage in report[2:] if usage]


class Memory:
    """Measures the memory of this process at each call of `mark`.

    Attributes
    ----------
    marks : list of dict
        ``peak_kB``: peak of the memory from the system. ``objects``: memory blocks that Python has
        allocated at the time of the call.
    """

    def __init__(self):
        self.marks: list[dict[str, int]] = []

    def mark(self) -> None:
        import resource  # not at the top, because Windows lacks this module

        gc.collect()
        peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        peak_kB = peak // 1024 if sys.platform == "darwin" else peak
        self.marks.append({"peak_kB": peak_kB, "objects": sys.getallocatedblocks()})
