"""The application of a board with several strips: one loop samples all, no strip waits.

Only a board whose board.toml has ``SENSORS`` gets this module. Sensor 0 has the files of a board
with one strip. Each strip has its own settings, calibration, dark frame, layout and commands.
"""

import gc

from micropython import const

from .app import BoardApp
from .as7341 import SensorError
from .decode import DROPPED, GAP
from .frame import Framer
from .uses import INTERFACES

_SLICE_US = const(10_000)  # longest sleep without reading commands
_RETRY_US = const(100_000)  # time between two starts of a sensor that does not answer
# A strip whose last poll was too early goes first, unless another strip is late by this time: its
# next poll bounds the time of its sample.
_PUNCTUAL_US = const(500)
# A poll later than this finds its sample even if it was scheduled too early. Such a poll does not
# advance the next one, for `_RENEW` samples at most.
_LATE_US = const(100)
_RENEW = const(224)  # as in pacing.py
_MUX_ADDRESS = const(0x70)  # of the I2C multiplexer TCA9548A; one bit of its register a channel
_PREFIX = "sensor="
_FOR_ALL = ("save", "reboot")  # commands that concern all strips


class SensorConfig:
    """The part of board_config that one sensor needs: its bus, its pins and its LED.

    Parameters
    ----------
    values : dict
        An entry of board_config's ``SENSORS``.
    """

    def __init__(self, values):
        for name, value in values.items():
            setattr(self, name, value)


class ChannelBus:
    """A sensor's I2C bus behind a multiplexer TCA9548A; selects the channel before each transfer.

    Parameters
    ----------
    bus : object
        The bus of the board, see `as7341`; its ``write_to(address, buffer)`` writes to any chip.
    channel : int
        Channel of the sensor, 0 to 7.
    """

    def __init__(self, bus, channel):
        self.recover = bus.recover
        self._bus = bus
        self._channel = bytes((1 << channel,))

    def read_into(self, register, buffer):
        self._bus.write_to(_MUX_ADDRESS, self._channel)
        self._bus.read_into(register, buffer)

    def write(self, buffer):
        self._bus.write_to(_MUX_ADDRESS, self._channel)
        self._bus.write(buffer)


class StripClock:
    """The clock of one strip: while the strip waits, the other strips are sampled.

    Parameters
    ----------
    clock : object
        ``ticks_us``, ``ticks_add``, ``ticks_diff`` and ``sleep_us`` as in MicroPython's ``time``.
    app : StripApp
        Application of the strip.
    """

    def __init__(self, clock, app):
        self.ticks_us = clock.ticks_us
        self.ticks_add = clock.ticks_add
        self.ticks_diff = clock.ticks_diff
        self._app = app

    def sleep_us(self, us):
        """Wait for `us` microseconds."""
        app = self._app
        main = app.main
        current = main.current
        until = self.ticks_add(self.ticks_us(), us)
        app.waits = True
        try:
            while us > 0:
                try:
                    main.serve(us)
                except (OSError, SensorError) as error:
                    main.current.lose(error)
                us = self.ticks_diff(until, self.ticks_us())
        finally:
            app.waits = False
            main.current = current


class StripFramer(Framer):
    """Sends the frames of one strip. Missing samples mark the next frame of this strip only.

    Parameters
    ----------
    framer : frame.Framer
        Framer of the port, whose buffers and sequence numbers are used.
    """

    def __init__(self, framer):
        self._write = framer._write
        self._head = framer._head
        self._payload = framer._payload
        self._delimited = framer._delimited
        self._encoded = framer._encoded
        self._missing = self.dropped = 0

    def gap(self):
        self._missing = DROPPED

    def touch(self, sensor, state):
        self._mark()
        return self._marked(Framer.touch(self, sensor, state))

    def spectrum(self, sensor, flags, gain, counts):
        self._mark()
        return self._marked(Framer.spectrum(self, sensor, flags, gain, counts))

    def _mark(self):
        if self._missing:
            self._head[GAP] = DROPPED

    def _marked(self, sent):
        if sent:
            self._missing = 0
        return sent


class StripApp(BoardApp):
    """The application of one strip of several; `SeveralApp` runs its loop.

    Parameters
    ----------
    main : SeveralApp
        Application of the board.
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
        self._attach(main.open_sensor, None, None)

    @property
    def sensors(self):
        return len(self.main.parts)

    def _attach(self, open_sensor, board, usb):
        gc.collect()  # so that what each strip keeps does not lie between garbage
        self.waits = False  # whether the strip waits, for example while its sensor starts
        self._again = None  # ticks of the next start of a lost sensor; None: at once
        config = SensorConfig(self._board.SENSORS[self.index])
        clock = self._clock
        self._clock = StripClock(clock, self)
        self.framer = StripFramer(self.framer)
        sensor = open_sensor(config, self._clock)
        if hasattr(config, "MUX_CHANNEL"):
            sensor._bus = ChannelBus(sensor._bus, config.MUX_CHANNEL)
        BoardApp._attach(self, sensor, config, None)
        self._clock = clock
        self.pacing = self._sensor.pacing
        self.remaining_us = self._sensor.remaining_us
        self._start, self._sensor.start = self._sensor.start, self._start_sensor
        self._write, self._sensor._write = self._sensor._write, self._write_register
        self._starts = False
        self.uses._sensor = self.index
        self.uses.release = self._release
        self.replies.log = self._log

    def _start_sensor(self, *settings):
        self._starts = True
        try:
            self._start(*settings)
        finally:
            self._starts = False

    def _write_register(self, register, value):
        # A start takes longer than an exposure, so other strips are sampled between its steps.
        self._write(register, value)
        if self._starts:
            self._sensor._clock.sleep_us(1)

    def search(self, now):
        """Start a lost sensor if that is due at `now` (ticks). Other strips are sampled meanwhile.

        `reconnect.Reconnect.search` would stop the loop, and collect garbage, at each attempt.
        """
        if self._again is not None and self._clock.ticks_diff(now, self._again) < 0:
            return
        self._time.update()
        try:
            self.strip.start()
        except (OSError, SensorError) as error:
            self.lose(error)
            return
        self.reconnect.lost = False
        self.use_stored()

    def lose(self, error):
        """Record that the sensor does not answer, because of `error`; other strips continue."""
        self.reconnect.lose(error)
        clock = self._clock
        self._again = clock.ticks_add(clock.ticks_us(), _RETRY_US)

    def poll(self):
        """Read a sample, if there is one, and process it."""
        clock = self._clock
        pacing = self.pacing
        began = clock.ticks_us()
        late_us = clock.ticks_diff(began, pacing.due) - _LATE_US
        waits = self._sensor.waits
        if self._sensor.poll():
            late = late_us > pacing._creep and 0 <= pacing._samples < _RENEW
            if late and not self._sensor.waits:
                pacing.due = clock.ticks_add(pacing.due, pacing._creep)
            if self.reconnect.fault:
                self.reconnect.sampled()
            self.strip.take()
            burst_us = 0 if waits else self._sensor.burst_us()
            self.meter.add(clock.ticks_diff(clock.ticks_us(), began), burst_us)

    def measure(self):
        self.meter.restart()

    def rate_mHz(self):
        # The loop processes a sample of each strip in turn.
        busy_us = 0
        for part in self.main.parts:
            busy_us += part.meter.busy_us
        s = self.settings.values
        return 1_000_000_000 // (max(s["exposure_us"], busy_us) * s["average"])

    def identity(self):
        reply = BoardApp.identity(self)
        reply["sensor"] = self.index
        return reply

    def _log(self, level, text):
        self.replies.send({"log": level, "text": text, "sensor": self.index})

    def _path(self, name):
        return BoardApp._path(self, name + (str(self.index) if self.index else ""))

    def _release(self):
        # The strips share one keyboard, so a strip releases only its own keys.
        uses = self.uses
        if uses._fingers is not None:
            uses._fingers.release()
        if uses._keypad is not None:
            uses._keypad.release()
        if uses._gamepad_on:
            uses._axes.release()


class SeveralApp(StripApp):
    """The application of a board with several strips; itself the application of sensor 0.

    Parameters
    ----------
    board, runtime, uid, clock, serial, usb
        As for `app.BoardApp`. ``board.SENSORS`` is a list with a dict for each sensor.
    open_sensor : callable
        ``open_sensor(config, clock)`` returns the sensor of a `SensorConfig`, not started yet.
    """

    def __init__(self, board, runtime, uid, open_sensor, clock, serial, usb=None):
        self.main = self.current = self
        self.parts = ()
        self.open_sensor = open_sensor
        BoardApp.__init__(self, board, runtime, uid, open_sensor, clock, serial, usb)
        self._others = [StripApp(self, i) for i in range(1, len(board.SENSORS))]
        self.parts = (self,) + tuple(self._others)
        self._uploads_to = 0
        self._strips = [part._commands for part in self.parts]
        self._commands = self
        self._open_usb(usb)

    def _open_usb(self, usb):
        # One USB interface of a kind, if any strip needs it, is the output of all strips.
        uses = self.uses
        wanted = set()
        for part in self.parts:
            wanted.update(part.uses._wanted())
        uses._usb = usb
        uses._open([name for name, _ in INTERFACES if name in wanted])
        if uses.fault:
            self.log("error", uses.fault)
        for part in self._others:
            for name in ("_usb", "fault", "_there", "_keyboard", "_consumer"):
                setattr(part.uses, name, getattr(uses, name))
            if uses._axes is not None:
                part.uses._axes = type(uses._axes)(uses._there["gamepad"])

    def _attach(self, open_sensor, board, usb):
        self.port = self.framer
        StripApp._attach(self, open_sensor, board, usb)

    def handle(self, line):
        """Execute a command on the strip that ``sensor=N`` at the end of `line` names, else on 0.

        All lines of an upload belong to the sensor of its first line. The result is that of
        `command.Commands.handle`.
        """
        words = line.split()
        index, name = 0, words[0] if words else ""
        if len(words) > 1 and words[-1].startswith(_PREFIX):
            known = [str(i) for i in range(len(self.parts))]
            number = words.pop()[len(_PREFIX) :]
            if number not in known:
                return {"re": name, "error": "sensor must be one of " + ", ".join(known)}
            index = int(number)
            line = " ".join(words)
        elif name in ("cal", "layout") and words[1:] not in (["begin"], ["clear"]):
            index = self._uploads_to
        self._uploads_to = index
        if name == "reboot":
            for part in self._others:
                part.abandon("the board was rebooted")
        reply = self._strips[0 if name in _FOR_ALL else index].handle(line)
        if reply is not None:
            reply["sensor"] = index
        return reply

    def save(self):
        for part in self.parts:
            BoardApp.save(part)

    def serve(self, longest_us):
        """Wait for the next sample of any strip, and process it; sleep for `longest_us` at most."""
        chosen = None
        least_us = i = 0
        while i < len(self.parts):  # an iterator would need a larger call frame, see strip.py
            part = self.parts[i]
            i += 1
            if part.waits or part.reconnect.lost:
                continue
            left_us = part.remaining_us()
            if part.pacing._was_early:
                left_us -= _PUNCTUAL_US
            if chosen is None or left_us < least_us:
                chosen = part
                least_us = left_us
        if chosen is not None:
            left_us = chosen.remaining_us()
            if left_us <= longest_us:
                if left_us > 0:
                    self._clock.sleep_us(left_us)
                self.current = chosen
                chosen.poll()
                return
        self._clock.sleep_us(longest_us)

    def step(self):
        try:
            self._pass()
        except (OSError, SensorError) as error:
            self.current.lose(error)

    def _run(self):
        try:
            while not self.reboot:
                self._pass()
        except (OSError, SensorError) as error:
            self.current.lose(error)

    def _pass(self):
        if self.feed is not None:
            self.feed()
        byte = self._read()
        if byte >= 0:
            self._listen(byte)
        self.uses.pump()  # the outputs of all strips
        now = self._clock.ticks_us()
        for part in self.parts:
            if part.reconnect.lost:
                part.search(now)
        self.serve(_SLICE_US)

    def _leave(self):
        self.interrupt_at(-1)
        if self._left:
            return
        try:
            for part in self._others:
                part.release_keys()
        finally:
            for part in self._others:
                part.strip.stop()
            BoardApp._leave(self)
