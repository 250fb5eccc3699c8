"""Starts the application on MicroPython. Ctrl-C stops it and returns to the REPL."""

from spots_device.board.micropython import main

main()
