"""`board` of the virtual board: pins by the names that are printed on one."""

from microcontroller import Pin

SCL = Pin()
SDA = Pin()
BUTTON = Pin()
