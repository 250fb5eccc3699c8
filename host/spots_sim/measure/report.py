"""Prints the tables of a characterisation, and the progress of its steps."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich import box
from rich.console import Console, Group
from rich.table import Table

from spots.common.cursor import cursor_shown


def show(summary: dict) -> None:
    """Print the tables of a `measurements.Run.summary`."""
    Console(highlight=False).print(tables(summary))


def tables(summary: dict) -> Group:
    """Return the tables of a `measurements.Run.summary`, for the package rich to print."""
    position, force, joint = summary["position"], summary["force"], summary["joint"]
    pair = position["one_pair"]
    figures = Table(box=box.SIMPLE_HEAD, title=_conditions(summary), title_justify="left")
    figures.add_column("")
    figures.add_column("", justify="right")
    for name, value in {
        "position: R² of the response": f"{position['r2']:.7f}",
        "position: resolution": f"{position['resolution_um']:.1f} µm",
        "position: accuracy": f"{position['accuracy_um']:.1f} µm",
        "position: scatter / bound": f"{position['crb_ratio']:.2f}",
        "position: rms error / bound": f"{position['rms_ratio']:.2f}",
        "position: untrusted": f"{position['untrusted_percent']:.1f} %",
        f"  scatter / bound of one pair, {'/'.join(pair['channels'])}": f"{pair['crb_ratio']:.2f}",
        "signal to noise": f"{summary['snr_db']:.1f} dB",
        "force: resolution": f"{force['resolution_mN']:.1f} mN",
        "force: bound of the resolution": f"{force['bound_mN']:.1f} mN",
        "force: accuracy": f"{force['accuracy_N']:.3f} N",
        "force: dead zone": f"{force['threshold_mN']:.0f} mN",
        "joint: R²": f"{joint['r2']:.7f}",
        "joint: resolution": f"{joint['resolution_deg']:.4f}°",
        "joint: accuracy": f"{joint['accuracy_deg']:.4f}°",
        "joint: backlash": f"{joint['backlash_deg']:.4f}°",
    }.items():
        figures.add_row(name, value)
    return Group(
        figures,
        _row("strain (%)", "accuracy (µm)", summary["strain"]),
        _row("bend (°)", "accuracy (µm)", summary["bend"]),
    )


def _conditions(summary: dict) -> str:
    return (
        f"{summary['reading_ms']:g} ms a reading: {summary['average']} x "
        f"{summary['exposure_us'] / 1000:g} ms, gain {summary['gain']}, {summary['led_mA']} mA, "
        f"channels {' '.join(summary['plan'])}"
    )


def _row(first: str, second: str, rows: list[dict]) -> Table:
    table = Table(first, box=box.SIMPLE_HEAD)
    for row in rows:
        table.add_column(f"{next(iter(row.values())):g}", justify="right")
    table.add_row(second, *(f"{row['accuracy_um']:.1f}" for row in rows))
    return table


@contextmanager
def progress() -> Iterator[Callable[[str], None]]:
    """Yield a function that shows the name of a step on stderr, if stderr is a terminal."""
    if not sys.stderr.isatty():
        yield lambda step: None
        return
    console = Console(stderr=True)
    with cursor_shown(console), console.status("") as status:
        yield lambda step: status.update(f"{step} ...")
