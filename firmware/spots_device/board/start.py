"""Start of the application on any runtime: safe boot, watchdog, restart after a crash."""

from ..usb.usages import CAPS_LOCK
from .stay import stay_after_reset

WATCHDOG_MS = 8_000  # close to the maximum of the RP2040
AFTER_CRASH_MS = 1_000  # pause before the restart, so that Ctrl-C works if each start crashes
CRASH_CHARACTERS = 300  # length of the end of a traceback that is sent; it must fit a frame

# Time to press the button after a reset; a press during the reset starts the chip's bootloader.
_SAFE_BOOT_MS = 500
_SAFE_BOOT_STEP_MS = 20
_BLINKS = 10
_BLINK_MS = 100  # half a period


def is_held(pressed, sleep_ms):
    """Wait up to half a second for a button; return whether it was pressed.

    Parameters
    ----------
    pressed : callable
        ``pressed() -> bool`` reads the button.
    sleep_ms : callable
        ``sleep_ms(ms)`` waits.
    """
    for _ in range(_SAFE_BOOT_MS // _SAFE_BOOT_STEP_MS):
        if pressed():
            return True
        sleep_ms(_SAFE_BOOT_STEP_MS)
    return False


def blink(show_leds, sleep_ms):
    """Blink for two seconds with the LED that shows caps lock: something went wrong at the start.

    Parameters
    ----------
    show_leds : callable
        ``show_leds(leds)`` shows the LEDs of a keyboard, bits of HID's LED page.
    sleep_ms : callable
        ``sleep_ms(ms)`` waits.
    """
    for _ in range(_BLINKS):
        for leds in (CAPS_LOCK, 0):
            show_leds(leds)
            sleep_ms(_BLINK_MS)


def run(app, watchdog, traceback_of, sleep_ms, reset):
    """Run the application, then reset the board. After Ctrl-C, return to the prompt instead.

    Parameters
    ----------
    app : app.Board
        Board to run.
    watchdog : callable
        ``watchdog() -> callable`` starts the watchdog and returns the function that feeds it.
        Called only if the setting ``watchdog`` is 1.
    traceback_of : callable
        ``traceback_of(exception) -> str``.
    sleep_ms : callable
        ``sleep_ms(ms)`` waits.
    reset : callable
        ``reset()`` resets the board and does not return.

    Raises
    ------
    KeyboardInterrupt
        On Ctrl-C without a watchdog. A watchdog cannot be stopped; if it runs, Ctrl-C resets the
        board, and the board does not start the application after this reset.
    """
    watched = app.strips[0].settings.values["watchdog"]
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
        sleep_ms(AFTER_CRASH_MS)
    reset()


def _end_of(traceback_of, error):
    try:
        return traceback_of(error)[-CRASH_CHARACTERS:]
    except MemoryError:
        return "no memory left"
