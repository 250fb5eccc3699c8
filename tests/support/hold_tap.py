"""The cases of data/hold_tap.tsv: what keyboard firmware does with hold-tap keys."""

from pathlib import Path
from typing import NamedTuple

from spots.outputs.usages import USAGES

SWITCHES = 4


class Case(NamedTuple):
    """One case: times in ms, `events` as (ms, whether it is a press, switch)."""

    name: str
    flavor: str
    tapping_term_ms: int
    quick_tap_ms: int
    switches: list
    events: list
    outcome: list
    after_ms = 0  # all is decided when all keys are released

    def layout(self, times):
        """Return the text of a layout file with all times multiplied by `times`."""
        keys = []
        for name in self.switches:
            hold, _, tap = name.rpartition("/")
            keys.append(f'{{tap = "{tap}", hold = "{hold}"}}' if hold else f'"{tap}"')
        return (
            'name = "case"\n[tuning]\ntap_ms = 0\n'  # keyboard firmware releases a tap at once
            f'flavor = "{self.flavor}"\n'
            f"tapping_term_ms = {times * self.tapping_term_ms}\n"
            f"quick_tap_ms = {times * self.quick_tap_ms}\n"
            f'[[layer]]\nname = "a"\nkeys = [{", ".join(keys)}]\n'
        )


def cases():
    """Return all cases of the file."""
    found = []
    lines = (Path(__file__).parents[1] / "data" / "hold_tap.tsv").read_text().splitlines()
    for line in lines[3:]:
        name, flavor, term_ms, quick_ms, switches, times, outcome = line.split("\t")
        terms = int(term_ms), int(quick_ms)
        keys = switches.split()
        found.append(Case(name, flavor, *terms, keys, events_of(times), outcome.split()))
    return found


def events_of(times):
    """Return events such as ``10d2`` as (ms, whether it is a press, switch)."""
    events = []
    for word in times.split():
        at = max(word.find("d"), word.find("u"))
        events.append((int(word[:at]), word[at] == "d", int(word[at + 1 :])))
    return events


def log_of(reports):
    """Return the presses (+) and releases (-) of keys that keyboard reports show, in order."""
    log, down = [], set()
    for report in reports:
        now = {0xE0 + bit for bit in range(8) if report[0] >> bit & 1}
        now |= set(report[2:8]) - {0}
        log += [f"-{USAGES[7, usage].name}" for usage in sorted(down - now)]
        log += [f"+{USAGES[7, usage].name}" for usage in sorted(now - down)]
        down = now
    return log
