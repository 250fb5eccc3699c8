"""Print where the strip is pressed and how hard: python examples/read_touches.py [PORT]."""

import sys

import spots

port = sys.argv[1] if len(sys.argv) > 1 else "virtual"  # a simulated board; None finds yours
with spots.open(port) as board:
    for touch in board.touches():
        if touch.trusted:
            place_mm, force_N = touch.position_um / 1000, touch.force_mN / 1000
            print(f"{touch.time_s:10.3f} s  {place_mm:7.3f} mm  {force_N:6.3f} N")
