"""Module `board` of the virtual board: its pins by name."""

import _simulator
from microcontroller import Pin

SCL = Pin(_simulator.SCL)
SDA = Pin(_simulator.SDA)
BUTTON = Pin()
D5 = Pin(_simulator.STRIP_LED)
