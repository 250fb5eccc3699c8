"""Code that all runtimes share: constants, bus recovery, safe boot, run of the application."""

from .stay import stay_after_reset

ADDRESS = 0x39  # I2C address of the AS7341, 7 bits
MULTIPLEXER = 0x70  # I2C address of a TCA9548A; bit n of its only register switches channel n on
CAPS_LOCK = 2  # bit of caps lock in a keyboard's output report; HID usage tables, LED page
HALF_CLOCK_US = 5  # half a period of the clock that frees the bus
WATCHDOG_MS = 8_000  # close to the maximum of the RP2040
AFTER_CRASH_MS = 1_000  # pause before the restart, so that Ctrl-C works if each start crashes
CRASH_CHARACTERS = 300  # length of the end of a traceback that is sent; it must fit a frame

_RECOVERY_CLOCKS = 9
# Time to press the button after a reset; a press during the reset starts the chip's bootloader.
_SAFE_BOOT_MS = 500
_SAFE_BOOT_STEP_MS = 20
_BLINKS = 10
_BLINK_MS = 100  # half a period


def free_bus(scl, sda, is_high, put):
    """Free an I2C bus: send clock pulses until the chip releases SDA, then a STOP.

    A chip can hold SDA low after a transfer that stopped in the middle of a byte. Source: UM10204,
    section 3.1.16.

    Parameters
    ----------
    scl, sda : object
        Open-drain pins of the two wires.
    is_high : callable
        ``is_high(pin) -> bool`` reads the level of a wire.
    put : callable
        ``put(pin, level)`` releases a wire (1) or pulls it low (0), then waits `HALF_CLOCK_US`.
    """
    for _ in range(_RECOVERY_CLOCKS):
        if is_high(sda):
            break
        put(scl, 0)
        put(scl, 1)
    for pin, level in ((scl, 0), (sda, 0), (scl, 1), (sda, 1)):
        put(pin, level)


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
    app : app.BoardApp
        Application to run.
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
        sleep_ms(AFTER_CRASH_MS)
    reset()


def _end_of(traceback_of, error):
    try:
        return traceback_of(error)[-CRASH_CHARACTERS:]
    except MemoryError:
        return "no memory left"
