"""What both runtimes share: constants of the board, bus recovery, safe boot, the end of a run."""

from .stay import stay_after_reset

ADDRESS = 0x39  # of the AS7341, 7 bits
CAPS_LOCK = 2  # HID usage tables, LED page, as a keyboard's output report has it
HALF_CLOCK_US = 5  # of the clock that frees the bus
WATCHDOG_MS = 8_000  # the longest that the RP2040 has

_RECOVERY_CLOCKS = 9
# Held at the reset itself, a boot button starts the chip's own loader: so there is time to press.
_SAFE_BOOT_MS = 500
_SAFE_BOOT_STEP_MS = 20
_AFTER_CRASH_MS = 1_000  # for Ctrl-C, when it crashes again and again
_CRASH_CHARACTERS = 300  # the end of a traceback; more would not fit a frame


def free_bus(scl, sda, is_high, put):
    """Clock out a chip that holds SDA low in the middle of a byte, then send a STOP.

    Source: UM10204, section 3.1.16.

    Parameters
    ----------
    scl, sda : object
        Open-drain pins.
    is_high : callable
        ``is_high(pin) -> bool``.
    put : callable
        ``put(pin, level)``; waits for `HALF_CLOCK_US`.
    """
    for _ in range(_RECOVERY_CLOCKS):
        if is_high(sda):
            break
        put(scl, 0)
        put(scl, 1)
    for pin, level in ((scl, 0), (sda, 0), (scl, 1), (sda, 1)):
        put(pin, level)


def is_held(pressed, sleep_ms):
    """Return whether a button is pressed within half a second.

    Parameters
    ----------
    pressed, sleep_ms : callable
    """
    for _ in range(_SAFE_BOOT_MS // _SAFE_BOOT_STEP_MS):
        if pressed():
            return True
        sleep_ms(_SAFE_BOOT_STEP_MS)
    return False


def run(app, watchdog, traceback_of, sleep_ms, reset):
    """Run the application, then reset the board; after Ctrl-C return to the prompt instead.

    Parameters
    ----------
    app : app.BoardApp
    watchdog : callable
        Starts the watchdog and returns what feeds it; called only if the settings want one.
    traceback_of : callable
        Returns the traceback of an exception as text.
    sleep_ms, reset : callable

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C, unless a watchdog runs: that cannot be stopped, so the board is reset and does
        not start the application again.
    """
    watched = app.settings.values["watchdog"]
    if watched:
        app.feed = watchdog()
    try:
        app.run()
    except KeyboardInterrupt:
        if not watched:
            raise
        stay_after_reset()
    except Exception as error:
        app.log("error", "crashed and restarts: " + _end_of(traceback_of, error))
        sleep_ms(_AFTER_CRASH_MS)
    reset()


def _end_of(traceback_of, error):
    try:
        return traceback_of(error)[-_CRASH_CHARACTERS:]
    except MemoryError:
        return "no memory left"
