"""``make bench``: measures driver, firmware and host package, and common alternatives to each."""

from __future__ import annotations

import sys

from .report import report

__all__ = ["report", "run"]


def run() -> dict:
    """Run all benchmarks; if stderr is a terminal, show there which benchmark runs.

    Returns
    -------
    dict
        ``driver``, ``firmware``, ``host`` and ``linkage``: the results of the modules with these
        names. ``boards``: results of `space`. ``host`` also contains the results of `arrays`.

    Raises
    ------
    SpotsError
        If Adafruit's driver, MicroPython or mpy-cross is not installed.
    """
    from spots_sim.board.vm import micropython_command
    from spots_sim.person.stage import calibrate
    from spots_sim.strip.files import SensorFile, load

    from . import arrays, driver, firmware, host, linkage, space
    from .adafruit import published

    published()
    micropython_command()
    sensor = load(SensorFile, "default")
    _say("boards: flash and heap that the firmware needs")
    calibration = firmware.for_canned_board(calibrate(sensor))
    boards = space.measure(calibration)
    _say("driver: our firmware and Adafruit's driver on the simulated sensor")
    on_the_bus = driver.measure(sensor)
    _say("firmware: integers and floats in MicroPython")
    on_the_board, stream = firmware.measure(sensor, calibration)
    _say("host: frames and lines of JSON")
    on_the_host = host.measure(stream)
    on_the_host["arrays"] = arrays.measure(stream)
    _say("linkage: arrays and loops")
    return {
        "driver": on_the_bus,
        "firmware": on_the_board,
        "boards": boards,
        "host": on_the_host,
        "linkage": linkage.measure(),
    }


def _say(what: str) -> None:
    if sys.stderr.isatty():
        print(f"bench: {what} ...", file=sys.stderr, flush=True)
