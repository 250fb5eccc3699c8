"""Runs a board with several strips: one loop samples all strips.

Only a board whose configuration has ``SENSORS`` gets this module. Each strip has its own settings,
calibration, dark frame, layout and commands. The files of strip 0 have the same names as on a board
with one strip; one save stores all strips.

The start of a sensor takes 25 ms. During this time, the samples of the other strips wait in the
FIFOs of their chips. They are processed after the start, not during the start: within a command
such as ``set``, the stack of a Pico has no room for the processing of a sample.
"""

import gc

from .. import const
from ..reading.frame import Framer
from ..sensor.as7341 import SensorError
from .aligned import FINE, AlignedPacing
from .app import BoardApp
from .outputs import INTERFACES

_SLICE_US = const(10_000)  # longest sleep without reading commands
_RETRY_US = const(100_000)  # time between two starts of a sensor that does not answer
# The loop polls the strip with the earliest deadline next. To give a strip priority, the following
# times are subtracted from its deadline.
# For a strip whose sample times are unknown.
_UNKNOWN_US = const(2_500)
# For a strip whose next poll bisects (see aligned.py), so that it must be on time: 128 times the
# error of its sample times, at most this value times the number of other strips. The value is the
# time to process a sample.
_AHEAD_US = const(2_500)
# For a strip with unknown sample times after a poll that was too early; the second value only if
# the last poll of the loop was of this strip. Without it, two such strips would be polled in turn,
# and the polls of each strip would be too far apart.
_PUNCTUAL_US = const(500)
_STAYS_US = const(4_000)
_PREFIX = "sensor="
_UPLOADS = ("cal", "layout")
_FIRST = ["begin"], ["clear"]  # words of the first line of an upload
_FOR_ALL = ("save", "reboot")  # commands that concern all strips


class StripFramer(Framer):
    """Sends the frames of one strip, and counts the dropped frames of this strip.

    Parameters
    ----------
    framer : frame.Framer
        Framer of the port, whose buffers and sequence numbers are used.
    """

    def __init__(self, framer):
        self._write = framer._write
        self._head = framer._head
        self.payload = framer.payload
        self._delimited = framer._delimited
        self.encoded = framer.encoded
        self.dropped = 0


class StripApp(BoardApp):
    """Handles one strip of a board; `SeveralApp` runs the loop for all strips.

    Parameters
    ----------
    main : SeveralApp
        Runs the board.
    index : int
        Number of the sensor, 1 or more.
    """

    def __init__(self, main, index):
        self.main = main
        self.index = index
        self._board = main._board
        self._runtime = main._runtime
        self._clock = main._clock
        self._time = main._time
        # A calibration belongs to its strip, so each strip has an id.
        self._uid = "%s-%d" % (main._uid, index)
        self.framer = main.port
        self.store = main.store
        self._attach(main.open_sensor, None, None)

    @property
    def sensors(self):
        return len(self.main.parts)

    def _attach(self, open_sensor, board, usb):
        gc.collect()  # so that the objects of each strip do not lie between garbage
        self._again = None  # ticks of the next start of a lost sensor; None: start it immediately
        config = type("Config", (), self._board.SENSORS[self.index])
        self.framer = StripFramer(self.framer)
        sensor = open_sensor(config, self._clock)
        if hasattr(config, "MUX_CHANNEL"):
            from ..sensor.multiplexer import connect

            connect(sensor, config.MUX_CHANNEL)
        sensor.pacing = AlignedPacing(self._clock)
        BoardApp._attach(self, sensor, config, None)
        self.pacing = self._pacing
        self.pacing.app = self
        self.pacing.lost = True
        self.outputs._sensor = self.index
        self.outputs.shares = True
        self.replies.log = self._log

    def search(self, now):
        """Try to start a lost sensor, at most every 0.1 s; `now` is the time in ticks.

        `reconnect.Reconnect.search` cannot be used here. It waits for 0.1 s and collects garbage,
        and the loop must sample the other strips during this time.
        """
        if self._again is not None and self._clock.ticks_diff(now, self._again) < 0:
            return
        self._time.update()
        self._blink()
        try:
            self.strip.start()
        except (OSError, SensorError) as error:
            self.reconnect.lose(error)
            return
        self.reconnect.lost = self.pacing.lost = False
        self.use_stored()

    def _sensor_lost(self):
        clock = self._clock
        self._again = clock.ticks_add(clock.ticks_us(), _RETRY_US)
        self.pacing.lost = self.main._lost = True
        BoardApp._sensor_lost(self)

    def poll(self):
        """Read a sample, if there is one, and process it."""
        if self._poll():
            if self.reconnect.fault:
                self.reconnect.sampled()
            self.strip.take()

    def identity(self):
        reply = BoardApp.identity(self)
        reply["sensor"] = self.index
        return reply

    def _log(self, level, text):
        self.replies.send({"log": level, "text": text, "sensor": self.index})

    def _name(self, part):
        return part + (str(self.index) if self.index else "")


class SeveralApp(StripApp):
    """Runs a board with several strips. This object also handles strip 0 itself.

    Parameters
    ----------
    board, runtime, uid, clock, serial, usb
        As for `app.BoardApp`. ``board.SENSORS`` is a list with a dict for each sensor.
    open_sensor : callable
        ``open_sensor(config, clock)`` returns a sensor that is not started yet. ``config`` has
        one attribute for each key of a dict in ``SENSORS``.
    """

    def __init__(self, board, runtime, uid, open_sensor, clock, serial, usb=None):
        self.main = self.current = self
        self.parts = self._pacings = ()
        self._lost = True  # whether a sensor may be lost
        self.open_sensor = open_sensor
        BoardApp.__init__(self, board, runtime, uid, open_sensor, clock, serial, usb)
        self._others = [StripApp(self, i) for i in range(1, len(board.SENSORS))]
        self.parts = (self,) + tuple(self._others)
        self._pacings = tuple([part.pacing for part in self.parts])
        self.lose = self._lose_current
        self._ahead_us = _AHEAD_US * len(self._others)
        self._uploads_to = 0
        self._strips = [part._commands for part in self.parts]
        self._commands = self
        self._open_usb(usb)

    def _open_usb(self, usb):
        # All strips share the USB interfaces. An interface is opened if any strip needs it.
        outputs = self.outputs
        wanted = set()
        for part in self.parts:
            wanted.update(part.outputs._wanted())
        outputs._usb = usb
        outputs._open([name for name, _, _ in INTERFACES if name in wanted])
        if outputs.fault:
            self.log("error", outputs.fault)
        for part in self._others:
            part.outputs.keyboard_of = outputs
            for name in ("_usb", "fault", "_there", "_pressed_by", "_pressing"):
                setattr(part.outputs, name, getattr(outputs, name))
            if outputs._axes is not None:
                part.outputs._axes = type(outputs._axes)(outputs._there["gamepad"])

    def _attach(self, open_sensor, board, usb):
        self.port = self.framer
        StripApp._attach(self, open_sensor, board, usb)

    def handle(self, line):
        """Execute a command for strip N if `line` ends with ``sensor=N``, else for strip 0.

        Of an upload, only the first line needs ``sensor=N``; ``save`` and ``reboot`` are for all
        strips. The result is that of `command.Commands.handle`.
        """
        words = line.split()
        index, name = 0, words[0] if words else ""
        if len(words) > 1 and words[-1].startswith(_PREFIX):
            known = [str(i) for i in range(len(self.parts))]
            number = words.pop()[len(_PREFIX) :]
            if number not in known:
                error = "sensor must be one of " + ", ".join(known)
                return {"re": name, "error": error, "why": "no_sensor"}
            index = int(number)
            line = " ".join(words)
        elif name in _UPLOADS and words[1:2] != ["lines"] and words[1:] not in _FIRST:
            index = self._uploads_to
        if name in _UPLOADS and words[1:2] != ["lines"]:
            self._uploads_to = index
        if name == "reboot":
            for part in self._others:
                part.abandon("the board was rebooted")
        reply = self._strips[0 if name in _FOR_ALL else index].handle(line)
        if reply is not None:
            reply["sensor"] = index
        return reply

    def stored(self):
        parts = []
        for part in self.parts:
            parts += BoardApp.stored(part)
        return parts

    def save(self):
        BoardApp.save(self)
        for part in self._others:
            part._unused = []

    def serve(self, longest_us):
        """Wait for the next sample of any strip, and process it; sleep for `longest_us` at most."""
        pacing = self._next(self.ticks_us())
        if pacing is not None:
            left_us = self._ticks_diff(pacing.due, self.ticks_us())
            if left_us <= longest_us:
                if left_us > 0:
                    self.sleep_us(left_us)
                self.current = pacing.app
                self.current.poll()
                return
        self.sleep_us(longest_us)

    def _next(self, now):
        chosen = None
        least_us = i = 0
        while i < len(self._pacings):  # an iterator would need a larger call frame, see strip.py
            pacing = self._pacings[i]
            i += 1
            if pacing.lost:
                continue
            left_us = self._ticks_diff(pacing.due, now)
            if not pacing._locked:
                left_us -= _UNKNOWN_US
                if pacing._was_early:
                    left_us -= _PUNCTUAL_US
                    if pacing is self.current.pacing:
                        left_us -= _STAYS_US
            elif pacing._half > FINE:
                left_us -= min(pacing._half >> 1, self._ahead_us)
            if chosen is None or left_us < least_us:
                chosen = pacing
                least_us = left_us
        return chosen

    def _lose_current(self, error):
        self.current.reconnect.lose(error)

    def _pass(self):
        if self.feed is not None:
            self.feed()
        if self._lost:
            self._search()  # before a command, as in `app.BoardApp`
        byte = self._read()
        if byte >= 0 and self._listen(byte):
            self._answer()
        idle = self.outputs.pump()  # the outputs of all strips
        self.serve(_SLICE_US if idle else self.report_us)
        self.current.outputs.pump()  # its keys

    def _search(self):
        self._lost = False
        now = self.ticks_us()
        for part in self.parts:
            if part.reconnect.lost:
                self._lost = True
                part.search(now)

    def _leave(self):
        self.interrupt_at(-1)
        if self._left:
            return
        try:
            for part in self._others:
                part.release_keys()
                part.outputs.pump()
        finally:
            for part in self._others:
                part.strip.stop()
            BoardApp._leave(self)
