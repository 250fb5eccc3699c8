"""Print position and force of each press on the strip."""

import argparse
import sys

import spots

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument(
    "port", nargs="?", default="virtual", help="port of the board; default: a simulated board"
)
options = parser.parse_args()

try:
    with spots.open(options.port) as board:  # spots.open() finds the board on USB
        for touch in board.touches():
            if touch.trusted:
                place_mm, force_N = touch.position_um / 1000, touch.force_mN / 1000
                print(f"{touch.time_s:10.3f} s  {place_mm:7.3f} mm  {force_N:6.3f} N", flush=True)
except KeyboardInterrupt:
    pass  # Ctrl-C ends it
except BrokenPipeError:
    sys.stdout = None  # the program that reads the output has ended
except spots.SpotsError as error:
    parser.error(str(error))
