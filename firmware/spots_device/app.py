"""The loop: wait for a sample, decode it, frame it, and listen for commands in between."""

import gc
import json

from .as7341 import SensorError
from .calibration import Calibration, CalibrationError
from .command import LINE_MAX, NO_MEMORY, Commands, LineReader
from .frame import TEXT_MAX, Framer, Time32
from .meter import Meter
from .settings import SETTINGS_FILE, Settings, checksum, load_lines, save_lines
from .strip import Strip
from .uses import Uses

CALIBRATION_FILE = "calibration.txt"
LAYOUT_FILE = "layout.txt"

_SLICE_US = 10_000  # longest sleep with a deaf ear
_RETRY_US = 100_000  # between attempts to bring a lost sensor back
_LAST_US = 100_000  # for the host to hear, at the end, that no key is down
_NO_CHARACTER = -1
_CTRL_C = 3


def _nothing(*_):
    pass


class App:
    """Everything on the board, wired together.

    Parameters
    ----------
    board : object
        ``NAME`` and ``LED_MAX_MA`` (module board_config).
    runtime, uid : str
        What runs this, and the board's unique id.
    sensor : as7341.AS7341
    clock, serial : object
        As `frame.Time32` and `frame.Framer` ask for; ``serial.read()`` returns the next byte or -1
        and allocates nothing.
    usb : object, optional
        As `uses.Uses` asks for; None on a board that cannot be a USB keyboard.
    """

    def __init__(self, board, runtime, uid, sensor, clock, serial, usb=None):
        self.board = board
        self.runtime = runtime
        self.uid = uid
        self.settings = Settings(board.LED_MAX_MA)
        self.calibration_lines = []
        self._parsed = None
        self.faults = 0
        self.reboot = False
        self.feed = _nothing  # in every step; of a watchdog, where one runs
        self.interrupt_at = _nothing  # the character that interrupts; see micropython.kbd_intr
        self.meter = Meter()
        self._left = False
        self._leave_until = None  # ticks
        self._clock = clock
        self._serial = serial
        self._time = Time32(clock)
        self.framer = Framer(serial, self._time)
        self._reader = LineReader()
        self._claimed = None
        self._lost = True
        self.fault = None  # why the sensor was lost, until it is back
        self._load()
        # USB tells the host once, at the start, what the board is.
        layout_lines = self._stored_layout()
        self.uses = Uses(self.settings, self.framer, self._time, usb, layout_lines)
        self._commands = Commands(self)
        if self.uses.fault:
            self.log("error", self.uses.fault)
        self.strip = Strip(0, sensor, self.framer, self._time, clock, self.settings, self.uses)

    def run(self):
        """Run until told to reboot; on every exit path no key stays down and the LED is off."""
        self._left = False
        self._leave_until = None
        # Each step of the end runs inside the guards after it, and does nothing if it was done. Two
        # interrupts may come in between: one before they are off, and one that was on its way.
        try:
            try:
                try:
                    try:
                        try:
                            while not self.reboot:
                                self.step()
                        finally:
                            self._leave()
                    finally:
                        self._leave()
                finally:
                    self._leave()
            finally:
                self.interrupt_at(_CTRL_C)
        finally:
            self.interrupt_at(_CTRL_C)

    def _leave(self):
        self.interrupt_at(_NO_CHARACTER)
        if self._left:
            return
        clock = self._clock
        try:
            if self._leave_until is None:
                self._leave_until = clock.ticks_add(clock.ticks_us(), _LAST_US)
            self._set_time()
            self.uses.finish(clock, self._leave_until)
        finally:
            try:
                self.strip.sensor.stop()
            except OSError:
                pass
        self._left = True

    def step(self):
        """Do what is due now; sleeps at most a slice. Allocates nothing while sampling."""
        self.feed()
        self._listen()
        self.uses.pump()
        if self._lost:
            self._find_sensor()
            return
        wait_us = self.strip.sensor.remaining_us()
        if wait_us > 0:
            self._clock.sleep_us(min(wait_us, _SLICE_US))
            if wait_us > _SLICE_US:
                return
        try:
            if self.strip.sensor.poll():
                if self.fault:
                    self.fault = None
                    self.log("info", "the sensor is back")
                self.strip.take()
        except (OSError, SensorError) as error:
            self._lose(error)

    def measure(self):
        """Measure what a sample costs from now on; until that is done, it costs a little more."""
        self.meter.restart()
        self.step = self._measured_step

    def _measured_step(self):
        clock, sensor = self._clock, self.strip.sensor
        wait_us = 0 if self._lost else sensor.remaining_us()
        if wait_us > _SLICE_US:
            return App.step(self)  # sleeps, and takes nothing
        if wait_us > 0:
            clock.sleep_us(wait_us)
        began, complete = clock.ticks_us(), sensor.complete
        App.step(self)
        if self._lost or sensor.complete == complete:
            return
        if self.meter.add(clock.ticks_diff(clock.ticks_us(), began)):
            del self.step

    def log(self, level, text):
        """Send a log line."""
        self._send({"log": level, "text": text})

    def check_unclaimed(self):
        """Raise ValueError while a reply is still to follow."""
        if self._claimed:
            raise ValueError("wait for '%s' to end" % self._claimed)

    def claim(self, name):
        """Record that a reply will follow."""
        self._claimed = name

    def finish(self, name, reply):
        """Send the reply that was claimed."""
        self._claimed = None
        reply["re"] = name
        self._send(reply)

    def restart(self):
        """Bring the sensor up with the present settings."""
        self.abandon("the sensor was set up anew")
        if not self._lost:
            try:
                self.strip.start()
            except (OSError, SensorError) as error:
                self._lose(error)

    def use_calibration(self, lines):
        """Take lines that were checked, or none; return why they do not hold now, or None."""
        self.calibration_lines = lines
        self._parsed = None
        return self.apply_calibration()

    def use_layout(self, lines):
        """Take lines that were checked, or none; return what keeps them from working, or None."""
        self.uses.use_layout(lines)
        return self.apply_calibration()

    @property
    def calibration_id(self):
        """Checksum of the calibration in use, or None."""
        return checksum(self.calibration_lines) if self.strip.decode.calibration else None

    def apply_calibration(self):
        """Use the calibration if it fits the present settings, and what builds on it.

        Returns
        -------
        str or None
            What keeps something that is wanted from working.
        """
        why_not = self._apply_calibration()
        note = self.uses.note(self.strip.decode.calibration)
        return "; ".join([text for text in (why_not, note) if text]) or None

    def _apply_calibration(self):
        try:
            why_not = self._choose_calibration()
        except MemoryError:
            why_not = "no memory is left for the calibration: save and reboot"
        self._set_time()
        self.uses.apply(self.strip.decode.calibration)
        self.measure()
        return why_not

    def _choose_calibration(self):
        self.strip.decode.calibration = None
        if not self.calibration_lines:
            return None
        if self._lost:
            why_not = "the calibration is not in use until the sensor answers"
            return "%s: %s" % (why_not, self.fault) if self.fault else why_not
        sensor = self.strip.sensor
        # Parsing takes a fifth of a second and much of the heap: not at every return of the sensor.
        strain_ppm = self.settings.values["strain_ppm"]
        if self._parsed is None or self._parsed[0] != strain_ppm:
            self._parsed = None
            try:
                self._parsed = strain_ppm, Calibration(self.calibration_lines, strain_ppm)
            except CalibrationError as error:
                return str(error)
        calibration = self._parsed[1]
        reason = calibration.mismatch(
            self.uid, sensor.plan, sensor.gain, sensor.exposure_us, sensor.led_mA
        )
        if reason is None:
            self.strip.decode.calibration = calibration
        return reason

    def settings_now(self):
        """Return the settings as a reply holds them."""
        reply = dict(self.settings.values)
        reply["plan"] = list(reply["plan"])
        return reply

    def rate_mHz(self):
        """Return the readings in 1000 s to expect at the present settings."""
        s = self.settings.values
        return self.meter.rate_mHz(s["exposure_us"], s["average"])

    def let_go(self):
        """Release all keys, for no reading may come for a while."""
        self._set_time()
        self.uses.release()

    def save(self):
        """Store settings and calibration."""
        save_lines(SETTINGS_FILE, self.settings.lines())
        save_lines(CALIBRATION_FILE, self.calibration_lines)
        save_lines(LAYOUT_FILE, self.uses.layout_lines)

    def time_us(self):
        """Return the board's time in us modulo 2**32."""
        self._set_time()
        return self._time.high << 16 | self._time.low

    def _load(self):
        try:
            self.settings.change(load_lines(SETTINGS_FILE))
        except ValueError as error:
            self.log("error", "stored settings are not used: %s" % error)
        try:
            lines = load_lines(CALIBRATION_FILE)
            if lines:
                self._parsed = 0, Calibration(lines)
            self.calibration_lines = lines
        except ValueError as error:  # CalibrationError is one
            self.log("error", "the stored calibration is not used: %s" % error)

    def _stored_layout(self):
        try:
            lines = load_lines(LAYOUT_FILE)
            if lines:
                from .layout import Layout  # only where it is used

                Layout(lines)
            return lines
        except ValueError as error:  # LayoutError is one
            self.log("error", "the stored layout is not used: %s" % error)
            return []

    def _listen(self):
        # One line at most: whatever the host sends, readings and reports get their turn.
        for _ in range(LINE_MAX):
            byte = self._serial.read()
            if byte < 0:
                return
            if self._reader.feed(byte):
                try:
                    reply = self._commands.handle(self._reader.line())
                except ValueError as error:
                    reply = {"re": "", "error": str(error)}
                if reply is not None:
                    self._send(reply)
                # Here a pause is expected; in the loop it would cost samples.
                gc.collect()
                return

    def _find_sensor(self):
        # Nothing is sampled now, so a pause costs nothing. A heap full of what earlier searches
        # left would slow the loop down as long as nobody sends a command.
        gc.collect()
        self._set_time()  # or it would lose its turns meanwhile
        try:
            self.strip.start()
        except (OSError, SensorError) as error:
            self._lose(error)
            self._clock.sleep_us(_RETRY_US)
            return
        self._lost = False
        self._apply_calibration()
        gc.collect()  # what was loaded and parsed just now left garbage

    def _lose(self, error):
        self._lost = True
        self.let_go()
        self.abandon("the sensor was lost")
        known, self.fault = self.fault, str(error)
        if isinstance(error, OSError):
            self.fault = "the I2C bus failed (%s)" % error
        if not known:  # once, not a flood
            self.faults += 1
            self.log("error", self.fault)

    def abandon(self, why):
        """Answer a request that will not end."""
        self.strip.forget_requests()
        if self._claimed:
            self.finish(self._claimed, {"error": why + " before this ended"})

    def _set_time(self):
        self._time.set(self._clock.ticks_us())

    def _send(self, reply):
        self._set_time()
        try:
            data = json.dumps(reply).encode()
            error = "the reply is too long" if len(data) > TEXT_MAX else None
        except MemoryError:
            error = NO_MEMORY
        if error:
            data = json.dumps({"re": reply.get("re"), "error": error}).encode()
        self.framer.text(data)
