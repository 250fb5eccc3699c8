"""Print where a five-bar linkage's terminal is.

docs/fivebar.md shows how to write the linkage file, or how to measure it.
"""

import argparse

import spots
from spots.linkage.twin_source import opened
from spots_sim.linkage_demo import driven, endless

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument(
    "linkage", nargs="?", metavar="LINKAGE.toml", help="a simulated linkage if not given"
)
parser.add_argument(
    "ports", nargs="*", metavar="PORT", help="of joint 1, then joint 2; found if not given"
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
except spots.SpotsError as error:
    parser.error(str(error))
