"""Close a robot's gripper by pressing the strip: python examples/gripper.py [PORT].

The harder the press, the narrower the gripper; let go, and it opens.
"""

import sys

import spots

OPEN_MM, STEP_MM = 80.0, 1.0
LIGHT_N, FIRM_N = 0.5, 5.0  # a press at which it begins to close, and one at which it is closed


def opening_mm(force_N: float) -> float:
    """Return how far the gripper is to be open."""
    share = (force_N - LIGHT_N) / (FIRM_N - LIGHT_N)
    return OPEN_MM * (1 - min(max(share, 0.0), 1.0))


def move(to_mm: float) -> None:
    """Put your gripper's own command here."""
    print(f"gripper to {to_mm:5.1f} mm", flush=True)


port = sys.argv[1] if len(sys.argv) > 1 else "virtual"  # a simulated board; None finds yours
at_mm = OPEN_MM
move(at_mm)
try:
    with spots.open(port) as board:
        for touch in board.touches():
            if touch.touching and not touch.trusted:
                continue  # saturated, or not one press: the gripper stays where it is
            wanted_mm = opening_mm(touch.force_mN / 1000 if touch.touching else 0.0)
            if abs(wanted_mm - at_mm) >= STEP_MM:
                at_mm = wanted_mm
                move(at_mm)
finally:
    move(OPEN_MM)  # whatever ended this
