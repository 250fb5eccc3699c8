"""Print where a five-bar linkage's terminal is: twin.py [LINKAGE.toml [PORT_1 PORT_2]].

docs/fivebar.md shows how to write or find the file. Ports are in the order of the joints; boards on
USB are found, if not given. Without a file it is a simulated linkage.
"""

import sys

from spots.linkage.twin_source import driven, opened
from spots_sim.linkage_demo import endless

linkage, ports = sys.argv[1:2], sys.argv[2:]
with opened(linkage[0], ports) if linkage else driven(endless()) as source:
    for terminal in source.follow():
        if terminal.limit:
            print(terminal.limit.sentence)
        else:
            print(f"{terminal.x_mm:8.2f} {terminal.y_mm:8.2f} mm +- {terminal.sigma_mm:.2f}")
