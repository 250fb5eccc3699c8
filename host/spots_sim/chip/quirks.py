"""What no document of the AS7341 defines: a driver must work with every value."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Quirks:
    """Behaviour of the chip that no document defines, and the error of its oscillator.

    - `auto_zero_at_every_start`: if false, the chip performs an auto-zero only at the first start
      after power-on, and after the register bit PON was 0.
    - `avalid_clears_on_read`: a read of the register ASTATUS clears the data-ready bit AVALID.
    - `aint_needs_sp_ien`: the interrupt bit AINT is set only if its enable bit SP_IEN is 1.
    - `smux_us`: duration of a command to the SMUX, which connects photodiodes to ADCs.
    - `clock_error_percent`: error of the sample period; positive if the oscillator is slow.
    - `fifo_reversed`: the FIFO gets the values of a sample in reverse order, CH5 before CH0.
    - `fifo_overwrites`: a full FIFO drops its oldest entry; if false, it drops the new entry.
    - `fifo_level_alone`: a transfer that reads the FIFO's level reads it again and again; if false,
      the transfer goes on with the data, like a transfer from any other register.
    """

    auto_zero_at_every_start: bool = True
    avalid_clears_on_read: bool = False
    aint_needs_sp_ien: bool = True
    smux_us: float = 200.0
    clock_error_percent: float = 0.0
    fifo_reversed: bool = False
    fifo_overwrites: bool = False
    fifo_level_alone: bool = False
