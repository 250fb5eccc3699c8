"""Print the angle of a joint, its standard deviation and its velocity.

For a real joint, calibrate first: spots calibrate position, then force, then joint.
"""

import argparse
import math
import sys
from pathlib import Path

import spots
from spots.calibrate import calibration_file as file
from spots.link.connect import prepare
from spots_linkage import Encoder
from spots_sim.demo.linkage_demo import endless

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument(
    "calibration",
    nargs="?",
    type=Path,
    metavar="CALIBRATION.toml",
    help="calibration with a joint; default: a simulated joint",
)
parser.add_argument("port", nargs="?", help="port of the board; default: the board on USB")
options = parser.parse_args()

try:
    if options.calibration:
        calibration = file.load(options.calibration)
        encoder = Encoder(calibration.joint)
        board = spots.open(options.port)
        prepare(board, calibration.lines)
    else:
        machine = endless()
        encoder, board = machine.encoders()[0], machine.open(0)

    with board:
        for touch in board.touches():
            angle = encoder.take(touch)
            if angle is not None and angle.velocity_rad_s is not None:
                print(
                    f"{math.degrees(angle.angle_rad):8.3f} deg "
                    f"+- {math.degrees(angle.sigma_rad):.3f}  "
                    f"{math.degrees(angle.velocity_rad_s):8.2f} deg/s",
                    flush=True,
                )
except KeyboardInterrupt:
    pass  # Ctrl-C ends it
except BrokenPipeError:
    sys.stdout = None  # the program that reads the output has ended
except spots.SpotsError as error:
    parser.error(str(error))
