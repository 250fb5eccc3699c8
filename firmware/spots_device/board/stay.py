"""A marker file that prevents the start of the application after the next reset.

The file is created on Ctrl-C while a watchdog runs: a watchdog cannot be stopped, so Ctrl-C must
reset the board.
"""

import os

_FILE = "stay"


def stay_after_reset():
    """Create a marker file, so that the application does not start after the next reset."""
    open(_FILE, "w").close()


def must_stay():
    """Remove the marker file of `stay_after_reset`; return whether it existed."""
    try:
        os.remove(_FILE)
    except OSError:
        return False
    return True
