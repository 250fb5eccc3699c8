"""Print where a five-bar linkage's terminal is: twin.py A.toml PORT_A B.toml PORT_B

A and B are the calibrations of the strips in joint 1 and joint 2, each with its joint
(spots calibrate joint). The numbers below are those of your linkage: as drawn, or as
spots.uses.kinematics finds them from some places where the terminal was.
"""

import math
import sys
from contextlib import ExitStack
from pathlib import Path

import spots
from spots.calibrate import file
from spots.connect import prepare
from spots.uses.twin import readings

BARS_MM = (100, 100, 100, 100)  # inner 1, outer 1, outer 2, inner 2
BASE_MM = 80
OFFSET_RAD = (math.radians(-108), math.radians(-108))  # where each joint's calibration has 0
GAIN = (1.0, 1.0)


def main(arguments: list[str]) -> None:
    """Follow the terminal until Ctrl-C."""
    calibrations = [file.load(Path(name)) for name in arguments[::2]]
    encoders = [
        spots.Encoder(calibration.joint, offset_rad, gain)
        for calibration, offset_rad, gain in zip(calibrations, OFFSET_RAD, GAIN)
    ]
    twin = spots.Twin(spots.Linkage(BARS_MM, BASE_MM), encoders)
    with ExitStack() as opened:
        boards = [opened.enter_context(spots.open(port)) for port in arguments[1::2]]
        for board, calibration in zip(boards, calibrations):
            prepare(board, calibration.lines)
        for terminal in twin.follow(readings(boards)):
            if terminal.limit:
                print(terminal.limit.sentence)
            else:
                print(f"{terminal.x_mm:8.2f} {terminal.y_mm:8.2f} mm +- {terminal.sigma_mm:.2f}")


if __name__ == "__main__":
    main(sys.argv[1:])
