"""The steps of a calibration session: take the missing presses, fit them, store the calibration."""

from __future__ import annotations

import argparse
from dataclasses import dataclass, replace
from functools import partial

import msgspec
import numpy as np

from spots_device.board.settings import checksum
from spots_device.sensor.exposure import full_scale, registers

from ...errors import CalibrationError, SettingError
from ...link import lamps
from ...link.connect import ensured
from .. import calibration_file as file
from ..fit.choose import choose, passes
from ..fit.fit import PLACES_MIN
from ..fit.points import Wanted, presses
from ..fit.presses import FIRM_MN, FORCE_PLACES, FULL_MN, MARKS, Noise
from . import baseline, carry
from .bench import BadPressError, Bench, judge_force, judge_place
from .dialog import UndoError
from .hand import by_hand
from .joint import ANGLES_MIN, fit_joint, joint_marks
from .make import make
from .session_file import Session, point
from .spectra import Reading

LENGTH_UM = 85_000.0  # usual length of a strip
_RULER_UM = 100  # resolution of a ruler
# For each kind: default and least number of presses, positions, forces, or angles per direction.
COUNTS = {
    "fine": (39, PLACES_MIN),
    "rough": (12, 8),
    "position": (17, PLACES_MIN),
    "strain": (17, PLACES_MIN),
    "force": (16, 14),
    "joint": (11, ANGLES_MIN),
}
_JUDGES = {"position": judge_place, "strain": judge_place, "force": judge_force}
# Number of positions at which the channels are compared, by kind; other kinds compare none.
_CHOOSE_PLACES = {"position": 9, "force": 9, "fine": 4}
# The light begins a little below the least force that gives light in all channels, and grows
# steeply there. So the forces of a series, minus this share of the least force, are spaced
# geometrically.
_DARK_SHARE = 0.85
_LEAST_MARGIN = 1.05  # the measured least force is increased by this factor
_SENSOR_END_UM = 2_000.0  # position of the brightest press, which sets the exposure
_NOISE_POINTS = 6  # least number of presses that show the noise of the sensor
DARK_S = 2.5  # exposure of dark frames before marks: less gives more noise, more cools the LED


def calibrate(
    bench: Bench,
    session: Session,
    kind: str,
    count: int,
    strain_percent: float | None,
    options: argparse.Namespace,
) -> None:
    """Take the missing presses of one kind; store a calibration if the session is then complete.

    `kind` is ``fine`` (with a scale) or ``rough`` (without) for presses by hand; or ``position``,
    ``strain``, ``force`` or ``joint``. `count` is the number of presses by hand, of positions, of
    forces, or of angles in each direction; 0 for the default. The options are ``channels``,
    names or None, and ``keep_settings``, whether to keep gain and LED current. SpotsError if the
    session has another board or other settings, or its presses give no calibration.
    """
    undone = False
    with session.locked():
        while True:
            try:
                if undone:
                    bench.release()
                    undone = False
                return _run(bench, session, kind, count or COUNTS[kind][0], strain_percent, options)
            except UndoError:
                dropped, undone = session.undo(), True
                bench.spent += dropped is not None
                bench.guide.say(f"undone: {dropped}" if dropped else "there is no press to undo")


def _run(bench: Bench, session: Session, kind: str, count: int, strain_percent, options) -> None:
    session.check(bench.reader.conditions, bench.length_um if kind != "joint" else None)
    before = file.KIND.present(bench.path)
    carry.check(before, bench.reader.conditions.board, bench.path)
    if before and (kind == "joint" or carry.continues(session, before)):
        session.refer(carry.undrifted(before.rezeros))
    steps = _Steps(bench, session)
    if kind == "joint":
        return steps.joint(count)
    if kind != "strain":
        steps.settle(options, kind)
    elif missing := missing_step(session):
        raise CalibrationError(f"calibrate position and force before strain: first run {missing}")
    if kind == "position":
        steps.places("position", count, 0)
    elif kind == "force":
        steps.forces(count)
    elif kind == "strain":
        steps.places("strain", count, round(10_000 * strain_percent))
        bench.presser.stretch(0, bench.length_um)
    else:
        steps.untouched(DARK_S)
        by_hand(bench, session, count, COUNTS[kind][1], kind == "rough")
        return steps.finish()
    if missing := missing_step(session):
        return bench.guide.say(f"next: {missing}")
    if not session.of("hand"):
        steps.marks()
    steps.finish()


def missing_step(session: Session) -> str | None:
    """Return the command that takes the next missing presses; None if no press is missing."""
    if len(session.of("hand")) >= COUNTS["rough"][1]:
        return None
    for kind, name in (("position", "place_um"), ("force", "force_mN")):
        taken = {getattr(p, name) for p in session.of(kind)}
        end_um = (session.length_um or 0) - _RULER_UM if kind == "position" else 0
        if len(taken) < COUNTS[kind][1] or max(taken) < end_um:
            return f"'spots calibrate {kind} --session {session.path}'"
    return None


@dataclass(frozen=True)
class _Steps:
    """Steps of a calibration session, in the order in which they run."""

    bench: Bench
    session: Session

    def untouched(self, dark_s: float = 0.0) -> None:
        """Measure the dark frame and the light of the untouched strip.

        `dark_s` is that of `SpectrumReader.set_up`.
        """
        reader, guide = self.bench.reader, self.bench.guide
        guide.say("taking dark frames: touch nothing")
        self.bench.part()
        reader.set_up(dark_s=dark_s, untouched=True)
        if reader.baseline.any():
            guide.say(
                f"light without a press, up to {reader.baseline.max():.1f} counts: dust, or the "
                "guides touch; it is subtracted"
            )

    def settle(self, options: argparse.Namespace, kind: str) -> None:
        """Choose gain, LED current and channels, unless earlier presses of the session fix them.

        `kind` and `options` are those of `calibrate`.
        """
        session, reader = self.session, self.bench.reader
        wanted_plan = tuple(options.channels.split(",")) if options.channels else None
        if not session.plan_is_open:
            if wanted_plan not in (None, session.conditions.plan):
                raise SettingError(
                    f"the session {session.path} was made with channels "
                    f"{','.join(session.conditions.plan)}: omit --channels, or name another file "
                    "with --session"
                )
            return
        if wanted_plan:
            reader.set_up("channels=" + options.channels)
        if not session.points and not options.keep_settings:
            self._mains()
            self._autoexpose(0.0 if kind == "rough" else FULL_MN)
        # With an LED that is always on, each plan would need its own dark frame.
        places = _CHOOSE_PLACES.get(kind)
        if places and not wanted_plan and reader.info["led"] != "always":
            self._choose(places)

    def _mains(self) -> None:
        reader, guide = self.bench.reader, self.bench.guide
        if reader.info["mains_hz"] != 0:  # set by hand
            return
        guide.say("measuring the flicker of lamps: touch nothing")
        if mains_hz := lamps.mains_hz(reader.board):
            reader.set_up(f"mains_hz={mains_hz}")
            ensured(reader.board, "save")  # a later run then sets the same exposure
            guide.say(f"lamps flicker at {2 * mains_hz} Hz: mains_hz={mains_hz}")

    def _autoexpose(self, force_mN: float) -> None:
        bench = self.bench
        self.untouched()
        self._begin("exposure", 1)
        bench.take(Wanted(kind="choose", place_um=_SENSOR_END_UM, force_mN=force_mN))
        found = bench.reader.board.command("autoexpose", timeout_s=60)
        kind = found["led"]
        if kind == "always":
            bench.presser.release()
            bench.presser.dark(bench.reader.board)
        bench.reader.set_up()
        if force_mN or kind == "always":
            bench.release()
        else:
            self._exposed()
        led = f"{found['led_mA']} mA" if kind == "ldr" else kind
        bench.guide.say(f"gain {found['gain']}, LED {led}, exposure {found['exposure_us']} us")

    def _exposed(self) -> None:
        """Read the same press once more, at the settings that `_auto` found.

        The light of the untouched strip is measured after the release, and then subtracted. The
        person then types the true position, and the press is stored as a press by hand.
        """
        bench = self.bench
        try:
            reading = bench.again("hand")
        except BadPressError:  # `by_hand` requests a press at this position
            bench.release()
            return
        bench.release()
        self.untouched()
        light = bench.reader.baseline
        reading = replace(reading, counts=reading.counts - light, baseline=light)
        wanted = Wanted(kind="hand", place_um=_SENSOR_END_UM, force_mN=0.0)
        if read := bench.presser.read_off(wanted, bench.length_um):
            self._add(read, reading, length_um=bench.length_um)
            bench.spent -= 1

    def _choose(self, places: int) -> None:
        reader = self.bench.reader
        known = self.session.of("choose")
        plans = passes(known[0].plan if known else reader.conditions.plan)
        row = [Wanted(kind="choose", place_um=_SENSOR_END_UM, force_mN=FULL_MN)]
        for place_um in _along(self.bench.length_um, places):
            row.append(Wanted(kind="choose", place_um=place_um, force_mN=FIRM_MN))
        for plan in plans:  # else light without a press would look like a press
            self._set_plan(plan)
            self.untouched()
        self._begin("choice of channels", len(row))
        for wanted in row:
            missing = [plan for plan in plans if not self.session.has(wanted, plan)]
            if not missing:
                self.bench.guide.skip()
                continue
            self._set_plan(missing[0])
            reading = self.bench.take(wanted, self._noise())
            for plan in missing:
                if plan != reader.conditions.plan:
                    # The LED is off in a dark frame, so the strip may be pressed.
                    self._set_plan(plan)
                    reading = reader.read(self.bench.window)
                self.session.add(
                    point(wanted, reading, reader.conditions, length_um=self.bench.length_um)
                )
            baseline.check(self.session)
            self.bench.guide.taken(wanted, reading)
            self.bench.release()
        measured = tuple(
            presses([p for p in self.session.of("choose") if p.plan == plan]) for plan in plans
        )
        choice = choose(plans, measured, full_scale(*registers(reader.conditions.exposure_us)))
        self._set_plan(choice.plan)
        self.bench.guide.say(
            f"noise of one sample: {choice.sigma_um:.0f} um with channels {' '.join(choice.plan)}, "
            f"{choice.present_sigma_um:.0f} um with {' '.join(plans[0])}"
        )

    def _set_plan(self, plan: tuple[str, ...]) -> None:
        if plan != self.bench.reader.conditions.plan:
            self.bench.reader.set_up("channels=" + ",".join(plan))

    def places(self, kind: str, count: int, strain_ppm: int) -> None:
        """Take `count` presses along the strip, which has the strain `strain_ppm`.

        `kind` is the kind of the presses, see `session.Wanted`.
        """
        length_um = self.bench.length_um * (1 + strain_ppm * 1e-6)
        self.bench.presser.stretch(strain_ppm, length_um)
        self.untouched()
        title = f"positions at {strain_ppm / 10_000:g} % strain" if strain_ppm else "positions"
        row = [
            Wanted(kind=kind, place_um=place_um, force_mN=FIRM_MN, strain_ppm=strain_ppm)
            for place_um in _along(length_um, count)
        ]
        self._series(title, row, length_um)

    def forces(self, count: int) -> None:
        """Take presses with `count` different forces at each of a few positions."""
        guide, length_um = self.bench.guide, self.bench.length_um
        self.untouched()
        places_um = [round(share * length_um, -2) for share in sorted(FORCE_PLACES, reverse=True)]
        # The first press of a session has the least force, at the dimmest place.
        least_mN = min((p.force_mN for p in self.session.of("force")), default=None)
        if least_mN is None:
            dimmest = Wanted(kind="force", place_um=places_um[0], force_mN=FULL_MN)
            self._begin("least force", 1)
            guide.want(dimmest)
            found_mN = self.bench.presser.least_mN(dimmest, self.bench.reader)
            least_mN = round(_LEAST_MARGIN * found_mN, 1)
        dark_mN = _DARK_SHARE * least_mN
        steps_mN = np.geomspace(least_mN - dark_mN, FULL_MN - dark_mN, count)
        row = [
            Wanted(kind="force", place_um=place_um, force_mN=force_mN)
            for place_um in places_um
            for force_mN in (dark_mN + steps_mN).round(1).tolist()
        ]
        self._series("forces", row)

    def marks(self) -> None:
        """Take presses at the marks, which a later re-zero repeats."""
        bench = self.bench
        self.untouched(DARK_S)
        places_um = [round(share * bench.length_um, -2) for share in MARKS]
        row = [Wanted(kind="mark", place_um=x, force_mN=FIRM_MN) for x in places_um]
        self._series("marks for a re-zero", row)

    def finish(self) -> None:
        """Fit all presses of the session, write the calibration file, and upload its lines."""
        bench = self.bench
        before = file.KIND.present(bench.path)
        calibration = make(self.session, bench.guide.say)
        calibration = carry.carried(calibration, before, self.session, bench.guide.say)
        file.save(calibration, bench.path, before)
        for residual in calibration.residuals:
            force = residual.force_rms_mN
            bench.guide.say(
                f"errors at {residual.strain_ppm / 10_000:g} % strain: position "
                f"{residual.position_rms_um:.0f} um rms"
                + ("" if force is None else f", force {force:.0f} mN rms")
            )
        bench.reader.restore()  # the board saves its settings with the calibration
        name = file.send(bench.reader.board, calibration)
        bench.guide.say(f"{bench.path}: the board uses calibration {name}, and has stored it")

    def joint(self, count: int) -> None:
        """Calibrate a joint with readings at `count` angles upwards, then at `count` downwards."""
        bench, guide, session = self.bench, self.bench.guide, self.session
        calibration = before = file.load(bench.path)
        board = bench.reader.board
        if session.conditions not in (None, calibration.conditions):
            raise SettingError(
                f"{bench.path} and the session {session.path} have different boards or settings: "
                "name the session of this calibration with --session"
            )
        if board.command("hello")["calibration"] != checksum(list(calibration.lines)):
            bench.reader.restore()
            file.send(board, calibration)
        bench.reader.set_up(dark_s=DARK_S)
        bench.reader.use_baseline(calibration.lines)  # the indenter always presses the strip
        board.command("stream touch spectrum")
        self._begin("joint", 2 * count)
        upwards = np.linspace(0, 1, count).tolist()
        for direction, shares in ((1, upwards), (-1, upwards[::-1])):
            known = len([p for p in session.of("joint") if p.direction == direction])
            guide.skip(min(known, count))
            for share in shares[known:]:
                self._turn(bench.presser.turn(direction, share))
        turned = session.of("joint")
        joint = fit_joint(turned)
        marks = joint_marks(turned)
        calibration = msgspec.structs.replace(before, joint=joint, joint_marks=marks)
        file.save(calibration, bench.path, before)
        guide.say(
            f"joint: R2 {joint.r2:.5f}, resolution {joint.resolution_deg:.3f} deg, accuracy "
            f"{joint.accuracy_deg:.3f} deg, backlash {joint.backlash_deg:.3f} deg, in {bench.path}"
        )

    def _turn(self, wanted: Wanted) -> None:
        # Two points with the same angle and direction cannot be fitted.
        taken = [(p.angle_deg, p.direction) for p in self.session.of("joint")]
        if (wanted.angle_deg, wanted.direction) in taken:
            self.bench.guide.skip()
            self.bench.guide.say(f"{wanted} was measured already: turn the joint further")
            return
        reading = self.bench.take(wanted, self._noise())
        position = self.bench.reader.positions_um(self.bench.window, self.bench.presser.patience_s)
        self._add(
            wanted,
            reading,
            position_um=round(float(position.mean()), 2),
            position_sigma_um=round(float(position.std(ddof=1)), 2),
        )

    def _begin(self, title: str, count: int, length_um: float | None = None) -> None:
        plan = self.bench.reader.conditions.plan
        self.bench.guide.begin(title, count, plan, length_um or self.bench.length_um)

    def _series(self, title: str, row: list[Wanted], length_um: float | None = None) -> None:
        """Take those presses of the list `row` that the session lacks; show `title` above them.

        `length_um` is the length of the strip, if it is stretched.
        """
        self._begin(title, len(row), length_um)
        for wanted in row:
            if self.session.has(wanted, self.bench.reader.conditions.plan):
                self.bench.guide.skip()
                continue
            noise = self._noise()
            reading = self.bench.take(wanted, noise, partial(self._judge, wanted, noise))
            self._add(wanted, reading, length_um=self.bench.length_um)
            self.bench.release()

    def _add(self, wanted: Wanted, reading: Reading, **measured) -> None:
        self.session.add(point(wanted, reading, self.bench.reader.conditions, **measured))
        baseline.check(self.session)
        self.bench.guide.taken(wanted, reading)

    def _judge(self, wanted: Wanted, noise: Noise | None, reading: Reading) -> None:
        known = self.session.of(wanted.kind, wanted.strain_ppm)
        if wanted.kind == "force":
            known = [p for p in known if p.place_um == wanted.place_um]
        if wanted.kind in _JUDGES and len(known) > 1:
            others = presses(known)
            noise = noise or Noise.of(others)
            taken = self.session.referred(wanted, reading, self.bench.reader.conditions)
            _JUDGES[wanted.kind](others, wanted, np.array(taken.counts), noise, self.bench.window)

    def _noise(self) -> Noise | None:
        """Return the noise of the sensor, or None if there are too few presses to estimate it."""
        known = [p for p in self.session.points if p.kind != "choose"]
        if len(known) < _NOISE_POINTS:
            return None
        read = presses(known)
        found = Noise.of(read)
        # Few presses with one force do not separate the two parts of the noise. A constant part
        # that is too small would reject weak presses.
        return Noise(max(found.constant, float(np.median(read.variance))), found.per_count)


def _along(length_um: float, count: int) -> list[float]:
    """Return `count` positions in um from end to end of a strip, rounded to 0.1 mm for a ruler."""
    return np.round(np.linspace(0, length_um, count), -2).tolist()
