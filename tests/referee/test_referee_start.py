"""The registers that another program left in the chip change neither the samples nor their rate."""

from __future__ import annotations

import random

import pytest
from support.witnesses import GAIN_1X_OF_64, LED_OFF, Labelled, silent_chip

from spots.link.board import Board
from spots.link.frames import Spectrum
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.scenario import Held

EXPOSURE_US = 10_000
BOARDS = ["virtual", "virtual_circuitpython"]
BANK = 0xA9, 0x10
# Writable registers, DS000504: of bank 1, the SMUX RAM, and of bank 0.
BANK_1 = (0x70, 0x72, 0x73, 0x74)
WRITABLE = (
    *range(0x14),
    *(0x80, 0x81, 0x83, 0x84, 0x85, 0x86, 0x87, 0x93, 0xA9, 0xAA, 0xAC, 0xAF, 0xB1, 0xB2, 0xB3),
    *(0xB5, 0xBD, 0xBE, 0xCA, 0xCB, 0xCF, 0xD6, 0xD7, 0xD8, 0xDA, 0xF9, 0xFA, 0xFC),
)  # fmt: skip
# Each changes the samples of a driver that does not write this register.
SINGLE = {
    "bank 1 is selected": [BANK],
    "low power and long waits": [(0xA9, 0x24)],
    "running with waits": [(0x83, 0xFF), (0x80, 0x0B)],
    "flicker detector": [(0x80, 0x41)],
    "auto-zero before each sample": [(0xD6, 1)],
    "auto-zero before each second sample": [(0xD6, 2)],
    "FIFO of the flicker detector": [(0xD7, 0xA1)],
    "FIFO of seven values, full": [(0xFC, 0xFF), (0x80, 0x03)],
    "interrupts after 60 samples": [(0xF9, 0x8F), (0xBD, 0x0F)],
    "sleep after an interrupt": [(0xAC, 0x1C), (0xF9, 0x08), (0x80, 0x03)],
    "sync mode SYNS": [BANK, (0x70, 0x01), (0xA9, 0)],
    "sync mode SYND": [BANK, (0x70, 0x03), (0xA9, 0)],
    "automatic gain": [(0xB1, 0x8C), (0xB3, 0x02), (0x80, 0x03)],
    "a pending command of the SMUX": [(0xAF, 0x08), (0x80, 0x11)],
}


def write(chip, registers):
    for register, value in registers:
        chip.write(bytes((register, value)))


def samples_of(sensor, registers, board):
    """Return counts and flags of the lit samples of 1 s, and what `get` counts, after a start."""
    link = LockstepLink(sensor, Held(), board=board)
    chip = silent_chip(Labelled(EXPOSURE_US))
    link.bus.chip = link.chip = chip
    link.clock.spend_us(1_000)
    chip.advance(link.clock.now_us())
    write(chip, registers)
    link.clock.spend_us(300_000)
    chip.advance(link.clock.now_us())
    with Board(link) as connected:
        connected.command(f"set exposure_us={EXPOSURE_US} gain={GAIN_1X_OF_64}")
        connected.command("stream spectrum")
        read = [f for f in connected.frames(seconds=1.0) if isinstance(f, Spectrum)]
        state = connected.command("get")
    lit = [(tuple(frame.counts), frame.flags) for frame in read if not frame.flags & LED_OFF]
    return lit, {name: state[name] for name in ("missed", "fifo", "fault", "faults", "saturation")}


@pytest.fixture(scope="module", params=BOARDS)
def clean(request, sensor):
    """A board, and the samples of its chip after power-on."""
    lit, state = samples_of(sensor, (), request.param)
    assert len(lit) > 85
    assert state == {"missed": 0, "fifo": 1, "fault": None, "faults": 0, "saturation": None}
    return request.param, (lit, state)


@pytest.mark.board
@pytest.mark.parametrize("registers", SINGLE.values(), ids=SINGLE)
def test_one_foreign_register(sensor, clean, registers):
    board, expected = clean
    assert samples_of(sensor, registers, board) == expected


@pytest.mark.board
@pytest.mark.parametrize("seed", range(12))
def test_all_registers_are_foreign(sensor, clean, seed):
    board, expected = clean
    rng = random.Random(seed)
    registers = [BANK]
    registers += [(register, rng.randrange(256)) for register in BANK_1]
    registers += [(0xA9, 0)]
    order = rng.sample(WRITABLE, len(WRITABLE))
    registers += [(register, rng.randrange(256)) for register in order]
    assert samples_of(sensor, registers, board) == expected


def test_a_rate_that_is_not_reached_is_a_fault(sensor):
    """A register that changes later: the board sets up the sensor again, and reports the fault."""
    link = LockstepLink(sensor, Held())
    link.bus.chip = link.chip = silent_chip(Labelled(EXPOSURE_US))
    with Board(link) as board:
        board.command(f"set exposure_us={EXPOSURE_US} gain={GAIN_1X_OF_64} led=always")
        board.command("stream spectrum")
        list(board.frames(seconds=1.0))
        assert board.command("get")["faults"] == 0
        write(link.chip, [(0xD6, 1)])
        list(board.frames(seconds=3.0))
        assert board.command("get")["faults"] == 1
        assert "the AS7341 samples every 11" in board.log[-2]["text"]
        assert len([f for f in board.frames(seconds=1.0) if isinstance(f, Spectrum)]) > 97
        assert board.command("get")["faults"] == 1
