"""Checks whether the MicroPython of this computer can compile to machine code (only on x86-64)."""

from __future__ import annotations

import functools
import subprocess

import pytest

from spots_sim.board.vm import micropython_command


@functools.cache
def _architecture() -> int:
    # Index in `build.ARCHITECTURES` of the machine code that MicroPython supports; 0 for none.
    code = "import sys; print(sys.implementation._mpy >> 10 & 15)"
    command = [*micropython_command(), "-c", code]
    return int(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def need_viper() -> None:
    """Skip the test if MicroPython cannot compile to machine code."""
    if not _architecture():
        pytest.skip("this MicroPython makes no machine code")
