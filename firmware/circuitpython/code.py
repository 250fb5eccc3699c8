"""Entry on CircuitPython. Ctrl-C on the console stops the application and leaves the REPL."""

from tactile.runtime.circuitpython import main

main()
