"""The cases of data/zmk.toml: what the keyboard firmware ZMK does, and what is different here."""

import re
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import msgspec

from spots.keyboard.layout import compiled
from spots.outputs.usages import MODIFIERS_FROM, USAGES
from support.engine_bench import Bench
from support.hold_tap import cases as hold_tap_cases
from support.hold_tap import events_of

_FILE = msgspec.toml.decode((Path(__file__).parents[1] / "data" / "zmk.toml").read_text())
DIFFERS = _FILE["differs"]


class Case(NamedTuple):
    """One case; `events` are (ms, whether it is a press, switch)."""

    name: str
    text: str
    events: list
    outcome: list
    quick_release: bool

    def layout(self, times):
        """Return the text of a layout file with all times multiplied by `times`."""
        text = re.sub(r"_ms = (\d+)", lambda one: f"_ms = {times * int(one[1])}", self.text)
        # ZMK releases a tapped key at once.
        tuning = "[tuning]\ntap_ms = 0\n"
        text = text.replace("[tuning]\n", tuning) if "[tuning]" in text else tuning + text
        return f'name = "case"\n{text}'

    def as_here(self, outcome):
        """Return an outcome without the releases whose moment is different here.

        A sticky key ends when the next key is pressed, and not when that one is released.
        """
        ends = [] if self.quick_release else re.findall(r'"sticky (\w+)"', self.text)
        return [one for one in outcome if one[1:] not in ends or one[0] == "+"]

    @property
    def after_ms(self):
        """Time after the last release in which something may still happen."""
        return max(map(int, re.findall(r"(?m)^\w+_ms = (\d+)", self.text)), default=0)

    @property
    def fingers(self):
        """Largest number of switches that are pressed at the same time."""
        down = most = 0
        for _, is_press, _ in self.events:
            down += 1 if is_press else -1
            most = max(most, down)
        return most


def cases():
    """Return all cases that must have the same outcome."""
    return [
        Case(name, one["text"], events_of(times), outcome.split(), one.get("quick_release", True))
        for one in _FILE["layout"]
        for name, times, outcome in one["cases"]
    ]


def played(case):
    """Return a `Bench` that has played a case."""
    bench = Bench(compiled(Path("case"), case.layout(1)).lines)
    for ms, is_press, switch in case.events:
        bench.at(ms)
        if is_press:
            bench.press(switch, (switch + 0.5) / 4)
        else:
            bench.release(switch)
    bench.at(case.events[-1][0] + 3000)
    return bench


def outcome_of(events):
    """Return key events in the notation of the file."""
    log = []
    for page, usage, modifiers, pressed in events:
        bits = modifiers if pressed and (page != 7 or usage < MODIFIERS_FROM) else 0
        name = USAGES[page, usage].name + (f"/{bits:X}" if bits else "")
        log.append(("+" if pressed else "-") + name)
    return log


def tables():
    """Return the two tables of docs/evidence/zmk.md: cases by folder, and what is different."""
    same = [f"hold-tap/{one.name}" for one in hold_tap_cases()] + [one.name for one in cases()]
    other = [name for one in DIFFERS for name in one["cases"]]
    counts = [Counter(name.split("/")[0] for name in names) for names in (same, other)]
    folders = [f"| {one} | {counts[0][one]} | {counts[1][one]} |" for one in counts[0]]
    folders.append(f"| all | {len(same)} | {len(other)} |")
    return folders, [f"| {one['what']} | {len(one['cases'])} | {one['why']} |" for one in DIFFERS]
