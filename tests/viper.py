"""Whether the MicroPython of this computer can make machine code (only on x86-64)."""

from __future__ import annotations

import functools
import subprocess

import pytest

from spots_sim.vm import micropython_command


@functools.cache
def _architecture() -> int:
    # Place of its native code in build.ARCHITECTURES.
    code = "import sys; print(sys.implementation._mpy >> 10 & 15)"
    command = [*micropython_command(), "-c", code]
    return int(subprocess.run(command, capture_output=True, text=True, check=True).stdout)


def need_viper() -> None:
    """Skip the test where there is no emitter."""
    if not _architecture():
        pytest.skip("this MicroPython makes no machine code")
