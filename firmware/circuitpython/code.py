"""Entry on CircuitPython. Ctrl-C on the console stops the application and leaves the REPL."""

from spots_device.runtime.circuitpython import main

main()
