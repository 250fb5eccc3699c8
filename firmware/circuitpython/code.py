"""Starts the application on CircuitPython. Ctrl-C on the console stops it and starts the REPL."""

from spots_device.board.circuitpython import main

main()
