"""`busio` of the virtual board: an I2C controller on the simulated bus."""

import _protocol
import _simulator


class I2C:
    def __init__(self, scl, sda, *, frequency=100_000, timeout=255):
        number = sda.wire // _simulator.WIRES
        self._bus = _protocol.SECOND_BUS * number
        if not _simulator.sda(number):
            raise RuntimeError("No pull up found on SDA or SCL; check your wiring")
        self._pins = scl, sda
        if scl.taken or sda.taken:
            raise ValueError("pin in use")
        for pin in self._pins:
            pin.taken = True
        khz = frequency // 1000
        _simulator.call(_protocol.SPEED, khz & 0xFF, khz >> 8, self._bus)
        self._locked = False

    def deinit(self):
        for pin in self._pins:
            pin.taken = False
        self._pins = ()

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.deinit()

    def try_lock(self):
        if self._locked:
            return False
        self._locked = True
        return True

    def unlock(self):
        self._locked = False

    def probe(self, address):
        try:
            self.writeto(address, b"")
        except OSError:
            return False
        return True

    def scan(self):
        return [address for address in range(0x08, 0x78) if self.probe(address)]

    def readfrom_into(self, address, buffer, *, start=0, end=None):
        self._need_lock()
        view = memoryview(buffer)[start:end]
        _simulator.call(_protocol.RECEIVE, address | self._bus, 0, len(view), view)

    def writeto(self, address, buffer, *, start=0, end=None):
        self._need_lock()
        view = memoryview(buffer)[start:end]
        _simulator.call(_protocol.WRITE, address | self._bus, len(view), 0, view)

    def writeto_then_readfrom(
        self,
        address,
        out_buffer,
        in_buffer,
        *,
        out_start=0,
        out_end=None,
        in_start=0,
        in_end=None,
    ):
        self._need_lock()
        out = memoryview(out_buffer)[out_start:out_end]
        view = memoryview(in_buffer)[in_start:in_end]
        if len(out) != 1:
            raise NotImplementedError("the simulator needs a register address of one byte")
        _simulator.call(_protocol.READ, address | self._bus, out[0], len(view), view)

    def _need_lock(self):
        if not self._pins:
            raise ValueError("Object has been deinitialized and can no longer be used")
        if not self._locked:
            raise RuntimeError("Function requires lock")
