"""The I2C bus of all runtimes: addresses of the chips, and recovery of a stuck bus."""

ADDRESS = 0x39  # I2C address of the AS7341, 7 bits
MULTIPLEXER = 0x70  # I2C address of a TCA9548A; bit n of its only register switches channel n on
HALF_CLOCK_US = 5  # half a period of the clock that frees the bus

_RECOVERY_CLOCKS = 9


def free_bus(scl, sda, is_high, put):
    """Free an I2C bus: send clock pulses until the chip releases SDA, then a STOP.

    A chip can hold SDA low after a transfer that stopped in the middle of a byte. Source: UM10204,
    section 3.1.16. `scl` and `sda` are open-drain pins; ``is_high(pin)`` reads one, and
    ``put(pin, level)`` releases it (1) or pulls it low (0), then waits `HALF_CLOCK_US`.
    """
    for _ in range(_RECOVERY_CLOCKS):
        if is_high(sda):
            break
        put(scl, 0)
        put(scl, 1)
    for pin, level in ((scl, 0), (sda, 0), (scl, 1), (sda, 1)):
        put(pin, level)


def rp2_mC(read):
    """Return the temperature of an RP2040 or RP2350 in units of 0.001 degrees Celsius.

    Source: RP2040 datasheet, section 4.9.5. A step of the ADC is 0.47 K, so 16 readings are
    averaged; 65535 of ``read()`` is 3.3 V. Allocates nothing.
    """
    total = 0
    for _ in range(16):
        total += read()
    return 27_000 - ((total >> 4) * 50_354 // 1000 - 706_000) * 1000 // 1721
