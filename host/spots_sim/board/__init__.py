"""Virtual boards: the firmware in MicroPython or CPython, in simulated or real time."""
