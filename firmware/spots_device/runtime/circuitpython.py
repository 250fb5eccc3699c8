"""Code for CircuitPython only: Adafruit's driver, serial port, clock, USB, `boot` and `main`."""

import sys
import time
import traceback
from binascii import crc32
from struct import pack_into

import adafruit_as7341
import board
import busio
import digitalio
import microcontroller
import micropython
import storage
import supervisor
import usb_cdc
from adafruit_bus_device.i2c_device import I2CDevice

from .. import const
from ..board.settings import BoardSettings
from ..board.store import Store
from ..reading import decode as d
from ..reading import kernel
from ..sensor.as7341 import AS7341, SensorError
from .common import ADDRESS, CAPS_LOCK, HALF_CLOCK_US, WATCHDOG_MS, blink, free_bus, is_held, run
from .stay import must_stay

# `ticks_diff` adds half a period. With a period of 2**30 us, the sum would not fit a small integer,
# and would allocate.
_PERIOD_US = const(1 << 29)
_HALF_PERIOD_US = const(1 << 28)
_MAX_TICKS = const((1 << 29) - 1)  # both of this clock, in us, and of `supervisor.ticks_ms`
_MAX_NS = const((1 << 30) - 1)  # the lowest 30 bits of a time, which wrap after 1.07 s
_LONG_MS = const(1_000)
_FINISH_US = const(20_000)  # longest wait for the rest of a TEXT frame
_MAX_31_BITS = 0x7FFFFFFF
_COMMON_SIZE = const(64)  # sizes up to this one get a cached view
_TOUCH_BYTES = kernel.TOUCH_SIZE
_TOUCH_SIZE = _TOUCH_BYTES + d.CRC_SIZE  # bytes of a TOUCH frame before its encoding
_TOUCH_COPY = "%ds" % _TOUCH_SIZE
_ZERO = b"\0"
_EARLY_US = const(2_000)  # more than the error of a time that is computed from milliseconds
_MARGIN_MS = const(4)  # more than this error, that of `sleep`, and `_EARLY_US` together


class BusioBus:
    """Reads and writes the sensor's registers over ``busio``.

    Adafruit's driver uses the same bus. So each transfer locks the bus, but without Adafruit's
    I2CDevice, which takes longer and allocates memory.

    Parameters
    ----------
    i2c : busio.I2C
        Controller of the bus.
    """

    def __init__(self, i2c):
        self._i2c = i2c
        self._register = bytearray(1)

    def read_into(self, address, register, buffer):
        i2c = self._i2c
        self._register[0] = register
        while not i2c.try_lock():
            pass
        try:
            i2c.writeto_then_readfrom(address, self._register, buffer)
        finally:
            i2c.unlock()

    def write(self, buffer):
        i2c = self._i2c
        while not i2c.try_lock():
            pass
        try:
            i2c.writeto(ADDRESS, buffer)
        finally:
            i2c.unlock()


class AdafruitSensor(AS7341):
    """An AS7341 whose power, exposure, gain and LED are set by Adafruit's driver.

    Parameters
    ----------
    scl, sda : microcontroller.Pin
        Pins of the I2C bus.
    frequency_hz : int
        Frequency of the bus in Hz.
    clock : object
        ``ticks_us``, ``ticks_add``, ``ticks_diff`` and ``sleep_us``.

    Notes
    -----
    ``busio.I2C`` raises RuntimeError without pull-ups, or if a chip holds a wire low. A chip does
    so if the board was reset in the middle of a byte. So each `start` tries again to open the bus.
    """

    def __init__(self, scl, sda, frequency_hz, clock):
        super().__init__(None, clock)
        self._pins = scl, sda
        self._frequency_hz = frequency_hz
        self._i2c = self._driver = None
        self.open_i2c = busio.I2C  # a multiplexer replaces it, see `multiplexer.connect`

    def start(self, plan, gain, exposure_us, led_mA, mains_hz=0):
        if self._i2c is None:
            try:
                self._open()
            except SensorError:
                self.recover()
        super().start(plan, gain, exposure_us, led_mA, mains_hz)

    def recover(self):
        """Free the wires of the I2C bus, and open the I2C controller again."""
        if self._i2c is not None:
            self._i2c.deinit()
            self._i2c = None
        scl, sda = [digitalio.DigitalInOut(pin) for pin in self._pins]
        with scl, sda:
            for wire in (scl, sda):
                wire.switch_to_output(value=True, drive_mode=digitalio.DriveMode.OPEN_DRAIN)
            free_bus(scl, sda, _is_high, _put)
        self._open()

    def _open(self):
        scl, sda = self._pins
        try:
            self._i2c = self.open_i2c(scl, sda, frequency=self._frequency_hz)
        except RuntimeError as error:
            raise SensorError("the I2C bus does not start (%s): check the wiring" % error)
        self._bus = BusioBus(self._i2c)
        if self._driver is not None:
            self._driver.i2c_device = I2CDevice(self._i2c, ADDRESS, probe=False)

    def stop(self):
        if self._driver is not None and self._i2c is not None:
            super().stop()

    def _configure(self, atime, astep, gain, led_mA):
        if self._driver is None:
            try:
                self._driver = adafruit_as7341.AS7341(self._i2c)
            except (ValueError, RuntimeError) as error:
                raise SensorError(str(error))
        else:
            self._driver.initialize()
        self._driver.atime = atime
        self._driver.astep = astep
        self._driver.gain = gain
        self._driver.led_current = led_mA

    def _light(self, on):
        self._driver.led = on


def _is_high(wire):
    return wire.value


def _put(wire, level):
    wire.value = bool(level)
    microcontroller.delay_us(HALF_CLOCK_US)


class MonotonicClock:
    """Clock with the functions of MicroPython's ``time``, and two for a loop without garbage.

    CircuitPython's only clock with microseconds returns a long integer, so each read of the clock
    allocates 32 bytes. A loop that waits for a time needs one read if it computes the duration with
    `ticks_early_us`, and sleeps with `sleep_early_us`.
    """

    def __init__(self):
        self._early = self._read = self._ns = 0
        self._end = None  # of a sleep that has just ended
        self._read_ms = supervisor.ticks_ms() - _LONG_MS
        self.ticks_us()

    def ticks_us(self):
        """Return the time; the first call after `sleep_early_us` returns the end of this sleep."""
        end = self._end
        if end is not None:
            self._end = None
            return end
        now_ms = supervisor.ticks_ms()
        now = time.monotonic_ns()
        # `hash` as in `_high_half`. A division of the long integer would allocate 32 bytes more.
        ns = hash(now) & _MAX_NS
        if now_ms - self._read_ms & _MAX_TICKS < _LONG_MS:
            passed_ns = ns - self._ns & _MAX_NS
            self._read = self._read + passed_ns // 1000 & _MAX_TICKS
            ns -= passed_ns % 1000
        else:
            self._read = hash(now // 1000) & _MAX_TICKS
        self._ns = ns
        self._read_ms = now_ms
        return self._read

    def ticks_early_us(self):
        """Return the time of `ticks_us`, but 1 to 3 ms too early; allocates nothing."""
        self._end = None
        passed_ms = supervisor.ticks_ms() - self._read_ms & _MAX_TICKS
        self._early = (self._read + 1000 * passed_ms - _EARLY_US) % _PERIOD_US
        return self._early

    def sleep_early_us(self, us):
        """Sleep until `us` microseconds after the time that `ticks_early_us` has just returned."""
        ms = us // 1000 - _MARGIN_MS
        if ms > 0:
            time.sleep(ms / 1000)
        now = self.ticks_us()
        end = (self._early + us) % _PERIOD_US
        left_us = self.ticks_diff(end, now)
        if left_us > 0:
            microcontroller.delay_us(left_us)
            self._end = end

    @staticmethod
    def ticks_add(ticks, delta):
        return (ticks + delta) % _PERIOD_US

    @staticmethod
    def ticks_diff(end, start):
        return (end - start + _HALF_PERIOD_US) % _PERIOD_US - _HALF_PERIOD_US

    @staticmethod
    def sleep_us(us):
        # `sleep` rounds to milliseconds and serves USB meanwhile; `delay_us` does neither.
        ms = us // 1000
        if ms > 0:
            time.sleep(ms / 1000)
            us -= 1000 * ms
        if us > 0:
            microcontroller.delay_us(us)


_views = {}  # by size: the last bytes object of this size, and a view of its first `size` bytes


def view_of(data, size):
    """Return a view of the first `size` bytes of `data`; cached, because slicing allocates."""
    view = _views.get(size)
    if view is None or view[0] is not data:
        view = (data, memoryview(data)[:size])
        if size <= _COMMON_SIZE:
            _views[size] = view
    return view[1]


def fast_crc32(data, size, crc):
    """Update a CRC-32 like `kernel.crc32`, but faster.

    For a frame it takes 0.1 ms instead of 0.5 ms, and allocates up to 32 bytes for a long integer.

    The arguments are those of `kernel.crc32`, but the register `crc` must have its initial value.
    """
    value = crc32(view_of(data, size))
    crc[0] = ~hash(value) & 0xFFFF
    crc[1] = ~_high_half(value) & 0xFFFF


def _high_half(value):
    # `hash` returns the lowest 31 bits of an integer and, unlike `&` and `>>`, allocates nothing.
    return hash(value) >> 16 & 0x7FFF | (0x8000 if value > _MAX_31_BITS else 0)


def fast_touch(head, payload, state, encoded):
    """Encode a reading as a TOUCH frame like `kernel.touch`, but faster.

    It takes 0.5 ms, and allocates up to 32 bytes for a long integer.
    """
    sequence = head[d.SEQUENCE]
    head[d.SEQUENCE] = (sequence + 1) & 0xFFFF
    pack_into(
        "<BHHHBiiiH",
        payload,
        0,
        head[d.KIND],
        sequence,
        head[d.TIME_LOW],
        head[d.TIME_HIGH],
        state[d.FLAGS] | head[d.GAP],
        state[d.CONTRAST],
        state[d.BRIGHTNESS],
        state[d.POSITION_UM],
        state[d.FORCE_MN],
    )
    view = _views.get(_TOUCH_BYTES)
    view = view[1] if view and view[0] is payload else view_of(payload, _TOUCH_BYTES)
    crc = crc32(view)
    pack_into("<HH", payload, _TOUCH_BYTES, hash(crc) & 0xFFFF, _high_half(crc))
    # COBS of fewer than 255 bytes: a copy of the bytes, shifted by one, in which each zero byte is
    # replaced by the distance to the next zero byte.
    pack_into(_TOUCH_COPY, encoded, 1, payload)
    at = 0
    zero = payload.find(_ZERO, 0, _TOUCH_SIZE)
    while zero >= 0:
        encoded[at] = zero + 1 - at
        at = zero + 1
        zero = payload.find(_ZERO, at, _TOUCH_SIZE)
    encoded[at] = _TOUCH_SIZE + 1 - at
    encoded[_TOUCH_SIZE + 1] = 0
    return _TOUCH_SIZE + 2


def speed_up():
    """Replace the functions `crc32` and `touch` of `kernel` by `fast_crc32` and `fast_touch`."""
    kernel.crc32 = fast_crc32
    kernel.touch = fast_touch


class CdcSerial:
    """The USB serial port for frames and commands; the console is a separate port.

    Parameters
    ----------
    port : usb_cdc.Serial
        Data port.
    clock : object
        ``ticks_us``, ``ticks_diff`` and ``sleep_us``.
    """

    def __init__(self, port, clock):
        # With the default timeouts, None, calls would block for ever.
        port.timeout = 0
        port.write_timeout = 0
        self._port = port
        self._clock = clock
        self._byte = bytearray(1)

    def write(self, buffer, size):
        """Write a frame if the port has room; return whether it was sent completely.

        If the port takes only a part of a TEXT frame, wait up to 20 ms for the host to read. If it
        takes only a part of another frame, the rest is dropped: keys and samples never wait.

        Parameters
        ----------
        buffer : bytearray
            Contains the frame.
        size : int
            Bytes of the frame.
        """
        view = _views.get(size)
        view = view[1] if view and view[0] is buffer else view_of(buffer, size)
        sent = self._port.write(view)
        return sent == size or (sent > 0 and size > _COMMON_SIZE and self._finish(view, sent))

    def read(self):
        """Return the next byte from the host, or -1 if no byte waits."""
        if self._port.readinto(self._byte) == 1:
            return self._byte[0]
        return -1

    def _finish(self, view, sent):
        clock = self._clock
        began = clock.ticks_us()
        while clock.ticks_diff(clock.ticks_us(), began) < _FINISH_US:
            sent += self._port.write(view[sent:])
            if sent == len(view):
                return True
            clock.sleep_us(1000)
        return False


class CircuitUsb:
    """The board as a USB keyboard and gamepad, if `boot` has enabled these interfaces.

    Parameters
    ----------
    board_config : module
        Configuration of the board. The optional ``LED_PIN`` names the pin of the LED that shows
        caps lock; ``LED_ON`` is the level that switches this LED on.
    """

    def __init__(self, board_config):
        self._led = None
        name = getattr(board_config, "LED_PIN", None)
        if name is not None:
            self._on = bool(board_config.LED_ON)
            self._led = digitalio.DigitalInOut(getattr(board, name))
            self._led.switch_to_output(value=not self._on)

    def open(self, names):
        """Open HID interfaces.

        Parameters
        ----------
        names : list of str
            Names of interfaces, from `uses.INTERFACES`.

        Returns
        -------
        dict
            For the name of each opened interface, the function ``send(report) -> bool``.
        """
        from ..keys.usb_circuitpython import open_interfaces

        return open_interfaces(names, self._show_leds)

    def _show_leds(self, leds):
        if self._led is not None:
            self._led.value = self._on == bool(leds & CAPS_LOCK)


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
        from ..keys.usb_circuitpython import enable

        store = Store()
        enable(*[_is_stored(store, board_config, name) for name in ("keys", "gamepad")])


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
    if hasattr(board_config, "SENSORS"):
        from ..board.several import SeveralApp as BoardApp

        sensor = _open_sensor
    else:
        from ..board.app import BoardApp

        sensor = _open_sensor(board_config, clock)
    serial = CdcSerial(usb_cdc.data, clock)
    app = BoardApp(board_config, runtime, uid, sensor, clock, serial, usb)
    if usb and usb._led is not None and app.boot_faults():
        blink(usb._show_leds, _sleep_ms)
    if app.sensors == 1:
        app.ticks_us, app.sleep_us = clock.ticks_early_us, clock.sleep_early_us
    # Not every build has `kbd_intr`. Without it, a second Ctrl-C can interrupt `app._leave`, which
    # is then repeated.
    app.interrupt_at = getattr(micropython, "kbd_intr", app.interrupt_at)
    run(app, _watchdog, _traceback, _sleep_ms, microcontroller.reset)


def _open_sensor(config, clock):
    scl, sda = getattr(board, config.SCL_PIN), getattr(board, config.SDA_PIN)
    sensor = AdafruitSensor(scl, sda, config.I2C_HZ, clock)
    sensor.gpio = _strip_led(config)
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


def _is_stored(store, board_config, name):
    """Return whether `name` is on in the stored settings of at least one strip."""
    for i in range(len(getattr(board_config, "SENSORS", " "))):
        settings = BoardSettings(board_config)
        try:
            settings.change(store.load("settings%s" % (i or "")))
        except ValueError:
            pass  # the application reports this error
        if settings.values[name]:
            return True
    return False


def _traceback(error):
    return "".join(traceback.format_exception(error))
