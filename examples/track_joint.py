"""Print a joint's angle: track_joint.py [CALIBRATION.toml [PORT]].

Make the file first: spots calibrate position, then force, then joint. Without one it is a joint
of a simulated linkage.
"""

import math
import sys
from pathlib import Path

import spots
from spots.calibrate import calibration_file as file
from spots.link.connect import prepare
from spots_sim.linkage_demo import endless

if len(sys.argv) > 1:
    calibration = file.load(Path(sys.argv[1]))
    encoder = spots.Encoder(calibration.joint)
    board = spots.open(sys.argv[2] if len(sys.argv) > 2 else None)  # None finds it on USB
    prepare(board, calibration.lines)
else:
    machine = endless()
    encoder, board = machine.encoders()[0], machine.open(0)

with board:
    for touch in board.touches():
        angle = encoder.take(touch)
        if angle is not None and angle.velocity_rad_s is not None:
            print(
                f"{math.degrees(angle.angle_rad):8.3f} deg +- {math.degrees(angle.sigma_rad):.3f}  "
                f"{math.degrees(angle.velocity_rad_s):8.2f} deg/s"
            )
