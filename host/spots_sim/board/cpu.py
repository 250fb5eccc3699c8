"""Measured processor times of the firmware's functions on real boards, from `data/cpus.toml`.

On a virtual board with a `Cpu`, simulated time advances at the end of each call of a measured
function, by the time of this function. So events within a pass of the firmware's loop are about as
late as on the real board.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import msgspec

from spots.common import toml
from spots.deploy.staging import device_of
from spots.errors import SettingError

_FILE = Path(__file__).parents[1] / "data" / "cpus.toml"
_Time = Annotated[float, msgspec.Meta(ge=0, le=10_000_000)]


class Cpu(toml.Strict):
    """Processor times of a board.

    `call_us` has the time of each function of the firmware's package by name, without that of other
    functions in it; some functions have times by kind of call, see ``boards/_virtual/_cpu.py``.
    `bus_us` is the time of an I2C transfer in addition to its bits on the wire. With `like`, the
    times are those of another processor multiplied by `times`.
    """

    call_us: dict[str, _Time | dict[str, _Time]] = {}
    bus_us: _Time = 0.0
    like: str | None = None
    times: Annotated[float, msgspec.Meta(gt=0, le=1000)] = 1.0

    def transfer_us(self) -> float:
        """Return the processor time of an I2C transfer in us, without the time of its bits."""
        return self.times * self.bus_us

    def times_us(self) -> dict[str, int | dict[str, int]]:
        """Return the time of each function in whole us, by its name; see `call_us`."""
        return {
            name: {kind: round(self.times * us) for kind, us in time_us.items()}
            if isinstance(time_us, dict)
            else round(self.times * time_us)
            for name, time_us in self.call_us.items()
        }


class _CpusFile(toml.Strict):
    cpus: dict[str, Cpu]


def load(name: str, board: str) -> Cpu:
    """Return a processor of `data/cpus.toml`, such as ``pico``, for a virtual board.

    SettingError if it is unknown, or if the board runs CircuitPython, whose times are unknown.
    """
    known = toml.checked(_FILE.read_text(encoding="utf-8"), _CpusFile, "processor", _FILE).cpus
    if name not in known:
        raise SettingError(f"there is no processor '{name}': use one of {', '.join(known)}")
    if device_of(board).runtime != "micropython":
        raise SettingError(
            f"the times of the processor '{name}' are known only for MicroPython: leave out the "
            "processor, or use the board 'virtual'"
        )
    cpu = known[name]
    if cpu.like:
        return msgspec.structs.replace(known[cpu.like], times=cpu.times)
    return cpu
