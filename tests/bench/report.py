"""Formats the results of the benchmark as tables."""

from __future__ import annotations

import io

from rich import box
from rich.console import Console
from rich.table import Table

_WIDTH = 100
_PATHS = {
    "spots": "spots, a TOUCH frame",
    "spots_viper": "the same, as machine code",
    "float_json": "floats, a line of JSON",
    "float_struct": "floats, a packed struct",
}


def report(results: dict) -> str:
    """Return the results of `bench.run` as a text with one table for each benchmark."""
    tables = (
        _driver(results["driver"]),
        _firmware(results["firmware"]),
        _boards(results["boards"]),
        _host(results["host"]),
        _linkage(results["linkage"]),
    )
    return "\n\n".join(_text(table) for table in tables)


def _text(table: Table) -> str:
    console = Console(file=io.StringIO(), width=_WIDTH, color_system=None)
    console.print(table)
    return "\n".join(line.rstrip() for line in console.file.getvalue().rstrip().splitlines())


def _table(title: str, caption: str, first: str, *others: str) -> Table:
    table = Table(title=title, caption=caption, box=box.SIMPLE_HEAD, title_justify="left")
    table.caption_justify = "left"
    table.add_column(first)
    for name in others:
        table.add_column(name, justify="right")
    return table


def _driver(results: dict) -> Table:
    table = _table(
        "Driver: a reading over a 400 kHz bus, simulated time",
        "",
        "integration",
        "channels",
        "transactions",
        "wire bytes",
        "bus ms",
        "Hz",
        "integrating",
    )
    ratios = []
    for at in results["integrations"]:
        for name in ("spots", "adafruit"):
            cost = at[name]
            table.add_row(
                f"{at['integration_ms']:g} ms, {name}",
                str(cost["channels"]),
                f"{cost['transactions_per_reading']:.1f}",
                f"{cost['wire_bytes_per_reading']:.1f}",
                f"{cost['bus_ms_per_reading']:.2f}",
                f"{cost['rate_Hz']:.1f}",
                f"{cost['integrating_fraction']:.1%}",
            )
        ratios.append(
            f"At {at['integration_ms']:g} ms, spots has {at['rate_ratio']:.1f} times the rate; "
            f"{at['rate_ratio_if_auto_zero_once']:.1f} times if the chip does auto-zero only once."
        )
    table.caption = "\n".join(ratios)
    return table


def _firmware(results: dict) -> Table:
    table = _table(
        "Firmware: a sample in MicroPython on this machine",
        "Floats run in hardware here, which favours their times; heap is counted in 64-bit words.",
        "path",
        "heap bytes",
        "bytes sent",
        "VM us",
        "after the read",
        "arithmetic, framing",
    )
    if "spots_viper" in results:
        ratio = results["spots_viper"]["vm_time_ratio_of_portable_from_sums"]
        table.caption += f"\nMachine code makes arithmetic and framing {ratio:.1f} times faster."
    for name, label in _PATHS.items():
        if name not in results:
            continue  # this MicroPython cannot compile to machine code
        cost = results[name]
        from_sums_us = cost.get("vm_us_per_sample_from_sums")
        table.add_row(
            label,
            f"{cost['heap_bytes_per_sample']:.0f}",
            f"{cost['wire_bytes_per_sample']:.1f}",
            f"{cost['vm_us_per_sample']:.1f}",
            f"{cost['vm_us_per_sample_from_counts']:.1f}",
            "" if from_sums_us is None else f"{from_sums_us:.1f}",
        )
    return table


def _boards(results: dict) -> Table:
    table = _table(
        "Boards: memory that the firmware needs",
        "Heap of the running firmware, estimated for words of 32 bits.",
        "board",
        ".mpy bytes",
        "heap bytes",
        "calibrated",
    )
    for name, spent in results.items():
        table.add_row(name, *(f"{count:,}" for count in spent.values()))
    return table


def _host(results: dict) -> Table:
    table = _table(
        "Host: readings decoded on this machine",
        f"Frames have {results['rate_ratio']:.2f} times the rate of JSON, arrays of a recording "
        f"{results['arrays']['rate_ratio']:.0f} times.",
        "format",
        "bytes",
        "readings/s",
    )
    for name, label in {"spots": "spots, checked frames", "json": "lines of JSON"}.items():
        cost = results[name]
        table.add_row(label, f"{cost['bytes_per_reading']:.1f}", f"{cost['readings_per_s']:,}")
    table.add_row("arrays of a recording", "", f"{results['arrays']['readings_per_s']:,}")
    return table


def _linkage(results: dict) -> Table:
    over = {name: results[f"rate_ratio_over_{name}"] for name in ("calls", "math")}
    table = _table(
        "Linkage: terminals from angles on this machine",
        f"One call with an array has {over['calls']:.0f} times the rate of one call for each "
        f"sample, and {over['math']:.0f} times that of the bare formula.",
        "way",
        "terminals/s",
    )
    for name, label in {
        "array": "one call for a million samples",
        "calls": "one call for each sample",
        "math": "the bare formula with math, for each sample",
    }.items():
        table.add_row(label, f"{results[name]['terminals_per_s']:,}")
    return table
