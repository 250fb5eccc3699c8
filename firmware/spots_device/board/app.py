"""The application and its loop: wait for a sample, decode it, send a frame, read a command."""

import gc

from .. import const
from ..keys.reports import CAPS_LOCK
from ..reading.calibration import CalibrationSlot
from ..reading.frame import Framer, Time32
from ..reading.strip import Strip
from ..sensor.as7341 import SensorError
from .command import LINE_MAX, Commands, LineReader, Replies
from .outputs import Outputs, check_layout
from .reconnect import Reconnect
from .settings import BoardSettings, checksum
from .store import Store

# Longest sleep without reading commands: an exposure of 10 ms, and the error of a clock that is up
# to 3 ms early.
_SLICE_US = const(13_000)
_LAST_US = const(100_000)  # on exit: longest wait until the host has read the key releases
_NO_CHARACTER = const(-1)
_CTRL_C = const(3)
_COLLECT_EVERY = const(4)  # commands between two garbage collections
_BOOT_MAX = const(240)  # characters of all faults at the start, so that the reply fits a frame


def _nothing(*_):
    pass


class BoardApp:
    """Runs a board with one strip: creates all objects of the application, and runs the loop.

    `several.SeveralApp` is the application of a board with several strips.

    Parameters
    ----------
    board : object
        Module board_config, or an object with the attribute ``NAME`` (str) and those that
        `settings.BoardSettings` needs.
    runtime : str
        Name and version of the Python runtime, for the reply to ``hello``.
    uid : str
        Unique id of the board.
    sensor : as7341.AS7341
        Sensor, not started yet.
    clock : object
        ``ticks_us``, ``ticks_add``, ``ticks_diff`` and ``sleep_us`` as in MicroPython's ``time``.
    serial : object
        Serial port. ``write(buffer, size) -> bool`` sends a frame if there is room, and returns
        whether it was sent. ``read()`` returns the next byte as int, or -1 if no byte waits; it
        must not allocate.
    usb : object, optional
        USB stack: ``open(names) -> dict`` opens HID interfaces, see `outputs.Outputs`. None on a
        board that cannot be a USB keyboard.

    Attributes
    ----------
    index : int
        Number of this sensor on the board, from 0.
    sensors : int
        Count of sensors on the board.
    report_us : int
        Longest sleep while reports wait, in us.
    ticks_us, sleep_us : callable
        Functions of the clock with which a pass waits for the next sample. A runtime can replace
        them.
    signal : callable or None
        ``signal(leds)`` lights the board's LED as the keyboard LEDs `leds`. Without a computer, the
        LED shows the state of the strip: it blinks while no sensor answers, is lit until there is a
        calibration, and is then dark, until a host switches caps lock on.
    """

    index = 0
    sensors = 1
    signal = None
    _lit = 0
    report_us = 1_000  # USB takes a report each millisecond
    _slice_us = _SLICE_US

    def __init__(self, board, runtime, uid, sensor, clock, serial, usb=None):
        self._board = board
        self._runtime = runtime
        self._uid = uid
        self._clock = clock
        self._read = serial.read
        self.ticks_us = clock.ticks_us
        self._ticks_diff = clock.ticks_diff
        self.sleep_us = clock.sleep_us
        self._time = Time32(clock)
        self._reader = LineReader()
        self.reboot = False
        self.feed = None  # called in every step if a watchdog runs
        self.interrupt_at = _nothing  # sets the interrupt character, like micropython.kbd_intr
        self._left = False
        self._answered = 0
        self._leave_until = None  # deadline in ticks
        self.framer = Framer(serial, self._time)
        self.store = Store()
        self._attach(sensor, board, usb)

    def _attach(self, sensor, board, usb):
        """Create settings, files, keys and commands of one strip."""
        self._sensor = sensor
        self._pacing = sensor.pacing
        self._poll = sensor.poll
        self.settings = BoardSettings(board)
        self.replies = Replies(self.framer, self._time)
        self.calibration = CalibrationSlot()
        self._unused = []  # sentences about stored parts that are invalid
        layout_lines = self._load()
        # The host reads the USB descriptors once, so the interfaces cannot change later.
        self.outputs = Outputs(self.settings, self.framer, self._time, usb, layout_lines)
        self.strip = Strip(
            self.index,
            self._uid,
            sensor,
            self.framer,
            self._time,
            self._clock,
            self.settings,
            self.outputs,
        )
        self._take = self.strip.take
        self.reconnect = Reconnect(
            self.strip, self._clock, self.replies, self.apply_calibration, self._sensor_lost
        )
        self.lose = self.reconnect.lose
        self._commands = Commands(self)
        self._sum()
        for fault in self.boot_faults():
            self.replies.log("error", fault)

    def run(self):
        """Run until the command ``reboot``.

        On every exit path all keys are released and the LED is switched off.
        """
        self._left = False
        self._leave_until = None
        # `_leave` is idempotent. It is repeated because two interrupts, a pending one and a new
        # one, may occur before it has switched Ctrl-C off.
        try:
            try:
                try:
                    try:
                        try:
                            while not self.reboot:
                                self.step(False)
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
            self._time.update()
            self.outputs.finish(clock, self._leave_until)
        finally:
            self.strip.stop()
        self._left = True

    def step(self, once=True):
        """Run one pass of the loop, or with `once` false all passes until ``reboot`` or an error.

        A pass allocates nothing while sampling. It sleeps 13 ms at most, so that commands are read
        often. On a board with one strip, a pass takes 0.1 s or more while the sensor does not
        answer.
        """
        # The exception handler is outside of the loop, so that no call frame of a pass needs the
        # heap; see strip.py.
        try:
            while True:
                self._pass()
                if once or self.reboot:
                    return
        except (OSError, SensorError) as error:
            self.lose(error)

    def _pass(self):
        if self.feed is not None:
            self.feed()
        if self.reconnect.lost:
            self._time.update()  # must be updated more often than the ticks wrap
            self._blink()
            self.reconnect.search()  # before a command: the first `hello` reports the calibration
        byte = self._read()
        if byte >= 0 and self._listen(byte):
            self._answer()
            self._pump()
        if not self.reconnect.lost:
            wait_us = self._ticks_diff(self._pacing.due, self.ticks_us())
            if wait_us > self._slice_us:
                self.sleep_us(self._slice_us)
            else:
                if wait_us > 0:
                    self.sleep_us(wait_us)
                self._sample()
        # After the samples, so that their keys do not wait until the end of a sleep.
        if self.outputs.pumps:  # without keys a look-up, which is shorter than a call
            self._pump()

    def _sample(self):
        poll = self._poll
        take = self._take
        if poll():
            if self.reconnect.fault:
                self.reconnect.sampled()
            take()
            # The other samples of this FIFO read, at most 19. `poll` does not use the bus for them.
            # `_take` can restart the sensor, which drops them.
            while self._sensor.waits:
                if self.outputs.pumps:
                    self._pump()
                poll()
                take()

    def _pump(self):
        self._slice_us = _SLICE_US if self.outputs.pump() else self.report_us

    def log(self, level, text):
        """Send the log line `text` to the host; `level` is ``"info"`` or ``"error"``."""
        self.replies.log(level, text)

    def restart(self):
        """Restart the sensor with the present settings."""
        self.abandon("the sensor was restarted")
        self.reconnect.restart()

    def abandon(self, why):
        """Cancel a requested dark frame or search for settings; its error reply contains `why`."""
        self.strip.forget_requests()
        self.replies.abandon(why)

    def use_calibration(self, lines):
        """Store a new calibration and use it.

        Parameters
        ----------
        lines : list of str
            Lines of a calibration; an empty list removes the calibration.

        Returns
        -------
        str or None
            Note for the user, see `apply_calibration`.

        Raises
        ------
        ValueError
            If the lines are invalid. Nothing is changed then.
        """
        self.calibration.use(lines)
        self._sum()
        return self.apply_calibration()

    def use_layout(self, lines):
        """Store a new layout of keys and use it.

        Parameters
        ----------
        lines : list of str
            Lines of a layout; an empty list restores the default layout.

        Returns
        -------
        str or None
            Note for the user, see `apply_calibration`.

        Raises
        ------
        ValueError
            If the lines are invalid. Nothing is changed then.
        """
        if lines:
            check_layout(lines)
        self.outputs.use_layout(lines)
        self._sum()
        return self.apply_calibration()

    def _sum(self):
        # A checksum takes 0.2 ms for each line on a Pico, so the reply to ``hello`` does not
        # compute it.
        self._sums = checksum(self.calibration.lines), checksum(self.outputs.layout_lines)

    def apply_calibration(self):
        """Use the calibration if it is valid at the present settings; update keys and gamepad.

        Returns
        -------
        str or None
            Note for the user: why the calibration is not used, or why keys or gamepad do not work
            although they are switched on. None if everything works.
        """
        self._time.update()
        self.outputs.release()  # before `use_stored`, because its calls nest deeply
        notes = self.use_stored(), self.outputs.note(self.strip.decode.calibration)
        gc.collect()  # frees the garbage of parsing
        return "; ".join(filter(None, notes)) or None

    def use_stored(self):
        """Use the stored calibration if it is valid for the settings.

        Returns
        -------
        str or None
            Why the stored calibration is not used; None if it is used, or if there is none. The
            missing dark frame of an LED that is always on is reported even without a calibration.
        """
        if self.reconnect.lost:
            found = why_not = None
            if self.calibration.lines:
                why_not = "the calibration is not in use until the sensor answers"
                if self.reconnect.fault:
                    why_not += ": " + self.reconnect.fault
        else:
            found, why_not = self.calibration.choose(
                self.strip.conditions, self.settings.values["strain_ppm"]
            )
            if not self.strip.lit_flags:
                from .light import NO_DARK

                found, why_not = None, NO_DARK
        self.strip.use_calibration(found)
        self._time.update()
        self.outputs.apply(found)
        self.strip.configure()
        if self.signal and not self.reconnect.lost:
            self.signal(CAPS_LOCK if found is None else 0)
        return why_not

    def _blink(self):
        if self.signal:  # called every 0.1 s, the pause between two searches
            self._lit ^= CAPS_LOCK
            self.signal(self._lit)

    def _sensor_lost(self):
        self.release_keys()
        self.abandon("the sensor was lost")

    def identity(self):
        """Return name, id, settings and checksums of the board: the reply to ``hello`` (dict)."""
        reply = self.settings.reply()
        reply["board"] = self._board.NAME
        reply["runtime"] = self._runtime
        reply["id"] = self._uid
        reply["sensors"] = self.sensors
        calibration = self.strip.decode.calibration
        reply["calibration"] = calibration and self._sums[0]
        reply["length_um"] = calibration and calibration.length_um
        reply["decay"] = calibration and calibration.decay
        reply["cross"] = calibration and calibration.cross
        reply["relative_force"] = calibration and calibration.relative_force
        reply["presser"] = calibration and calibration.presser
        reply["layout"] = self._sums[1] if self.outputs.layout_lines else None
        reply["boot"] = self.boot_faults()
        return reply

    def boot_faults(self):
        """Return what went wrong at the start: sentences of 240 ASCII characters in total (list).

        Nobody reads the log at the start, so the reply to ``hello`` contains these sentences. A
        save makes those about stored files obsolete.
        """
        left = _BOOT_MAX
        faults = []
        for fault in [self.store.fault] + self._unused + [self.outputs.fault]:
            if fault and left:
                # In JSON, other characters need more than one byte.
                fault = "".join([c if " " <= c <= "~" and c not in '"\\' else "?" for c in fault])
                faults.append(fault[:left])
                left -= len(faults[-1])
        return faults

    def state(self):
        """Return settings, counters and faults: the reply to ``get`` (dict)."""
        reply = self.settings.reply()
        self.strip.report(reply)
        self.reconnect.report(reply)
        reply["dropped"] = self.framer.dropped
        reply["dropped_reports"] = self.outputs.dropped()
        reply["saturation"] = None if self.reconnect.lost else self.strip.saturation()
        return reply

    def release_keys(self):
        """Release all keys; called before a pause of the readings."""
        self._time.update()
        self.outputs.release()

    def save(self):
        """Write settings, calibration and layout to flash; a power cut leaves the old or the new.

        Raises
        ------
        OSError
            If a file cannot be written. The stored state then remains as it is.
        """
        self.store.save(self.stored())
        self._unused = []

    def stored(self):
        """Return name and lines of each part that ``save`` stores: a list of tuples."""
        return [
            (self._name("settings"), self.settings.lines()),
            (self._name("calibration"), self.calibration.lines),
            (self._name("layout"), self.outputs.layout_lines),
        ]

    def time_us(self):
        """Return the board's time in us modulo 2**32."""
        self._time.update()
        return self._time.us()

    def _load(self):
        """Load saved settings, calibration and layout; return the lines of the layout."""
        self._load_lines("settings", self.settings.change)
        self._load_lines("calibration", self.calibration.use)
        return self._load_lines("layout", check_layout)

    def _load_lines(self, part, check):
        try:
            lines = self.store.load(self._name(part))
            if lines:
                check(lines)
                gc.collect()  # the parser and its garbage, before modules that stay are loaded
            return lines
        except ValueError as error:
            self._unused.append("stored %s not used: %s" % (part, error))
            return []

    def _name(self, part):
        return part

    def _listen(self, byte):
        # Returns whether a line is complete. At most one command and `LINE_MAX` bytes per pass, so
        # a flood from the host cannot starve sampling.
        left = LINE_MAX
        while not self._reader.feed(byte):
            left -= 1
            if not left:
                return False
            byte = self._read()
            if byte < 0:
                return False
        return True

    def _answer(self):
        try:
            reply = self._commands.handle(self._reader.line())
        except ValueError as error:
            reply = {"re": "", "error": str(error), "why": "bad_line"}
        if reply is not None:
            self.replies.send(reply)
        # A collection costs samples, but here a host expects a pause.
        self._answered += 1
        if self._answered % _COLLECT_EVERY == 0:
            gc.collect()
