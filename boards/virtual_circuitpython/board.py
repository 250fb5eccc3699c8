"""Module `board` of the virtual board: its pins by name."""

import _simulator
from microcontroller import Pin

SCL = Pin(_simulator.SCL)
SDA = Pin(_simulator.SDA)
BUTTON = Pin()
SCL1 = Pin(_simulator.WIRES + _simulator.SCL)
SDA1 = Pin(_simulator.WIRES + _simulator.SDA)
D5 = Pin(_simulator.STRIP_LED)
D6 = Pin(_simulator.STRIP_LED + 1)
