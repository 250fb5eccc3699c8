"""A simulated stage that presses a simulated strip, read through the real firmware."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from spots.calibrate.calibration_file import FINGER
from spots.calibrate.fit.fit import fit
from spots.calibrate.fit.presses import FIRM_MN, FORCE_PLACES, FULL_MN, MARKS, Noise, Presses
from spots.calibrate.fit.shift import shifted
from spots.calibrate.pressers import marked
from spots.calibrate.session import baseline
from spots.calibrate.session.spectra import SpectrumReader
from spots.errors import CalibrationError
from spots.link.board import Board

from ..board.lockstep import LockstepLink
from ..strip.files import SensorFile
from ..strip.scenario import Held, Press
from .kept import kept
from .loading import set_light, silicone_lines

PLACES = 33  # default number of positions in `Stage.along`
FORCES = 30  # number of forces in `Stage.pressed`
NEAR_UM = 2000.0  # brightest position at which the whole finger is on the strip
_WIDTH_MM = 4.0
_MARK_SAMPLES = 40  # of a press on a mark
_UNTOUCHED = 16  # samples of the light that dust couples without a press
WARM_S = 120.0  # the LED is warm before the first press
_OSCILLATOR_S = 30.0  # time in which a board measures its sensor's oscillator to 10 ppm
_SEARCH_TIMEOUT_S = 600.0
# A stage waits this many time constants for contact that remains, but at most these seconds.
_PARTED, _PARTED_S = 5.0, 8.0


class Stage:
    """A simulated strip on a stage that presses it with an indenter, read through the firmware.

    The table ``[change]`` of the sensor file (ageing and drift) is ignored; set the attribute
    `held.changed` instead. `settings` are assignments for the command ``set``; under flickering
    lamps `mains_hz` is set first. The LED has been on for `warm_s` when the board boots. With
    `by_hand`, a finger presses the strip instead of the stage, from the next press on.
    """

    def __init__(
        self,
        sensor: SensorFile,
        seed: int = 0,
        settings: str = "",
        warm_s: float = WARM_S,
        number: int = 0,
    ):
        self.sensor = sensor
        self.held = Held()
        self.by_hand = False
        link = LockstepLink(sensor.unchanged(), self.held, seed, started_s=warm_s, number=number)
        self.board = Board(link)
        if sensor.led.wired != "ldr":
            self.board.command("set led=" + sensor.led.wired)
        if sensor.mains_hz:
            self.board.command(f"set mains_hz={sensor.mains_hz}")
            for _ in self.board.frames(_OSCILLATOR_S):
                pass
        if settings:
            self.board.command("set " + settings)
        self.take_dark()
        self.reader = SpectrumReader(self.board)

    def __enter__(self) -> Stage:
        return self

    def __exit__(self, *exception) -> None:
        self.board.close()

    @property
    def length_um(self) -> float:
        """Present length of the strip in um, including its strain."""
        return 1000 * self.sensor.length_mm * (1 + self.held.strain)

    def expose(self, exposure_us: int | None = None) -> None:
        """Press firmly near the sensor, and let the board search for gain and LED current.

        `exposure_us` is set after the search, because the search may lengthen the exposure.
        BoardError if no setting fits this strip.
        """
        self.press(NEAR_UM, FULL_MN)
        self.board.command("autoexpose", timeout_s=_SEARCH_TIMEOUT_S)
        self.release()
        if exposure_us is not None:
            self.board.command(f"set exposure_us={exposure_us}")
        self._separate()
        self.take_dark()
        self.reader.set_up(untouched=True)

    def take_dark(self) -> None:
        """Take a dark frame (counts without the LED's light) if the board cannot switch the LED.

        An LED that is always on is unplugged for this time.
        """
        if self.sensor.led.wired == "always":
            self.held.unplugged = True
            self.board.command("dark off", timeout_s=_SEARCH_TIMEOUT_S)
            self.held.unplugged = False

    def press(self, position_um: float, force_mN: float, by_hand: bool = False) -> None:
        """Press the strip until the next call of `press` or `release`; perhaps with a finger."""
        by_hand = by_hand or self.by_hand
        self.held.press = Press(position_um / 1000, force_mN, _WIDTH_MM, hand=by_hand, skin=by_hand)

    def turn(self, angle_deg: float, direction: int = 1) -> None:
        """Turn the joint, which bends the strip and slides an indenter along it.

        `direction` is 1 if the angle is reached from below, -1 if from above.
        """
        self.held.bend_deg = angle_deg
        self.press(self.sensor.indenter_um(angle_deg, direction), self.sensor.joint.force_mN)

    def release(self) -> None:
        """Lift the indenter."""
        self.held.press = None

    def read(self, places_um: Sequence[float], forces_mN: Sequence[float], samples: int) -> Presses:
        """Press at each position with each force; each reading is a mean over `samples`.

        The rows are first all positions with the first force, then all positions with the second
        force, and so on.
        """
        rows = []
        for force_mN in forces_mN:
            for place_um in places_um:
                self.press(place_um, force_mN)
                r = self.reader.read(samples)
                rows.append((place_um, force_mN, r.counts, r.variance, r.saturated))
                self._separate()
        self.release()
        return Presses(*(np.array(column) for column in zip(*rows)))

    def _separate(self) -> None:
        # Lift, and wait until the guides have parted, so that no press is read with the last one.
        contact = self.sensor.contact
        if contact.sticking_percent:
            self.release()
            for _ in self.board.frames(min(_PARTED * contact.sticking_s, _PARTED_S)):
                pass

    def along(self, places: int = PLACES, samples: int = 24) -> Presses:
        """Press with the force `FIRM_MN` at evenly spaced positions from end to end."""
        return self.read(np.linspace(0, self.length_um, places), [FIRM_MN], samples)

    def pressed(self, samples: int = 8) -> Presses:
        """Press at a few positions with forces from the smallest detectable one to `FULL_MN`."""
        places_um = [share * self.length_um for share in FORCE_PLACES]
        forces_mN = np.geomspace(self._least_mN(max(places_um)), FULL_MN, FORCES)
        return self.read(places_um, forces_mN, samples)

    def _least_mN(self, place_um: float) -> float:
        # Bisection for the smallest force with light in every channel, beside that of dust.
        low_mN, high_mN = 1.0, FULL_MN
        self.release()
        untouched = self.reader.read(_UNTOUCHED).counts if self.sensor.contact.dust else 0.0
        while high_mN > 1.02 * low_mN:
            middle_mN = (low_mN * high_mN) ** 0.5
            self.press(place_um, middle_mN)
            if (self.reader.read(4).counts - untouched < 1).any():
                low_mN = middle_mN
            else:
                high_mN = middle_mN
        return high_mN


def calibrate(sensor: SensorFile, exposure_us: int | None = None) -> tuple[str, ...]:
    """Calibrate a simulated sensor, and return the text lines of the calibration.

    Without `exposure_us`, the board searches for an exposure. SpotsError if the sensor's readings
    do not allow a calibration.
    """
    return _calibrated(sensor, exposure_us)[0]


def strip_lines(lines: Sequence[str], number: int) -> list[str]:
    """Return the calibration lines of strip 0, changed so that they are valid for another strip."""
    end = f"-{number}" if number else ""
    return [line + end if line.startswith("board ") else line for line in lines]


def check_light(along: Presses, pressed: Presses) -> None:
    """CalibrationError with the position if a press is too dark along the strip, or saturated."""
    too_dark = "too dark: choose a longer exposure or a brighter strip"
    for presses, bad, trouble in (
        (along, (along.counts < 1).any(axis=1), too_dark),
        (along, along.saturated, "saturated: choose a shorter exposure"),
        (pressed, pressed.saturated, "saturated: choose a shorter exposure"),
    ):
        if bad.any():
            where_mm = presses.position_um[bad][0] / 1000
            raise CalibrationError(f"the press at {where_mm:g} mm is {trouble}")


def board_lines(lines: Sequence[str], board_id: str) -> list[str]:
    """Return calibration lines, changed so that they are valid for another board."""
    return [f"board {board_id}" if line.startswith("board ") else line for line in lines]


def set_as_calibrated(board: Board, sensor: SensorFile, number: int = 0) -> None:
    """Send a board the settings that `calibrate` used: mains frequency, LED and dark frame."""
    set_light(board, sensor, led_settings(sensor), number)


def led_settings(sensor: SensorFile) -> str:
    """Return the LED settings that `calibrate` used, as assignments for ``set``.

    They are empty if the LED is on the pin LDR of the AS7341.
    """
    return "" if sensor.led.wired == "ldr" else _calibrated(sensor, None)[1]


def _for_finger(stage: Stage, lines: tuple[str, ...]) -> tuple[str, ...]:
    """Return a calibration after three marks by a finger, as a session with an indenter ends."""
    places_um = [share * stage.length_um for share in MARKS]
    logs = []
    for stage.by_hand in (False, True):
        logs.append(stage.read(places_um, [FIRM_MN], _MARK_SAMPLES).logs)
    stage.by_hand = False
    shifts = logs[1] - logs[0]
    shifts -= shifts.mean(axis=1, keepdims=True)
    return tuple(marked(shifted(lines, places_um, shifts), FINGER))


@kept(tuple[tuple[str, ...], str])
def _calibrated(sensor: SensorFile, exposure_us: int | None) -> tuple[tuple[str, ...], str]:
    """Calibrate a sensor at an exposure; return calibration lines and LED settings.

    If `exposure_us` is None, the board searches for the exposure. The LED settings are
    assignments such as ``led=gpio`` for the board's command ``set``.
    """
    with Stage(sensor) as stage:
        stage.expose(exposure_us)
        along, pressed = stage.along(), stage.pressed()
        noise = Noise.of(along, pressed)
        check_light(along, pressed)
        lines = tuple(fit({0: along}, pressed, noise, stage.reader.conditions))
        if sensor.contact.skin_percent:
            lines = _for_finger(stage, lines)
        lines += tuple(baseline.line(stage.reader.baseline))
        led = "led=" + sensor.led.wired
        if sensor.led.wired == "always":
            state = stage.board.command("get")
            numbers = state["gain"], state["exposure_us"], *state["dark"]
            led += " dark=" + ",".join(map(str, numbers))
    return (*lines, *silicone_lines(sensor, lines, "" if sensor.led.wired == "ldr" else led)), led
