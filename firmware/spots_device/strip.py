"""One strip: samples of its sensor in, frames out.

Holds the order of things: the LED-off window in which dark frames are taken, the averaging, the
search for an exposure. `take` allocates nothing but in the rare steps that end a window or a
search.
"""

from array import array

from .decode import (
    DARK_SAMPLES,
    DARK_SUBTRACTED,
    LED_OFF,
    MISFIT,
    NOT_CALIBRATED,
    SATURATED,
    TOUCHING,
    Decode,
)
from .exposure import AGAIN, DONE, Search
from .kernel import accumulate, follow
from .smux import CHANNELS

IDLE_US = 1_000_000  # untouched for so long before the strip may blink
# Light that is no press for so long, or light without a touch that is not what it was by so many
# counts in all, may be a lamp that was switched on: the dark is taken again, but not more often.
ODD_US = 300_000
ODD_COUNTS = 24
ODD_EVERY_US = 2_000_000
# A dark window takes six samples: rare enough that the strip is hardly ever blind.
DARK_EVERY_US = 10_000_000
DARK_EVERY_SAMPLES = 100
# Light of the untouched strip: followed so long after a touch, and in how many readings, as a
# power of 2. What grows may be a finger that comes slowly; what fades is none.
SETTLED_US = 200_000
_UP = 10
_DOWN = 6

_LIT = 0
_BLINKING = 1  # LED off, dark samples wanted
_RISING = 2  # LED on again, a wholly lit sample wanted


def _six():
    return array("i", bytes(4 * CHANNELS))


class Strip:
    """A sensor with its decoding and its frames.

    Parameters
    ----------
    index : int
        Sensor number in the frames.
    sensor : as7341.AS7341
    framer : frame.Framer
    time : frame.Time32
        Set to the middle of the integration before each frame.
    clock : object
        ``ticks_add``.
    settings : settings.Settings
        Read at every (re)start.
    uses : uses.Uses
        Gets every reading.
    """

    def __init__(self, index, sensor, framer, time, clock, settings, uses):
        self.index = index
        self.sensor = sensor
        self.settings = settings
        self.decode = Decode()
        self.dark = _six()
        self._rest = _six()
        self._floor = _six()
        self._followed = False
        self.stream_touch = self.stream_spectrum = False
        self._framer = framer
        self._uses = uses
        self._time = time
        self._add = clock.ticks_add
        self._sums = _six()
        self._blink_sums = _six()
        self._samples = 0
        self._flags = 0
        self._blink = _LIT
        self._blink_samples = 0
        self._dark_known = False
        self._dark_wanted = False
        self._idle_us = self._odd_us = 0
        self._quiet = -1
        self._dark_age_us = 0
        self._dark_every_us = DARK_EVERY_US
        self._missed = 0
        self._rest_wanted = False
        self._search = None
        self._on_dark = self._on_search = None

    def start(self):
        """Set the sensor up as the settings say and begin with a dark frame."""
        s = self.settings.values
        self._begin(s["gain"], s["led_mA"], s["exposure_us"])

    def _begin(self, gain, led_mA, exposure_us):
        self.sensor.start(self.settings.values["plan"], gain, exposure_us, led_mA)
        self._missed = 0
        self._framer.gap()
        self._dark_known = False
        self._dark_wanted = True
        self._dark_every_us = max(DARK_EVERY_US, DARK_EVERY_SAMPLES * self.sensor.exposure_us)
        self._forget_rest()
        self._blink = _LIT
        self._restart_average()

    def request_dark(self, done):
        """Take a dark frame now; then call ``done()``."""
        self._dark_wanted = True
        self._on_dark = done

    def request_search(self, done):
        """Search gain, LED current and exposure; then call ``done(outcome, Search)``."""
        s = self.settings.values
        self._search = Search(s["gain"], s["led_mA"], s["exposure_us"], self.settings.led_max_mA)
        self._on_search = done
        self._dark_wanted = True

    def request_rest(self):
        """Take what lies on the strip now as its untouched state."""
        self._rest_wanted = True

    def forget_requests(self):
        """Drop what was requested and not done yet."""
        self._search = self._on_search = self._on_dark = None

    def rest(self):
        """Return the light of the untouched strip beyond the dark, as `dark` is counted."""
        return [level >> 10 for level in self._rest]

    def take(self):
        """Use the sample that the sensor has just read."""
        sensor = self.sensor
        if sensor.pacing.missed != self._missed:
            self._missed = sensor.pacing.missed
            self._framer.gap()
        if self._dark_age_us < self._dark_every_us:
            self._dark_age_us += sensor.exposure_us
        if self._blink != _LIT:
            self._take_blink(sensor)
        elif sensor.steady and self._dark_known:
            self._take_lit(sensor)
        if self._blink == _LIT and self._dark_due():
            self._start_blink(sensor)

    def _take_lit(self, sensor):
        accumulate(self._sums, sensor.counts, self._samples)
        if sensor.saturated:
            self._flags |= SATURATED
        self._samples += 1
        if self._search is not None:
            self._judge(sensor)
        elif self._samples >= self.settings.values["average"]:
            self._emit(self._flags)

    def _emit(self, flags):
        sensor = self.sensor
        samples = self._samples
        if not sensor.led_on:
            flags |= LED_OFF
        elif self._dark_known:
            flags |= DARK_SUBTRACTED
        decode = self.decode
        decode.update(self._sums, samples, self._floor, flags)
        self._judge_quiet(decode.flags, samples * sensor.exposure_us)
        self._time.set(self._add(sensor.complete, -(samples * sensor.exposure_us >> 1)))
        if self.stream_touch:
            self._framer.touch(self.index, decode)
        rests = self._uses.take(self.index, decode)
        if self.settings.values["baseline"]:
            if not flags & LED_OFF:
                self._follow(samples, rests)
        elif self._followed:
            self._forget_rest()
        if self.stream_spectrum:
            if samples > 1:
                sums = self._sums
                for i in range(CHANNELS):
                    sums[i] = (sums[i] + (samples >> 1)) // samples
            self._framer.spectrum(self.index, decode.flags, sensor.gain, self._sums)
        self._restart_average()

    def _judge_quiet(self, flags, lasted_us):
        if flags & TOUCHING:
            self._idle_us = 0
        elif self._idle_us < IDLE_US:
            self._idle_us += lasted_us
        if not self._is_odd(flags):
            self._odd_us = 0
        elif self._odd_us < ODD_US:
            self._odd_us += lasted_us
        elif self._dark_age_us >= ODD_EVERY_US:
            self._dark_wanted = True

    def _is_odd(self, flags):
        if flags & NOT_CALIBRATED:
            return False  # nobody knows what a press looks like
        if flags & (TOUCHING | LED_OFF):
            return flags & MISFIT
        light = 0
        for i in range(CHANNELS):
            light += self._sums[i]
        light //= self._samples
        if self._quiet < 0:
            self._quiet = light
        return abs(light - self._quiet) > ODD_COUNTS

    def _follow(self, samples, rests):
        if rests or self._rest_wanted:
            self._rest_wanted = False
            up = down = 0
        elif self._idle_us >= SETTLED_US:
            up = _UP
            down = _DOWN
        else:
            return
        self._followed = True
        follow(self._rest, self._floor, self._sums, samples, self.dark, DARK_SAMPLES, up, down)

    def _forget_rest(self):
        self._followed = False
        for i in range(CHANNELS):
            self._rest[i] = 0
            self._floor[i] = self.dark[i]

    def _restart_average(self):
        self._samples = 0
        self._flags = 0

    def _dark_due(self):
        if self._dark_wanted:
            return True
        if self._samples:
            return False  # never in the middle of an average, however long it is
        return self._dark_age_us >= self._dark_every_us and self._idle_us >= IDLE_US

    def _start_blink(self, sensor):
        sensor.switch_led(False)
        self._restart_average()
        self._blink_samples = 0
        self._blink = _BLINKING

    def _take_blink(self, sensor):
        if self._blink == _RISING:
            if sensor.steady:
                self._blink = _LIT
                self._take_lit(sensor)
                return
        elif sensor.steady:
            accumulate(self._blink_sums, sensor.counts, self._blink_samples)
            self._blink_samples += 1
        accumulate(self._sums, sensor.counts, 0)
        self._samples = 1
        self._emit(LED_OFF)
        if self._blink_samples == DARK_SAMPLES and self._blink == _BLINKING:
            self._end_blink(sensor)

    def _end_blink(self, sensor):
        for i in range(CHANNELS):
            self.dark[i] = self._blink_sums[i]
            self._floor[i] = self.dark[i] + (self._rest[i] >> 10)
        sensor.switch_led(True)
        sensor.check()
        self._blink = _RISING
        self._dark_known = True
        self._dark_wanted = False
        self._dark_age_us = self._odd_us = 0
        self._quiet = -1
        done, self._on_dark = self._on_dark, None
        if done:
            done()

    def _judge(self, sensor):
        search = self._search
        peak = 0
        for i in range(CHANNELS):
            peak = max(peak, sensor.counts[i] - self.dark[i] // DARK_SAMPLES)
        outcome = search.step(peak, sensor.full_scale, sensor.saturated)
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
        self._on_search(outcome, search)
