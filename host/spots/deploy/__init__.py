"""Firmware onto a board and off it: build, flash, erase, doctor."""
