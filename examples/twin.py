"""Print the position of a five-bar linkage's end point.

docs/play/linkage.md shows how to write or measure the linkage file.
"""

import argparse
import sys

import spots
from spots_linkage.twin_source import opened
from spots_sim.demo.linkage_demo import driven, endless

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument(
    "linkage", nargs="?", metavar="LINKAGE.toml", help="linkage file; default: a simulated linkage"
)
parser.add_argument(
    "ports", nargs="*", metavar="PORT", help="ports of joint 1 and joint 2; default: found on USB"
)
options = parser.parse_args()

try:
    with opened(options.linkage, options.ports) if options.linkage else driven(endless()) as source:
        for terminal in source.follow():
            if terminal.limit:
                print(terminal.limit.sentence, flush=True)
            else:
                place = f"{terminal.x_mm:8.2f} {terminal.y_mm:8.2f} mm"
                print(f"{place} +- {terminal.sigma_mm:.2f}", flush=True)
except KeyboardInterrupt:
    pass  # Ctrl-C ends it
except BrokenPipeError:
    sys.stdout = None  # the program that reads the output has ended
except spots.SpotsError as error:
    parser.error(str(error))
