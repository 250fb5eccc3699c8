"""The AS7341 on CircuitPython, set up by Adafruit's driver."""

import adafruit_as7341
import busio
import digitalio
import microcontroller
from adafruit_bus_device.i2c_device import I2CDevice

from ..runtime.circuitpython import BusioBus
from ..runtime.common import ADDRESS, HALF_CLOCK_US, free_bus
from .as7341 import AS7341, SensorError


class AdafruitSensor(AS7341):
    """An AS7341 whose power, exposure, gain and LED are set by Adafruit's driver.

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
        self.bus = BusioBus(self._i2c)
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
