"""Simulated strip, chip and board. The chip shares no code with the firmware's driver.

>>> import spots_sim
>>> with spots_sim.open(seed=1) as board:
...     board.info["board"]
'virtual'
"""

from importlib import import_module

__all__ = ["open"]


def open(sensor: str = "default", scenario: str = "demo", seed: int = 0):
    """Start a virtual board in real time, and open it; ``spots.open("virtual")`` has the defaults.

    Parameters
    ----------
    sensor, scenario : str
        Sensor file (the strip) and scenario file (the presses): each a path, or the name of a file
        in the package.
    seed : int
        Seed of the noise, 0 or more.

    Returns
    -------
    spots.Board
        The connected board. Close it, or use it in a ``with`` block.

    Raises
    ------
    SpotsError
        If a file is missing or invalid, `seed` is negative, or the board does not start.
    """
    # Late: the processes of virtual boards import this package, too.
    return import_module(".demo.virtual", __name__).open_virtual(sensor, scenario, seed)[0]
