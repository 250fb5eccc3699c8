"""Entry on MicroPython. Ctrl-C stops the application and leaves the REPL."""

from tactile.runtime.micropython import main

main()
