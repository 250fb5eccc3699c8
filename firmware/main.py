"""Entry on MicroPython. Ctrl-C stops the application and leaves the REPL."""

from spots_device.runtime.micropython import main

main()
