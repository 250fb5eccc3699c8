"""The simulated strip and finger of a practice session, see `spots.calibrate.session.practice`."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from spots.calibrate.calibration_file import FINGER, CalibrationFile
from spots.calibrate.fit.decoded import Decoded
from spots.calibrate.fit.points import Wanted
from spots.calibrate.pressers import used
from spots.calibrate.session.bench import Bench
from spots.calibrate.session.dialog import Dialog
from spots.calibrate.session.practice import Practice, Score
from spots.calibrate.session.presser import Presser
from spots.calibrate.session.session_file import Session
from spots.errors import SettingError
from spots_device.reading.calibration import Calibration

from ..strip.defaults import given
from ..strip.files import SensorFile, load
from .person import Habits, Person, follow
from .stage import Stage

# The person at the terminal makes the errors of reading; the finger only misses the places.
_HABITS = Habits(place_mm=0.0, force_share=0.0, slips=0.1)
_PATIENCE_S = 25.0  # of simulated time; longer than the finger's delays
_PLACES, _FORCES_MN = np.linspace(0.05, 0.95, 19), (1000.0, 3000.0, 8000.0)
_SAMPLES = 40  # for each press of the score, so that noise does not count


class _Shown:
    """A dialog whose requests move a finger, and whose questions show ruler and scale."""

    def __init__(self, guide: Dialog, person: Person):
        self._guide, self._person = guide, person

    def request(self, phase: str, text: str) -> None:
        self._guide.request(phase, text)
        self._person.hear(text)

    def say(self, text: str) -> None:
        self._guide.say(text)

    def ask(self, question: str) -> str:
        place_mm, force_mN = self._person.shown(question)
        return self._guide.ask(question, place_mm and 1000 * place_mm, force_mN)


class _PracticePresser(Presser):
    """A simulated finger; records what ruler and scale showed for each press that was read off."""

    patience_s = _PATIENCE_S

    def __init__(self, guide: Dialog, person: Person):
        super().__init__(_Shown(guide, person))  # type: ignore[arg-type]
        self._person = person
        self._errors: dict[tuple[float, float], tuple[float, float]] = {}

    def read_off(self, wanted: Wanted, length_um: float) -> Wanted | None:
        read = super().read_off(wanted, length_um)
        if read is not None:
            place_mm, force_mN = self._person.shown("what do ruler and scale show")
            off_mN = read.force_mN - force_mN if read.force_mN else np.nan
            self._errors[read.place_um, read.force_mN] = read.place_um - 1000 * place_mm, off_mN
        return read

    def errors(self, session: Session) -> np.ndarray:
        """Return the errors of reading of the presses in a session, without those undone."""
        stored = {(one.place_um, one.force_mN) for one in session.points}
        return np.array([error for read, error in self._errors.items() if read in stored])


@contextmanager
def practice(options, path: Path, guide: Dialog) -> Iterator[Practice]:
    """Yield a simulated strip with a simulated finger, which a person's session moves.

    The options are ``sensor``, ``seed`` and ``length_mm``, see
    `spots.calibrate.session.practice.practise`. SpotsError if the sensor file is invalid, or has
    another length than the options.
    """
    options = given(options)
    sensor = load(SensorFile, options.sensor)
    if options.length_mm not in (None, sensor.length_mm):
        raise SettingError(
            f"the simulated strip is {sensor.length_mm:g} mm long, not {options.length_mm:g} mm: "
            "give this length, or name another strip with --sensor"
        )
    with Stage(sensor, options.seed) as stage:
        person = Person(partial(follow, stage.held), sensor.length_mm, _HABITS, options.seed)
        presser = _PracticePresser(guide, person)
        bench = Bench(stage.reader, presser, guide, stage.length_um, path)
        yield Practice(bench, partial(_score, stage, presser))


def _score(
    stage: Stage, presser: _PracticePresser, session: Session, made: CalibrationFile
) -> Score:
    decode = Decoded()
    # Without the compensation of the silicone, which needs the time of each reading.
    lines = [line for line in made.lines if not line.startswith("silicone")]
    decode.calibration = Calibration(lines)
    vars(stage.held).pop("presses", None)  # the path of the person's finger ends
    stage.reader.set_up()
    stage.by_hand = used(made) == FINGER
    pressed = stage.read(_PLACES * stage.length_um, _FORCES_MN, _SAMPLES)
    rows = []
    for counts in pressed.counts:
        decode.update_mean(counts)
        rows.append((decode.position_um, decode.force_mN))
    at_um, force_mN = np.array(rows, float).T
    off_um = at_um - pressed.position_um
    read_um, read_mN = presser.errors(session).T
    is_relative = "relative" in made.lines
    return Score(
        _rms(off_um),
        float(np.abs(off_um).max()),
        None if is_relative else _rms(force_mN - pressed.force_mN),
        _rms(read_um),
        None if is_relative else _rms(read_mN[np.isfinite(read_mN)]),
    )


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
