"""The chip of the page `live` against the simulator's chip, byte by byte."""

from __future__ import annotations

import json
import os
import random
import subprocess
from itertools import cycle
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from spots_sim.chip.as7341 import AS7341
from spots_sim.chip.bus import I2CBus, SimulatedClock
from spots_sim.chip.converter import DIODES, ChipNoise

pytestmark = pytest.mark.board
# More than a run of all tests can pay for: SPOTS_CHIP_SEQUENCES=10000.
SEQUENCES, STEPS = int(os.environ.get("SPOTS_CHIP_SEQUENCES", "1000")), 40
NOISES = ChipNoise(0.0, 1e12, 0.0), ChipNoise(0.6, 3000.0, 2.0, 300.0)
# Registers that a driver uses more often than others, and values that switch something.
ENABLES = 0x00, 0x01, 0x03, 0x09, 0x0B, 0x11, 0x13, 0x43
USUAL = {
    0x80: ENABLES, 0x81: (0, 1, 9, 29), 0xCA: (0xE7, 0x57), 0xCB: (1, 3), 0xA9: (0, 0x10, 0x20, 4),
    0x70: (0x00, 0x08, 0x01), 0x74: (0x04, 0x84, 0x90), 0xAA: (0, 4, 9, 10, 15), 0xAF: (0x10, 0x00),
    0xFA: (0x01, 0x02, 0x03), 0xFC: (0x7F, 0x7E, 0x02, 0x00), 0xB1: (0x88, 0x8C, 0x38),
    0xD6: (0, 1, 3, 255),
    0xF9: (0x00, 0x08, 0x0C), 0xAC: (0x0C, 0x1C), 0x93: (0xFF, 0x08), 0x85: (1, 0), 0x87: (3, 0xFF),
    0xBD: (0, 1, 2), 0xB3: (0xF2, 0x02), 0xCF: (0x99, 0x94), 0xD7: (0x21, 0xA1), 0x83: (0, 1),
}  # fmt: skip
READS = (
    (0x94, 13),
    (0xFD, 15),
    (0xFE, 14),
    (0xFE, 60),
    (0x80, 1),
    (0x93, 1),
    (0xA3, 5),
    (0x60, 16),
    (0x00, 20),
)


def drawn_sequence(rng: random.Random) -> list:
    """Return random steps: registers of a driver, others too, waits, light, and power failures."""
    steps = [
        ["wait", 250],
        ["write", 0x39, [0x00, *(rng.choice((0, 1, 0x12, 0x34, 0x56)) for _ in range(20))]],
    ]
    steps += [
        ["write", 0x39, [0xCA, 0x57, rng.choice((0, 1))]],
        ["write", 0x39, [0x80, 0x11]],
        ["wait", 300],
    ]
    steps += [["write", 0x39, [0xFC, 0x7F]], ["write", 0x39, [0x80, 0x03]]]
    for _ in range(STEPS):
        kind = rng.random()
        if kind < 0.35:
            register = rng.choice(list(USUAL))
            steps.append(["write", 0x39, [register, rng.choice(USUAL[register])]])
        elif kind < 0.4:
            # The exposure stays above 1 ms, because thousands of samples would be slow.
            register = rng.choice([r for r in range(256) if r not in (0x81, 0xCA, 0xCB)])
            steps.append(["write", 0x39, [register, rng.randrange(256)]])
        elif kind < 0.6:
            steps.append(["read", 0x39, *rng.choice(READS)])
        elif kind < 0.65:
            steps.append(["read", 0x39, rng.randrange(256), rng.randrange(1, 20)])
        elif kind < 0.85:
            steps.append(["wait", rng.choice((7, 90, 1500, 5000, 21_000))])
        elif kind < 0.97:
            diodes = rng.sample(DIODES, 4)
            steps.append(["light", {one: rng.choice((0.01, 2.0, 40.0, 3e4)) for one in diodes}])
        elif kind < 0.99:
            steps.append(["write", rng.choice((0x38, 0x70)), [0x80]])
        else:
            steps.append(["power"])
    return steps


class Light:
    """Constant rates of the diodes, which grow with the current of the LED."""

    def __init__(self):
        self.rates: dict[str, float] = {}

    def collect(self, start_us, end_us, led_mA):
        return {one: r * (1 + led_mA) * (end_us - start_us) / 1000 for one, r in self.rates.items()}


def answers(sequence: dict) -> list:
    """Run a sequence on the chip of the simulator."""
    light, clock, draws = Light(), SimulatedClock(), cycle(sequence["draws"])
    rng = SimpleNamespace(standard_normal=lambda n: np.array([next(draws) for _ in range(n)]))
    chip = AS7341(light, ChipNoise(**sequence["noise"]), rng)
    bus = I2CBus(chip, clock)

    def turn(rates):
        chip.advance(clock.now_us())
        light.rates = rates

    def read(address, register, size):
        return list(bus.write_read(address, bytes((register,)), size))

    does = {
        "wait": clock.spend_us,
        "light": turn,
        "power": lambda: chip.power_on(clock.now_us()),
        "write": lambda address, data: bus.write(address, bytes(data)) or 0,
        "read": read,
    }
    found = []
    for name, *given in sequence["steps"]:
        try:
            answer = does[name](*given)
        except OSError as error:
            answer = error.errno
        found.append([answer, clock.now_us()])
    return found


def test_random_accesses_give_the_bytes_of_the_simulators_chip(node):
    # Fails if a register, the FIFO, saturation, a flag, the SMUX, the LED or the noise differs.
    rng = random.Random("accesses of a driver")
    fields = "read_counts", "electrons_per_count_1x", "dark_counts_512x", "ratio_ppm"
    sequences = [
        {
            "noise": {field: getattr(NOISES[i % 2], field) for field in fields},
            "draws": [rng.gauss(0, 1) for _ in range(97)],
            "steps": drawn_sequence(rng),
        }
        for i in range(SEQUENCES)
    ]
    text = "\n".join(map(json.dumps, sequences))
    script = Path(__file__).with_name("chip.mjs")
    run = subprocess.run([node, script], input=text, capture_output=True, text=True, check=True)
    there = list(map(json.loads, run.stdout.splitlines()))
    assert len(there) == SEQUENCES
    read = 0
    for sequence, found in zip(sequences, there):
        wanted = answers(sequence)
        assert found == wanted, next(
            (step, one, other)
            for step, one, other in zip(sequence["steps"], found, wanted)
            if one != other
        )
        read += sum(any(answer) for answer, _ in wanted if isinstance(answer, list))
    assert read > 3 * SEQUENCES  # the sequences read counts, not only zeros
