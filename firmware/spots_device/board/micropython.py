"""Starts the application on MicroPython: sensor, USB, watchdog, safe boot."""

import io
import sys
import time

import machine
import micropython

from ..runtime.common import rp2_mC
from ..runtime.micropython import MachineBus, StdioSerial
from ..usb.usages import CAPS_LOCK
from .start import WATCHDOG_MS, blink, is_held, run
from .stay import must_stay


class MachineUsb:
    """The board as a USB keyboard and gamepad, beside its serial port.

    Parameters
    ----------
    board_config : module
        Configuration of the board. The optional ``LED_PIN`` is the pin of the LED that shows caps
        lock; ``LED_ON`` is the level that switches this LED on. The optional ``USB_HID_MAX`` is the
        largest number of HID interfaces beside the serial port.
    """

    def __init__(self, board_config):
        self._connected = None  # a function, when interfaces have been opened
        self._most = getattr(board_config, "USB_HID_MAX", None)
        self.led = None
        pin = getattr(board_config, "LED_PIN", None)
        if pin is not None:
            self._on = board_config.LED_ON
            self.led = machine.Pin(pin, machine.Pin.OUT, value=1 - self._on)

    def open(self, names):
        """Open HID interfaces; USB disconnects and connects again.

        Parameters
        ----------
        names : list of str
            Names of interfaces, from `interfaces.INTERFACES`.

        Returns
        -------
        dict
            For the name of each opened interface, the function ``send(report) -> bool``.

        Raises
        ------
        OSError
            If this MicroPython or this board cannot open the interfaces; the message says what to
            do.
        """
        if not hasattr(machine, "USBDevice"):
            raise OSError("this MicroPython cannot be a USB device: update it")
        if sys.platform == "esp32" and sys.implementation.version[:2] == (1, 26):
            raise OSError("MicroPython 1.26 sends empty reports on this chip: update it")
        if self._most is not None and len(names) > self._most:
            raise OSError(
                "USB of this board has no room for %s: switch keys or gamepad off, or push another "
                "layout, then save and reboot" % " and ".join(names)
            )
        from ..usb.micropython import connected, open_interfaces

        self._connected = connected
        return open_interfaces(names, self.show_leds)

    @property
    def connected(self):
        """Whether a computer uses the interfaces. Safe in the loop: allocates nothing."""
        return self._connected is not None and self._connected()

    def show_leds(self, leds):
        if self.led is not None:
            self.led.value(self._on if leds & CAPS_LOCK else 1 - self._on)


def main():
    """Run the application on this board until a command or Ctrl-C ends it.

    Returns to the prompt if the board's button is pressed soon after a reset, or after a reset by
    Ctrl-C (see stay.py). After an exception of the application, the board sends a log line and
    restarts.
    """
    import board_config

    if must_stay():
        print("stopped by Ctrl-C: reset the board to start the application")
        return
    if _is_safe_boot(board_config):
        print("stopped by the button: reset the board to start the application")
        return

    runtime = "micropython %d.%d.%d" % sys.implementation.version[:3]
    uid = machine.unique_id().hex()
    usb = MachineUsb(board_config) if board_config.USB_HID else None
    from .app import Board

    attach = None
    if getattr(board_config, "BLUETOOTH", False):
        from ..radio.start import attach
    app = Board(board_config, runtime, uid, _open_sensor, time, StdioSerial(), usb, attach)
    if usb and usb.led is not None:
        app.signal = usb.show_leds
        if app.boot_faults:
            blink(usb.show_leds, time.sleep_ms)
    app.interrupt_at = micropython.kbd_intr
    run(app, _watchdog, _traceback, time.sleep_ms, machine.reset)


def _open_sensor(config, clock):
    from ..sensor.as7341 import AS7341

    bus = MachineBus(config.I2C_ID, config.SCL_PIN, config.SDA_PIN, config.I2C_HZ)
    sensor = AS7341(bus, clock)
    # The pin is an output from its first use on.
    sensor.gpio = lambda on: machine.Pin(config.STRIP_LED_PIN, machine.Pin.OUT, value=on)
    sensor.thermometer = _thermometer()
    return sensor


def _thermometer():
    """Return a function that measures the chip's temperature, see `as7341.AS7341`, or None."""
    adc = getattr(machine, "ADC", None)
    if hasattr(adc, "CORE_TEMP"):  # RP2040, RP2350
        read = adc(adc.CORE_TEMP).read_u16
        return lambda: rp2_mC(read)
    if sys.platform == "esp32":
        import esp32

        if hasattr(esp32, "mcu_temperature"):
            return lambda: 1000 * esp32.mcu_temperature()
    return None


def _watchdog():
    return machine.WDT(timeout=WATCHDOG_MS).feed


def _is_safe_boot(board_config):
    button = getattr(board_config, "SAFE_BOOT", None)
    if button is None:
        return False
    if button == "BOOTSEL":
        import rp2

        return is_held(rp2.bootsel_button, time.sleep_ms)
    pin = machine.Pin(button, machine.Pin.IN, machine.Pin.PULL_UP)
    return is_held(lambda: not pin.value(), time.sleep_ms)


def _traceback(error):
    text = io.StringIO()
    sys.print_exception(error, text)
    return text.getvalue()
