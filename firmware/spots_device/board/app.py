"""The board and its loop: wait for a sample of a strip, decode it, send a frame, read a command."""

import gc

from .. import const
from ..reading.frame import Framer, Time32
from ..sensor.as7341 import SensorError
from ..usb.usages import CAPS_LOCK
from .command import LINE_MAX, Commands, LineReader
from .interfaces import Interfaces
from .store import Store
from .strip_app import StripApp

# Longest sleep without reading commands: an exposure of 10 ms, and the error of a clock that is up
# to 3 ms early.
_SLICE_US = const(13_000)
_LAST_US = const(100_000)  # on exit: longest wait until the host has read the key releases
_NO_CHARACTER = const(-1)
_CTRL_C = const(3)
_COLLECT_EVERY = const(4)  # commands between two garbage collections


def _nothing(*_):
    pass


class _AtEnd:
    """Calls a function at the end of a `with` block."""

    def __init__(self, function):
        self._function = function

    def __enter__(self):
        pass

    def __exit__(self, kind, error, traceback):
        self._function()


class Board:
    """Runs a board with one or more strips: its loop, serial port, commands, files and USB.

    The start of a sensor takes 25 ms. During this time, the samples of the other strips wait in the
    FIFOs of their chips. They are processed after the start, not during the start: within a command
    such as ``set``, the stack of a Pico has no room for the processing of a sample.

    Parameters
    ----------
    config : object
        Module board_config, or an object with the attribute ``NAME`` (str) and those that
        `settings.BoardSettings` needs. On a board with several strips, ``SENSORS`` is a list with a
        dict of these for each strip.
    runtime : str
        Name and version of the Python runtime, for the reply to ``hello``.
    uid : str
        Unique id of the board.
    open_sensor : callable
        ``open_sensor(config, clock)`` returns an `as7341.AS7341` that is not started yet.
    clock : object
        ``ticks_us``, ``ticks_add``, ``ticks_diff`` and ``sleep_us`` as in MicroPython's ``time``.
    serial : object
        Serial port. ``write(buffer, size) -> bool`` sends a frame if there is room, and returns
        whether it was sent. ``read()`` returns the next byte as int, or -1 if no byte waits; it
        must not allocate.
    usb : object, optional
        USB stack, see `interfaces.Interfaces`. None on a board that cannot be a USB keyboard.
    attach : callable, optional
        `radio.start.attach` on a board that has a radio.

    Attributes
    ----------
    sensors : int
        Count of sensors on the board.
    strips : tuple of strip_app.StripApp
        The strips.
    radio : radio.wireless.Wireless or None
        The radio, if the setting ``radio`` has switched it on.
    current : strip_app.StripApp
        The strip whose sample the loop waits for, or processes.
    searches : bool
        Whether a sensor may be lost.
    boot_faults : list of str
        What went wrong at the start, of all strips; see `strip_app.StripApp.boot_faults`.
    reboot : bool
        True ends `run`.
    report_us : int
        Longest sleep while reports wait, in us.
    ticks_us, sleep_us : callable
        Functions of the clock with which a pass waits for the next sample. A runtime can replace
        them.
    feed : callable or None
        Called in every pass if a watchdog runs.
    interrupt_at : callable
        ``interrupt_at(character)`` sets the interrupt character, as ``micropython.kbd_intr``.
    signal : callable or None
        ``signal(leds)`` lights the board's LED as the keyboard LEDs `leds`. Without a computer, the
        LED shows the state of the strips: it blinks while a sensor does not answer, is lit until
        each strip has a calibration, and is then dark, until a host switches caps lock on.
    """

    signal = feed = None
    _lit = 0
    report_us = 1_000  # USB takes a report each millisecond

    def __init__(self, config, runtime, uid, open_sensor, clock, serial, usb=None, attach=None):
        self.name = config.NAME
        self.runtime = runtime
        self.uid = uid
        self.clock = clock
        self.ticks_us = clock.ticks_us
        self._ticks_diff = clock.ticks_diff
        self.sleep_us = clock.sleep_us
        self.time = Time32(clock)
        self._reader = LineReader()
        self.reboot = False
        self.searches = True
        self.interrupt_at = _nothing
        self._answered = 0
        self._slice_us = _SLICE_US
        self.store = Store()
        self.radio = None
        if attach:
            serial, usb = attach(self, serial, usb)
        self._read = serial.read
        self.framer = Framer(serial, self.time)
        self.interfaces = Interfaces(usb, self.time)
        several = getattr(config, "SENSORS", None)
        self.sensors = len(several or (config,))
        self._turns = None  # on a board with one strip, it is always this strip's turn
        if several:
            from .aligned import Turns, open_strips

            self.strips = open_strips(self, several, open_sensor)
            self._turns = Turns(self.strips, clock)
        else:
            self.strips = (StripApp(self, 0, config, open_sensor(config, clock)),)
        self.current = self.strips[0]
        wanted = []
        for strip in self.strips:
            wanted += strip.outputs.wanted()
        # The host reads the USB descriptors once, so the interfaces cannot change later.
        self.interfaces.open(wanted)
        if self.radio is not None:
            self.radio.start()
        self._commands = Commands(self)
        self.boot_faults = []
        for strip in self.strips:
            strip.outputs.connect()
            for fault in strip.boot_faults():
                strip.replies.log("error", fault)
                self.boot_faults.append(fault)

    def run(self):
        """Run until the command ``reboot``.

        On every exit path all keys are released and the LED is switched off.
        """
        self._left = False
        self._end = None  # deadline in ticks
        # Two interrupts, a pending one and a new one, may occur before `_leave` has switched Ctrl-C
        # off. Each of them ends one call early.
        leave, allow = _AtEnd(self._leave), _AtEnd(self._allow)
        with allow, allow, leave, leave, leave:
            while not self.reboot:
                self.step(False)

    def _allow(self):
        self.interrupt_at(_CTRL_C)

    def _leave(self):
        self.interrupt_at(_NO_CHARACTER)
        if self._left:
            return
        clock = self.clock
        try:
            if self._end is None:
                self._end = clock.ticks_add(clock.ticks_us(), _LAST_US)
            self.release_keys()
            while not self.interfaces.pump():
                if clock.ticks_diff(self._end, clock.ticks_us()) <= 0:
                    break
                clock.sleep_us(1_000)
        finally:
            for strip in self.strips:
                strip.strip.stop()
            if self.radio is not None:
                self.radio.close()
        self._left = True

    def release_keys(self):
        """Release the keys of all strips, and what a host may see."""
        for strip in self.strips:
            strip.release_keys()
            strip.outputs.pump()
        self.interfaces.release()

    def step(self, once=True):
        """Run one pass of the loop, or with `once` false all passes until ``reboot`` or an error.

        A pass allocates nothing while sampling. It sleeps 13 ms at most, so that commands are read
        often.
        """
        # The exception handler is outside of the loop, so that no call frame of a pass needs the
        # heap; see strip.py.
        try:
            while True:
                self._pass()
                if once or self.reboot:
                    return
        except (OSError, SensorError) as error:
            self.current.reconnect.lose(error)
            self.current.outputs.pump()  # frames of the released keys

    def _pass(self):
        if self.feed is not None:
            self.feed()
        if self.radio is not None:
            self.radio.work()
        if self.searches:
            self._search()  # before a command: the first `hello` reports the calibration
        byte = self._read()
        if byte >= 0 and self._listen(byte):
            self._answer()
        if self._turns is not None:
            self.current = self._turns.next(self.ticks_us())
        strip = self.current
        wait_us = _SLICE_US + 1
        if not strip.reconnect.lost:
            wait_us = self._ticks_diff(strip.pacing.due, self.ticks_us())
        if wait_us > self._slice_us:
            self.sleep_us(self._slice_us)
        else:
            if wait_us > 0:
                self.sleep_us(wait_us)
            self._sample(strip)
        # After the samples, so that their keys do not wait until the end of a sleep.
        if strip.outputs.pumps:  # without keys a look-up, which is shorter than a call
            self._pump()

    def _sample(self, strip):
        poll = strip.poll
        take = strip.take
        if poll():
            if strip.reconnect.fault:
                strip.reconnect.sampled()
            take()
            # The other samples of this FIFO read, at most 19. `poll` does not use the bus for them.
            # `take` can restart the sensor, which drops them. Those of several strips are processed
            # in the order of their times, in one pass each.
            while strip.sensor.waits and self._turns is None:
                if strip.outputs.pumps:
                    self._pump()
                poll()
                take()

    def _pump(self):
        self.current.outputs.pump()
        self._slice_us = _SLICE_US if self.interfaces.pump() else self.report_us

    def _search(self):
        self.time.update()  # must be updated more often than the ticks wrap
        self.searches = False
        for strip in self.strips:
            if strip.reconnect.lost:
                self.searches = True
                if not strip.reconnect.search():
                    continue
                if strip.reconnect.lost and self.signal:
                    self._lit ^= CAPS_LOCK
                    self.signal(self._lit)
                # While no strip samples, a pause for garbage collection costs no sample. Without
                # the collection, the garbage of attempts would slow down the loop until the next
                # command.
                if self._turns is None:
                    gc.collect()

    def show_state(self):
        """Show with the LED whether each strip has a calibration; see the attribute `signal`."""
        lit = 0
        for strip in self.strips:
            if strip.reconnect.lost:
                return
            if strip.strip.decode.calibration is None:
                lit = CAPS_LOCK
        if self.signal:
            self.signal(lit)

    def log(self, level, text):
        """Send the log line `text` to the host; `level` is ``"info"`` or ``"error"``."""
        self.strips[0].replies.log(level, text)

    def save(self):
        """Write settings, calibrations and layouts of all strips to flash.

        A power cut leaves the old or the new ones.

        Raises
        ------
        OSError
            If a file cannot be written. The stored state then remains as it is.
        """
        self.store.save(self.stored())
        for strip in self.strips:
            strip.unused = []

    def stored(self):
        """Return name and lines of each part that ``save`` stores: a list of tuples."""
        parts = []
        for strip in self.strips:
            parts += strip.stored()
        return parts

    def time_us(self):
        """Return the board's time in us modulo 2**32."""
        self.time.update()
        return self.time.us()

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
            self.strips[0].replies.send(reply)
        # A collection costs samples, but here a host expects a pause.
        self._answered += 1
        if self._answered % _COLLECT_EVERY == 0:
            gc.collect()
        for strip in self.strips:  # a command may release keys
            strip.outputs.pump()
        self._slice_us = _SLICE_US if self.interfaces.pump() else self.report_us
