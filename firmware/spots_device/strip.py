"""Processes the samples of one strip: averages and decodes them, and sends frames.

Rare operations are in the modules `dark` and `search`. `Strip.take` allocates only after the last
sample of a dark frame, and at the end of a search.
"""

from array import array

from micropython import const

from .calibration import Conditions
from .dark import Baseline, Dark, OddLight
from .decode import DARK_SUBTRACTED, FLAGS, LED_OFF, SATURATED, TOUCHING, Decode
from .exposure import AGAIN, DONE, choose
from .kernel import accumulate, estimate
from .smux import CHANNELS

_IDLE_US = const(1_000_000)  # time without a touch before the LED may be switched off

_LIT = const(0)
_UNKNOWN = const(1)  # LED on, but without a dark frame: a dark window must come first
_BLINKING = const(2)  # LED off, dark samples are taken
_RISING = const(3)  # LED on again, waits for a completely lit sample


class Strip:
    """Reads, decodes and sends the samples of one sensor.

    Parameters
    ----------
    index : int
        Number of the sensor in the frames.
    uid : str
        Unique id of the board.
    sensor : as7341.AS7341
        The sensor.
    framer : frame.Framer
        Sends the frames.
    time : frame.Time32
        Board time; set to the middle of the integration before each frame.
    clock : object
        ``ticks_add`` as in MicroPython's ``time``.
    settings : settings.BoardSettings
        Settings of the board; read at every start.
    uses : uses.Uses
        Receives every reading.

    Attributes
    ----------
    conditions : calibration.Conditions or None
        Board and settings of the readings; None before the first start.
    lit_flags : int
        Flags of a sample with the LED on: `decode.DARK_SUBTRACTED`, or 0 while an LED that is
        always on has no dark frame.
    baseline : dark.Baseline
        The baseline. Its `floor`, six sums over the number of dark samples set with
        `Decode.scale`, is subtracted from each reading.
    """

    def __init__(self, index, uid, sensor, framer, time, clock, settings, uses):
        self.index = index
        self.sensor = sensor
        self.settings = settings
        self.conditions = None
        self.decode = Decode()
        self._dark = Dark()
        self.baseline = Baseline(self._dark)
        self._odd_light = OddLight(self._dark)
        self.stream_touch = self.stream_spectrum = False
        self._uid = uid
        self._pacing = sensor.pacing
        self._framer = framer
        self._uses = uses
        self._time = time
        self._reading = self.decode.state
        self._sums = array("i", bytes(4 * CHANNELS))
        self._average = 1
        self._idle_us = 0
        self._search = None
        self._on_dark = self._on_search = None

    def start(self):
        """Start the sensor with the present settings; the first samples are a dark frame.

        Raises
        ------
        as7341.SensorError, OSError
            If the sensor does not answer, see `as7341.AS7341.start`.
        """
        s = self.settings.values
        self._begin(s["gain"], s["led_mA"], s["exposure_us"])

    def stop(self):
        """Stop sampling and switch the LED off; ignore a sensor that does not answer."""
        try:
            self.sensor.stop()
        except OSError:
            pass

    def report(self, reply):
        """Add dark frame, baseline and counters of the sensor to a reply to ``get`` (dict)."""
        reply["dark"] = self.dark_frame()
        reply["rest"] = self.baseline.sums()
        self.sensor.report(reply)

    def saturation(self):
        """Return the saturation of the last sample, see `as7341.AS7341`; None if the bus fails."""
        try:
            return self.sensor.saturation()
        except OSError:
            return None

    def dark_frame(self):
        """Return the dark frame: six sums over `decode.DARK_SAMPLES` samples."""
        return self._dark.sums()

    def configure(self):
        """Apply the settings that need no restart of the sensor."""
        values = self.settings.values
        if self._average != values["average"]:
            self._average = values["average"]
            self._samples = self._flags = 0
        self._mains_hz = values["mains_hz"]
        self._follows = values["baseline"]
        if self.baseline.followed and not self._follows:
            self.baseline.forget()
        if values["led"] == "always":
            self._dark.schedule(0, 0)
        else:
            self._dark.schedule(self.sensor.exposure_us, values["dark_every"])

    def streams(self):
        """Return a list of the kinds of streamed frames: ``contact``, ``spectrum``, ``touch``."""
        names = []
        if self._uses.streams_contacts:
            names.append("contact")
        if self.stream_spectrum:
            names.append("spectrum")
        if self.stream_touch:
            names.append("touch")
        return names

    def stream(self, names):
        """Stream only the kinds of frames in `names`: ``touch``, ``spectrum``, ``contact``.

        Returns
        -------
        str or None
            Note for the user.
        """
        self.stream_touch = "touch" in names
        self.stream_spectrum = "spectrum" in names
        return self._uses.stream_contacts("contact" in names, self.decode.calibration)

    def request_dark(self, done):
        """Request a dark frame; ``done()`` is called when the dark frame is complete."""
        self._dark.request_pool()
        self._on_dark = done

    def request_search(self, done):
        """Search gain, LED current and exposure; then ``done(outcome)`` is called."""
        from .search import Search  # rare, and large

        s = self.settings.values
        led_max_mA = self.settings.led_max_mA if s["led"] == "ldr" else 0
        self._search = Search(s["gain"], s["led_mA"], s["exposure_us"], led_max_mA)
        self._on_search = done
        self._dark.request()

    def request_rest(self):
        """Use the next reading as the baseline."""
        self.baseline.wanted = True

    def forget_requests(self):
        """Cancel the requested dark frame and the requested search of settings."""
        self._search = self._on_search = self._on_dark = None

    # Processing of a sample.

    # The functions that run for every sample need at most 11 words for locals and arguments.
    # MicroPython allocates larger call frames on the heap, which costs about 80 us on an RP2040.

    def take(self):
        """Process the sample that `as7341.AS7341.poll` has just read."""
        sensor = self.sensor
        missed = self._pacing.missed
        if missed != self._missed:
            self._missed = missed
            self._framer.gap()
        dark = self._dark
        age_us = dark.age_us
        if age_us < dark.every_us:
            dark.age_us = age_us + dark.exposure_us
        if self._state == _LIT:
            if sensor.steady:
                self._take_lit(sensor)
        elif self._state != _UNKNOWN:
            self._take_blink(sensor)
        if dark.wanted or dark.age_us >= dark.every_us:
            self._blink_if_due(sensor)
        elif self._mains_hz:
            self._correct_drift(sensor)

    def _take_lit(self, sensor):
        sums = sensor.counts
        if self._average > 1:
            sums = self._sums
            accumulate(sums, sensor.counts, self._samples)
        if sensor.saturated:
            self._flags |= SATURATED
        self._samples += 1
        if self._search is not None:
            self._judge(sensor)
        elif self._samples >= self._average:
            self._emit(sums, self._flags)

    def _emit(self, sums, flags):
        sensor = self.sensor
        baseline = self.baseline
        if sensor.led_on:
            flags |= self.lit_flags
            if self._samples != baseline.samples:
                self._rescale()
        else:
            flags |= LED_OFF
        estimate(self._reading, self.decode.tables, sums, baseline.floor, flags)
        self._send(sums, self._samples * sensor.exposure_us)

    def _rescale(self):
        self.decode.scale(self._samples, self.baseline.rescale(self._samples))

    def _send(self, sums, lasted_us):
        flags = self._reading[FLAGS]
        if flags & TOUCHING:
            self._idle_us = 0
        elif self._idle_us < _IDLE_US:
            self._idle_us += lasted_us
        self._time.set(self.sensor.complete, lasted_us >> 1)
        if self.decode.compensation:
            self.decode.compensation.take(self._reading, self._time.ticks())
        uses = self._uses
        if uses.active:
            uses.take(self.index, self._reading)
        if self.stream_touch:
            self._framer.touch(self.index, self._reading)
        # Readings of two fingers look like ambient light. They have less weight in the detection,
        # because a dark frame costs readings.
        if uses.two:
            lasted_us >>= 3
        self._odd_light.take(flags, self._reading, lasted_us)
        if self._follows and not flags & LED_OFF:
            self._follow(sums)
        if self.stream_spectrum:
            self._send_spectrum(sums)
        self._samples = self._flags = 0

    def _follow(self, sums):
        self.baseline.follow(sums, self._samples, self._idle_us, self._uses.rests)

    def _send_spectrum(self, sums):
        samples = self._samples
        if samples > 1:
            for i in range(CHANNELS):
                sums[i] = (sums[i] + (samples >> 1)) // samples
        self._framer.spectrum(self.index, self._reading[FLAGS], self.sensor.gain, sums)

    # Rare operations.

    def _begin(self, gain, led_mA, exposure_us):
        sensor = self.sensor
        values = self.settings.values
        led = values["led"]
        if sensor.led == "gpio" != led:
            sensor.gpio(False)
        sensor.led = led
        mains_hz = values["mains_hz"]
        exposure_us = choose(exposure_us, mains_hz)
        sensor.start(values["plan"], gain, exposure_us, led_mA, mains_hz)
        self.conditions = Conditions(
            self._uid, sensor.plan, sensor.gain, sensor.exposure_us, sensor.led_mA
        )
        self._missed = 0
        self._framer.gap()
        self.configure()
        self._dark.request()
        self._state = _UNKNOWN
        self.lit_flags = DARK_SUBTRACTED
        if led == "always":
            self._state = _LIT
            stored = values["dark"]
            if not self._dark.use(stored[:2] == [gain, sensor.exposure_us] and stored[2:]):
                self.lit_flags = 0
        self.baseline.forget()
        self._samples = self._flags = 0

    def _blink_if_due(self, sensor):
        # Only a requested dark frame may interrupt an average.
        dark = self._dark
        due = dark.wanted or (not self._samples and (self._idle_us >= _IDLE_US or dark.always))
        if due and self._state <= _UNKNOWN:
            self._start_blink(sensor)

    def _correct_drift(self, sensor):
        if (
            self._state == _LIT
            and self._search is None
            and (self._dark.always or not self._reading[FLAGS] & TOUCHING)
            and sensor.drifted()
        ):
            self.start()

    def _start_blink(self, sensor):
        sensor.switch_led(False)
        self._samples = self._flags = 0
        self._dark.begin(sensor.exposure_us)
        self._state = _BLINKING

    def _take_blink(self, sensor):
        complete = False
        if self._state == _RISING:
            if sensor.steady:
                self._state = _LIT
                self._take_lit(sensor)
                return
        elif sensor.steady:
            complete = self._dark.add(sensor.counts)
        self._samples = 1
        self._emit(sensor.counts, LED_OFF)
        if complete:
            self._end_blink(sensor)

    def _end_blink(self, sensor):
        self.baseline.update()
        self._odd_light.restart()
        sensor.switch_led(True)
        sensor.check()
        self._state = _RISING
        if self._on_dark and not self._dark.wanted:  # a newer request needs a new frame
            if not self._dark.exposure_us:
                frame = [sensor.gain, sensor.exposure_us] + self._dark.sums()
                self.settings.values["dark"] = frame
                self.lit_flags = DARK_SUBTRACTED
            done, self._on_dark = self._on_dark, None
            done()

    def _judge(self, sensor):
        search = self._search
        outcome = search.step(self._dark.peak(sensor.counts), sensor.full_scale, sensor.saturated)
        if outcome == AGAIN:
            self._begin(search.gain, search.led_mA, search.exposure_us)
            return
        self._search = None
        if outcome == DONE:
            s = self.settings.values
            s["gain"], s["led_mA"] = search.gain, search.led_mA
            s["exposure_us"] = sensor.exposure_us
        else:
            self.start()
        self._on_search(outcome)
