"""Processes the samples of one strip: averages and decodes them, and sends frames.

Rare operations are in the modules `dark` and `search`. `Strip.take` allocates only after the last
sample of a requested dark frame, during a search for settings (command ``autoexpose``), and when it
restarts the sensor to correct the exposure (setting ``mains_hz``).
"""

from array import array

from .. import const
from ..sensor.exposure import AGAIN, DONE, choose
from ..sensor.smux import CHANNELS
from . import decode as d
from .ambient import Ambient
from .calibration import Conditions
from .dark import IDLE_US, Baseline, Dark
from .decode import Decode
from .frame import CHANGING, CONTEXT, TAKEN_OFF_SIZE, TEMPERATURE_MC, TOUCH, TWO, UNKNOWN_MC
from .kernel import process

_LIT = const(0)
_UNKNOWN = const(1)  # LED on, but without a dark frame: a dark window must come first
_BLINKING = const(2)  # LED off, dark samples are taken
_RISING = const(3)  # LED on again, waits for a sample with the LED on all the time
_WARM_US = const(60_000_000)  # least time between two shifts of the tables with the temperature
_Q6_SHIFT = const(6)  # of `decode.SHIFT` for sums over 64 samples
_UNUSED = const(-1)  # in place of the flags of a sample: it is not part of a reading


class Strip:
    """Reads, decodes and sends the samples of one sensor."""

    def __init__(self, index, uid, sensor, framer, time, clock, settings, outputs):
        self.index = index
        self.sensor = sensor
        self.settings = settings
        self.conditions = None  # `calibration.Conditions` of the readings, from the first start on
        self.decode = Decode()
        self._reading = state = self.decode.state
        self._sums = memoryview(state)[d.SUMS : d.SUMS + CHANNELS]
        self._dark = Dark(state)
        self.baseline = Baseline(self._dark)
        self._ambient = Ambient(self._dark, self.baseline)
        self._kind = TOUCH | index << 4
        self.stream_spectrum = False
        self._uid = uid
        self._pacing = sensor.pacing
        self._framer = framer
        self._send = framer.send
        self._outputs = outputs
        outputs.stuck = self.request_tare  # an object becomes a part of the baseline
        self._use_reading = self._use_reading  # binding a method allocates
        self._time = time
        self._head = time.head
        self._work = work = [None] * d.WORK_SIZE
        work[d.STATE] = state
        work[d.COUNTS] = sensor.counts
        work[d.HEAD] = time.head
        work[d.PAYLOAD] = framer.payload
        work[d.ENCODED] = framer.encoded
        self._diff = clock.ticks_diff
        self._search = None
        self._on_dark = self._on_search = None
        self._tare_wanted = False
        # Calibration and conditions for which the baseline was started.
        self._baseline_of = self._baseline_at = None
        self._warmed = 0  # ticks at which the tables were last shifted
        # What the present reading has subtracted, see `frame.Framer.spectrum`.
        self._taken_off = array("i", bytes(4 * TAKEN_OFF_SIZE))
        self._taken_off[TEMPERATURE_MC] = UNKNOWN_MC
        self._state = _UNKNOWN
        # Flags of a sample with the LED on: `DARK_SUBTRACTED`, or 0 if the LED is always on and no
        # dark frame is stored.
        self.lit_flags = 0

    @property
    def stream_touch(self):
        """Whether a TOUCH frame is sent for each reading."""
        return self._reading[d.STREAMED] > 0

    @stream_touch.setter
    def stream_touch(self, on):
        self._reading[d.STREAMED] = self._kind if on else 0

    def start(self):
        """Start the sensor with the present settings; begin with a dark frame if possible.

        It is not possible if the LED is always on. Then a dark frame stored for these settings is
        used, if there is one. A sensor that does not answer raises an error, see
        `as7341.AS7341.start`.
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
        reply["baseline"] = self.baseline.sums()
        reply["temperature_mC"] = self._temperature()
        self.sensor.report(reply)

    def saturation(self):
        """Return `as7341.AS7341.saturation` of the last sample; None if the bus fails."""
        try:
            return self.sensor.saturation()
        except OSError:
            return None

    def dark_frame(self):
        """Return the dark frame: six sums over `decode.DARK_SAMPLES` samples."""
        return self._dark.sums()

    def configure(self):
        """Apply the settings that need no restart of the sensor, and the state of `outputs`."""
        values = self.settings.values
        state = self._reading
        average = values["average"]
        if average != state[d.AVERAGE]:
            state[d.AVERAGE] = average
            state[d.TAKEN] = state[d.PENDING] = 0
            self.decode.scale(average, self.baseline.rescale(average))
        self._mains_hz = values["mains_hz"]
        if values["led"] == "always":
            self._dark.schedule(0, 0)
        else:
            self._dark.schedule(self.sensor.exposure_us, values["dark_every"])
        self._plan_take()

    def streams(self):
        """Return the kinds of frames that are streamed now, as list of str; see `stream`."""
        names = []
        if self._outputs.streams_contacts:
            names.append("contact")
        if self.stream_spectrum:
            names.append("spectrum")
        if self.stream_touch:
            names.append("touch")
        return names

    def stream(self, names):
        """Stream only the kinds of frames in `names`: ``touch``, ``spectrum``, ``contact``.

        Returns why there will be no CONTACT frames (sentence), or None.
        """
        self.stream_touch = "touch" in names
        self.stream_spectrum = "spectrum" in names
        if self.stream_spectrum and self._taken_off[TEMPERATURE_MC] == UNKNOWN_MC:
            self._warm()
        why_not = self._outputs.stream_contacts("contact" in names, self.decode.calibration)
        self._plan_take()
        return why_not

    def request_dark(self, done):
        """Request a dark frame; ``done()`` is called when the dark frame is complete."""
        self._dark.request_pool()
        self._on_dark = done
        self._plan_take()

    def request_search(self, done):
        """Search for gain, LED current and exposure; then call ``done(outcome)``.

        The outcome is `exposure.DONE`, `TOO_DARK` or `TOO_BRIGHT`.
        """
        from ..sensor.search import Search  # rare, and large

        s = self.settings.values
        led_max_mA = self.settings.led_max_mA if s["led"] == "ldr" else 0
        self._search = Search(s["gain"], s["led_mA"], s["exposure_us"], led_max_mA)
        self._on_search = done
        self._dark.request()
        self._plan_take()

    def request_tare(self):
        """Use the next reading as the baseline."""
        self._tare_wanted = self._rare = True

    def use_calibration(self, calibration):
        """Decode readings with a `calibration.Calibration`, or with None.

        The baseline restarts with that of the calibration, unless only the sensor has restarted.
        """
        self.decode.calibration = calibration
        if calibration is not self._baseline_of or self.conditions != self._baseline_at:
            self._baseline_of = calibration
            self._baseline_at = self.conditions
            self.baseline.start(calibration, self.sensor.exposure_us)
        self._warm()

    def forget_requests(self):
        """Cancel the requested dark frame and the requested search for settings."""
        self._search = self._on_search = self._on_dark = None
        self._plan_take()

    # Processing of a sample.

    # The functions that run for every sample need at most 11 words for locals and arguments.
    # MicroPython allocates larger call frames on the heap, which costs 40 us or more on an RP2040.
    # tests/firmware/test_call_frames.py checks this.

    def take(self):
        """Process the sample that `as7341.AS7341.poll` has just read."""
        sensor = self.sensor
        if self._missed != self._pacing.missed:
            self._mark_gap()
        flags = self._lit
        if self._rare or not sensor.steady:
            flags = self._sample_flags(sensor)
            if flags == _UNUSED:
                return
        elif sensor.saturated:
            flags |= d.SATURATED
        self._head[d.LESS_US] += self._diff(sensor.complete, self._time.last)
        self._time.last = sensor.complete
        size = process(self._work, flags)
        if size:
            self._send(size)
        if self.stream_spectrum and not self._reading[d.TAKEN]:
            self._send_spectrum()
        if self._rare or self._reading[d.DUE]:
            self._finish(sensor)

    def _mark_gap(self):
        self._missed = self._pacing.missed
        self._reading[d.MISSING] = d.DROPPED

    def _plan_take(self):
        # What `take` does with the next samples.
        decode = self.decode
        self._work[d.TABLES] = decode.tables
        used = self._outputs.active or decode.compensation or self.stream_spectrum
        self._work[d.USE] = self._use_reading if used else None
        self._lit = self.lit_flags if self.sensor.led_on else d.LED_OFF
        self._rare = bool(
            self._state != _LIT
            or self._search is not None
            or self._mains_hz
            or self.baseline.left
            or self._tare_wanted
            or self._dark.changing
        )

    def _sample_flags(self, sensor):
        # Return the flags of a sample that is not simply lit, or `_UNUSED`.
        state = self._state
        if state == _RISING and sensor.steady:
            self._state = state = _LIT
            self._plan_take()
        if state == _UNKNOWN or (state == _LIT and sensor.steady and self._search is not None):
            if state == _LIT:
                self._search_on(sensor)
            if self._reading[d.WANTED] and self._state <= _UNKNOWN:
                self._start_blink(sensor)
            return _UNUSED
        if state != _LIT:
            return d.LED_OFF | (self.lit_flags if sensor.led_on else 0)
        if not sensor.steady:
            return _UNUSED
        return self._lit | (d.SATURATED if sensor.saturated else 0)

    def _use_reading(self):
        # Pass a reading to compensation, keys and gamepad, for `kernel.process`; return whether two
        # fingers may have caused it.
        if self.stream_spectrum:
            self._take_off()
        if self.decode.compensation:
            self.decode.compensation.take(self._reading, self._time.ticks())
        outputs = self._outputs
        if not outputs.active:
            return False
        outputs.take(self._reading)
        return outputs.two

    def _take_off(self):
        # Record the light that this reading subtracts, before `process` estimates that of the next.
        state = self._reading
        shift = state[d.SHIFT] - _Q6_SHIFT
        for i in range(CHANNELS):
            self._taken_off[i] = state[d.FLOOR + i] << shift

    def _finish(self, sensor):
        if self._state == _BLINKING:
            if sensor.steady and self._dark.add(sensor.counts):
                self._end_blink(sensor)
            return
        if self._state == _LIT and (self._tare_wanted or self.baseline.left):
            self._follow_baseline(sensor)
        if self._dark.changing and self._state == _LIT and not self._reading[d.TAKEN]:
            self._ambient.follow(self._work[d.TABLES])
            if self._dark.is_due():
                self._reading[d.DUE] = 1
        if self._reading[d.DUE] and self._state == _LIT:
            self._start_blink(sensor)
        elif self._mains_hz:
            self._correct_drift(sensor)

    def _follow_baseline(self, sensor):
        # The baseline needs this lit sample.
        complete = not self._reading[d.TAKEN]
        if not self._tare_wanted:
            if self.baseline.after(sensor.counts, complete):
                self._plan_take()
        elif complete:
            self._tare_wanted = False
            self.baseline.take()
            self._plan_take()

    def _send_spectrum(self):
        state = self._reading
        sums = self._sums
        flags = state[d.FLAGS] | state[d.MISSING]
        state[d.MISSING] = 0
        samples = state[d.SAMPLES]
        if samples > 1 and not flags & d.LED_OFF:
            for i in range(CHANNELS):
                sums[i] = (sums[i] + (samples >> 1)) // samples
        taken_off = self._taken_off
        taken_off[CONTEXT] = CHANGING if self._dark.changing else 0
        if self._outputs.two:
            taken_off[CONTEXT] |= TWO
        self._framer.spectrum(self.index, flags, self.sensor.gain, sums, taken_off)

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
        sensor.start(values["channels"], gain, exposure_us, led_mA, mains_hz)
        self.conditions = Conditions(
            self._uid, sensor.plan, sensor.gain, sensor.exposure_us, sensor.led_mA
        )
        self._state = _UNKNOWN
        self.lit_flags = d.DARK_SUBTRACTED
        self._reading[d.EXPOSURE_US] = sensor.exposure_us
        self._missed = self._pacing.missed
        self._reading[d.MISSING] = d.DROPPED
        self.configure()
        self._dark.request()
        if led == "always":
            self._state = _LIT
            stored = values["dark"]
            if not self._dark.use(stored[:2] == [gain, sensor.exposure_us] and stored[2:]):
                self.lit_flags = 0
        self.baseline.update()
        self._reading[d.TAKEN] = self._reading[d.PENDING] = 0
        self._plan_take()

    def _correct_drift(self, sensor):
        if (
            self._state == _LIT
            and self._search is None
            and (not self._reading[d.IDLE_MIN_US] or not self._reading[d.FLAGS] & d.TOUCHING)
            and sensor.drifted()
        ):
            self.start()

    def _start_blink(self, sensor):
        sensor.switch_led(False)
        self.baseline.before()
        self._reading[d.TAKEN] = self._reading[d.PENDING] = 0
        if not self._dark.begin(sensor.exposure_us):
            self.baseline.left = 0
        self._state = _BLINKING
        self._rare = True

    def _end_blink(self, sensor):
        self.baseline.update()
        self._ambient.measured()
        self._reading[d.LEVEL] = self._reading[d.ODD_US] = 0
        sensor.switch_led(True)
        sensor.check()
        self._state = _RISING
        # The next two samples are not used.
        if self._reading[d.IDLE_US] >= IDLE_US and not (
            0 <= self._diff(self._time.last, self._warmed) < _WARM_US
        ):
            self._warm()
        if self._on_dark and not self._reading[d.WANTED]:  # else a newer request needs a new frame
            if not self._reading[d.AGE_STEP_US]:
                frame = [sensor.gain, sensor.exposure_us] + self._dark.sums()
                self.settings.values["dark"] = frame
                self.lit_flags = d.DARK_SUBTRACTED
            done, self._on_dark = self._on_dark, None
            done()

    def _temperature(self):
        thermometer = self.sensor.thermometer
        return thermometer and thermometer()

    def _warm(self):
        # Shift the tables to the present temperature. It takes as long as a few samples.
        calibration = self.decode.calibration
        self._warmed = self._time.last
        thermal = calibration and calibration.thermal
        if thermal is not None or self.stream_spectrum:
            mC = self._temperature()
            if mC is None:
                mC = UNKNOWN_MC
            elif thermal is not None:
                thermal.follow(mC)
            self._taken_off[TEMPERATURE_MC] = mC

    def _search_on(self, sensor):
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
