"""A mark in the file system: the application must not start after the next reset.

For Ctrl-C where a watchdog runs: a watchdog cannot be stopped, so the board is reset.
"""

import os

_FILE = "stay"


def stay_after_reset():
    """Keep the application from its next start."""
    open(_FILE, "w").close()


def told_to_stay():
    """Return whether `stay_after_reset` was called before the reset; remove the mark."""
    try:
        os.remove(_FILE)
    except OSError:
        return False
    return True
