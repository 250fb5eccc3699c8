"""Close a robot's gripper by pressing the strip.

A harder press closes the gripper further. The gripper opens when nothing presses the strip.
"""

import argparse
import sys

import spots

OPEN_MM, STEP_MM = 80.0, 1.0
LIGHT_N, FIRM_N = 0.5, 5.0  # the gripper starts to close at LIGHT_N, and is closed at FIRM_N


def opening_mm(force_N: float) -> float:
    """Return the wanted opening of the gripper in mm for a force in N."""
    share = (force_N - LIGHT_N) / (FIRM_N - LIGHT_N)
    return OPEN_MM * (1 - min(max(share, 0.0), 1.0))


def move(to_mm: float) -> None:
    """Move the gripper to an opening in mm; replace the print by your gripper's command."""
    print(f"gripper to {to_mm:5.1f} mm", flush=True)


parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument(
    "port", nargs="?", default="virtual", help="port of the board; default: a simulated board"
)
options = parser.parse_args()

at_mm = OPEN_MM
try:
    move(at_mm)
    with spots.open(options.port) as board:  # spots.open() finds the board on USB
        for touch in board.touches():
            if touch.touching and not touch.trusted:
                continue  # saturated, or several presses: the gripper does not move
            wanted_mm = opening_mm(touch.force_mN / 1000 if touch.touching else 0.0)
            if abs(wanted_mm - at_mm) >= STEP_MM:
                at_mm = wanted_mm
                move(at_mm)
except KeyboardInterrupt:
    pass  # Ctrl-C ends it
except BrokenPipeError:
    sys.stdout = None  # the program that reads the output has ended
except spots.SpotsError as error:
    parser.error(str(error))
finally:
    move(OPEN_MM)  # on every exit path
