"""Ctrl-C where a watchdog runs, which cannot be stopped: a reset, and no application after it."""

import os

_FILE = "stay"


def stay_after_reset():
    """Keep the application from its next start."""
    open(_FILE, "w").close()


def told_to_stay():
    """Return whether `stay_after_reset` was called before the reset; forget it."""
    try:
        os.remove(_FILE)
    except OSError:
        return False
    return True
