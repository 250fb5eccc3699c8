"""Starts the application on CircuitPython: USB, sensor, watchdog, safe boot."""

import sys
import time
import traceback

import board
import digitalio
import microcontroller
import micropython
import storage
import usb_cdc

from .. import const
from ..reading.fast_circuitpython import speed_up
from ..runtime.circuitpython import CdcSerial, MonotonicClock
from ..sensor.adafruit_circuitpython import AdafruitSensor
from ..usb.usages import CAPS_LOCK
from .settings import BoardSettings
from .start import WATCHDOG_MS, blink, is_held, run
from .stay import must_stay
from .store import Store

# The time between two reports, see usb/circuitpython.py. `sleep_early_us` cannot sleep less
# than 3 ms.
_REPORT_US = const(10_000)


class CircuitUsb:
    """The board as a USB keyboard and gamepad, if `boot` has enabled these interfaces.

    Parameters
    ----------
    board_config : module
        Configuration of the board. The optional ``LED_PIN`` names the pin of the LED that shows
        caps lock; ``LED_ON`` is the level that switches this LED on.
    """

    def __init__(self, board_config):
        self.led = None
        name = getattr(board_config, "LED_PIN", None)
        if name is not None:
            self._on = bool(board_config.LED_ON)
            self.led = digitalio.DigitalInOut(getattr(board, name))
            self.led.switch_to_output(value=not self._on)

    def open(self, names):
        """Open HID interfaces.

        Parameters
        ----------
        names : list of str
            Names of interfaces, from `interfaces.INTERFACES`.

        Returns
        -------
        dict
            For the name of each opened interface, the function ``send(report) -> bool``.
        """
        from ..usb.circuitpython import open_interfaces

        return open_interfaces(names, self.show_leds)

    def show_leds(self, leds):
        if self.led is not None:
            self.led.value = self._on == bool(leds & CAPS_LOCK)


def boot():
    """Set up USB after a reset; does nothing if the board's button is pressed.

    It makes the drive read-only for the host and writable for the board, so that the command
    ``save`` works.
    """
    import board_config

    if _is_safe_boot(board_config):
        return
    usb_cdc.enable(console=True, data=True)
    storage.remount("/", readonly=False)
    if board_config.USB_HID:
        from ..usb.circuitpython import enable

        enable(_wanted(board_config))


def main():
    """Run the application on this board until a command or Ctrl-C ends it.

    Returns to the prompt at once if boot.py has not enabled the data port, or after a reset by
    Ctrl-C (see stay.py). After an exception of the application, the board sends a log line and
    restarts.
    """
    import board_config

    if must_stay():
        print("stopped by Ctrl-C: reset the board to start the application")
        return
    if usb_cdc.data is None:
        print("no data port, so the application did not start: reset without holding the button")
        return

    speed_up()
    clock = MonotonicClock()
    runtime = "%s %d.%d.%d" % ((sys.implementation.name,) + tuple(sys.implementation.version[:3]))
    uid = "".join("%02x" % byte for byte in microcontroller.cpu.uid)
    usb = CircuitUsb(board_config) if board_config.USB_HID else None
    serial = CdcSerial(usb_cdc.data, clock)
    from .app import Board

    app = Board(board_config, runtime, uid, _open_sensor, clock, serial, usb)
    if usb and usb.led is not None:
        app.signal = usb.show_leds
        if app.boot_faults:
            blink(usb.show_leds, _sleep_ms)
    if app.sensors == 1:
        app.ticks_us, app.sleep_us = clock.ticks_early_us, clock.sleep_early_us
        app.report_us = _REPORT_US
    # Not every build has `kbd_intr`. Without it, a second Ctrl-C can interrupt the end of `run`,
    # which is then repeated.
    app.interrupt_at = getattr(micropython, "kbd_intr", app.interrupt_at)
    run(app, _watchdog, _traceback, _sleep_ms, microcontroller.reset)


def _open_sensor(config, clock):
    scl, sda = getattr(board, config.SCL_PIN), getattr(board, config.SDA_PIN)
    sensor = AdafruitSensor(scl, sda, config.I2C_HZ, clock)
    sensor.gpio = _strip_led(config)
    if microcontroller.cpu.temperature is not None:
        sensor.thermometer = lambda: int(1000 * microcontroller.cpu.temperature)
    return sensor


def _strip_led(board_config):
    """Return a function ``gpio(on)`` that switches the strip's LED and opens its pin if needed."""
    pin = None

    def switch(on):
        nonlocal pin
        if pin is None:
            pin = digitalio.DigitalInOut(getattr(board, board_config.STRIP_LED_PIN))
            pin.switch_to_output()
        pin.value = on

    return switch


def _watchdog():
    from watchdog import WatchDogMode

    microcontroller.watchdog.timeout = WATCHDOG_MS / 1000
    microcontroller.watchdog.mode = WatchDogMode.RESET
    return microcontroller.watchdog.feed


def _is_safe_boot(board_config):
    name = getattr(board_config, "SAFE_BOOT", None)
    if name is None:
        return False
    with digitalio.DigitalInOut(getattr(board, name)) as button:
        button.switch_to_input(pull=digitalio.Pull.UP)
        return is_held(lambda: not button.value, _sleep_ms)


def _sleep_ms(ms):
    time.sleep(ms / 1000)


def _wanted(board_config):
    """Return the names of the USB interfaces that the stored settings of any strip need."""
    from ..keys.layout import default_lines, parse
    from .interfaces import INTERFACES

    store = Store()
    wanted = set()
    for i in range(len(getattr(board_config, "SENSORS", " "))):
        settings = BoardSettings(board_config)
        try:
            settings.change(store.load("settings%s" % (i or "")))
            lines = store.load("layout%s" % (i or ""))
            kinds = parse(lines or default_lines()).pages
        except ValueError:  # the application reports this error, and uses the default layout
            kinds = parse(default_lines()).pages
        wanted.update(
            [name for name, of, kind in INTERFACES if settings.values[of] and kind in (0,) + kinds]
        )
    return [name for name, _, _ in INTERFACES if name in wanted]


def _traceback(error):
    return "".join(traceback.format_exception(error))
