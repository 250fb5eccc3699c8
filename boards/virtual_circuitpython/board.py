"""`board` of the virtual board: pins by the names that are printed on one."""

import _simulator
from microcontroller import Pin

SCL = Pin(_simulator.SCL)
SDA = Pin(_simulator.SDA)
BUTTON = Pin()
D5 = Pin(_simulator.STRIP_LED)
