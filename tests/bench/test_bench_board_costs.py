"""``board_costs.py`` runs on the virtual board. Its times are 0 there, so only its rows count."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from bench import board_inputs
from spots.link.board import Board
from spots_device.reading import decode
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.scenario import Held

pytestmark = pytest.mark.board

SCRIPT = Path(board_inputs.__file__).with_name("board_costs.py")
FEWER = {"_CALLS": 3, "_LOOP_MS": 50, "_START_MS": 300}
INDICES = decode.COUNTS, decode.USE, decode.AVERAGE
LIMIT_S = 60.0  # simulated
# Each loop, and each kind of function.
ROWS = {
    *(f"loop, {us} us" for us in (10_000, 5_000, 2_780, 1_500, 1_000)),
    *(f"loop, {use}, {n} fingers" for use in ("contacts", "keys") for n in range(3)),
    "loop, stream touch spectrum",
    "Strip.take, used",
    "Framer.contact",
    "Framer.spectrum",
    "command set keys=1",
    "Calibration",
}


def test_the_costs_of_a_board_can_be_measured(tmp_path, sensor, calibration, monkeypatch):
    monkeypatch.setenv("SPOTS_VIRTUAL_RUNTIME", "micropython")
    link = LockstepLink(sensor, Held(), folder=tmp_path)
    with Board(link) as board:
        board_inputs.write(tmp_path, sensor, list(calibration))
        script = SCRIPT.read_text(encoding="utf-8")
        for name, value in FEWER.items():
            script, count = re.subn(rf"(?m)^{name} = \d+", f"{name} = {value}", script)
            assert count == 1
        assert "_COUNTS, _USE, _AVERAGE = %d, %d, %d\n" % INDICES in script
        (tmp_path / "main.py").write_text(script + "\nwhile True:\n    time.sleep(1)\n")
        board.command("reboot")
        printed = b""
        while b"\nend" not in printed and link.now_s() < LIMIT_S:
            printed += link.read(1.0)
    rows = re.findall(r"^(.{44}) +(-?\d+\.\d)", printed.decode(errors="replace"), re.M)
    assert {name.strip() for name, _ in rows} >= ROWS, printed[-2000:]
