"""The steps of a guided session: what is pressed, judged, taken; then fit, written and uploaded."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import msgspec
import numpy as np

from spots_device.exposure import full_scale, registers
from spots_device.settings import checksum

from ..errors import SpotsError
from ..link.frames import Touch
from . import calibration_file as file
from .choose import choose, passes
from .fit import PLACES_MIN
from .guide import Guide
from .joint import ANGLES_MIN, fit_joint, joint_marks
from .make import make
from .presser import Presser
from .presses import FIRM_MN, FORCE_PLACES, FULL_MN, MARKS, Noise
from .session import Point, Session, Wanted, point, presses
from .spectra import SpectrumReader
from .take import Taker, judge_force, judge_place

_END_UM = 100  # places are in steps of 0.1 mm
_FORCES_MIN = 14  # fewer make no table of such a curve
COUNTS = {"position": 17, "strain": 17, "force": 16, "joint": 11}
# What a fit needs.
LEAST_COUNTS = {
    "position": PLACES_MIN,
    "strain": PLACES_MIN,
    "force": _FORCES_MIN,
    "joint": ANGLES_MIN,
}
_CHOOSE_PLACES = 9
# Light begins a little below the least force that every channel sees, and steeply: even steps of
# the logarithm of what is above.
_DARK_SHARE = 0.85
_SENSOR_END_UM = 2_000.0
_NOISE_POINTS = 6
DARK_S = 2.5  # of marks, whose noise shifts whole tables; an LED that is off for longer cools


@dataclass(frozen=True)
class Setup:
    """A board, whoever presses it, and what is known so far."""

    reader: SpectrumReader
    presser: Presser
    guide: Guide
    session: Session
    length_um: float
    out: Path

    @cached_property
    def taker(self) -> Taker:
        """Takes presses of this board."""
        return Taker(self.reader, self.presser, self.guide)

    def plan(self) -> tuple[str, ...]:
        """Return the channels that are read."""
        return self.reader.conditions.plan


def calibrate(
    setup: Setup, kind: str, count: int, strain_percent: float | None, options: argparse.Namespace
) -> None:
    """Take the presses of a kind that the session lacks; then fit, write, upload and store.

    Parameters
    ----------
    setup : Setup
    kind : str
        One of `COUNTS`.
    count : int
        Places, forces, or angles in each direction.
    strain_percent : float or None
    options : argparse.Namespace
        ``plan`` and ``keep_settings``.

    Raises
    ------
    SpotsError
        If the session is of another board or setting, or its presses give no calibration.
    """
    session = setup.session
    session.check(setup.reader.conditions)
    if kind == "joint":
        _joint(setup, count)
        return
    if kind == "strain":
        missing = _missing(session)
        if missing:
            raise SpotsError(f"strain comes after position and force: first {missing}")
    else:
        _settle(setup, options)
    session.check(setup.reader.conditions)
    _learn_noise(setup)
    if kind == "position":
        _places(setup, "position", count, 0)
    elif kind == "force":
        _forces(setup, count)
    else:
        strain_ppm = round(10_000 * strain_percent)
        _places(setup, "strain", count, strain_ppm)
        setup.presser.stretch(0, setup.length_um)
    missing = _missing(session)
    if missing:
        setup.guide.say(f"next: {missing}")
    else:
        _marks(setup)
        _finish(setup)


def _settle(setup: Setup, options: argparse.Namespace) -> None:
    """Fix gain, LED current and channels before the first press that counts."""
    session = setup.session
    wanted_plan = tuple(options.plan.split(",")) if options.plan else None
    if not session.plan_is_open:
        if wanted_plan not in (None, session.conditions.plan):
            raise SpotsError(
                f"the session {session.path} was made with channels "
                f"{','.join(session.conditions.plan)}: name another file with --session"
            )
        return
    if wanted_plan:
        setup.reader.set_up("plan=" + options.plan)
    if not session.points and not options.keep_settings:
        _auto(setup)
    # Of an LED that is always on, each plan would need a dark frame of its own.
    if not wanted_plan and setup.reader.info["led"] != "always":
        _choose(setup)


def _auto(setup: Setup) -> None:
    wanted = Wanted(kind="choose", place_um=_SENSOR_END_UM, force_mN=FULL_MN)
    setup.guide.begin("exposure", 1, setup.plan(), setup.length_um)
    setup.guide.want(wanted)
    setup.taker.take(wanted, as_it_is=True)
    found = setup.reader.board.command("auto", timeout_s=60)
    if found["led"] == "always":
        setup.presser.release()
        setup.presser.dark(setup.reader.board)
    setup.reader.set_up()
    setup.taker.release()
    led = f"{found['led_mA']} mA" if found["led"] == "ldr" else found["led"]
    setup.guide.say(f"gain {found['gain']}, LED {led}, exposure {found['exposure_us']} us")


def _choose(setup: Setup) -> None:
    known = setup.session.of("choose")
    plans = passes(known[0].plan if known else setup.plan())
    places_um = _along(setup.length_um, _CHOOSE_PLACES)
    row = [Wanted(kind="choose", place_um=_SENSOR_END_UM, force_mN=FULL_MN)]
    row += [Wanted(kind="choose", place_um=x, force_mN=FIRM_MN) for x in places_um]
    for plan in plans:
        setup.reader.set_up("plan=" + ",".join(plan))
        setup.guide.begin("choice of channels", len(row), plan, setup.length_um)
        for wanted in row:
            _take(setup, wanted, as_it_is=True)
    measured = tuple(
        presses([p for p in setup.session.of("choose") if p.plan == plan]) for plan in plans
    )
    full = full_scale(*registers(setup.reader.conditions.exposure_us))
    choice = choose(plans, measured, full)
    setup.reader.set_up("plan=" + ",".join(choice.plan))
    setup.guide.say(
        f"channels {' '.join(choice.plan)}: {choice.sigma_um:.0f} um a sample, "
        f"{' '.join(plans[0])}: {choice.present_sigma_um:.0f} um"
    )


def _take(setup: Setup, wanted: Wanted, judge=lambda reading: None, as_it_is=False) -> None:
    if setup.session.has(wanted, setup.plan()):
        setup.guide.skip()
        return
    setup.guide.want(wanted)
    reading = setup.taker.take(wanted, judge, as_it_is)
    taken = point(wanted, reading, setup.reader.conditions, length_um=setup.length_um)
    setup.session.add(taken)
    setup.guide.taken(wanted, reading)
    setup.taker.release()
    if not as_it_is:
        _learn_noise(setup)


def _learn_noise(setup: Setup) -> None:
    known = [p for p in setup.session.points if p.kind != "choose"]
    if len(known) < _NOISE_POINTS:
        setup.taker.noise = None
        return
    read = presses(known)
    found = Noise.of(read)
    # Few presses of one force do not separate the two parts; a constant that is too small would
    # reject weak presses.
    constant = max(found.constant, float(np.median(read.variance)))
    setup.taker.noise = Noise(constant, found.per_count)


def _places(setup: Setup, kind: str, count: int, strain_ppm: int) -> None:
    length_um = setup.length_um * (1 + strain_ppm * 1e-6)
    setup.presser.stretch(strain_ppm, length_um)
    setup.reader.set_up()
    title = f"positions at {strain_ppm / 10_000:g} % strain" if strain_ppm else "positions"
    setup.guide.begin(title, count, setup.plan(), length_um)
    for place_um in _along(length_um, count):
        wanted = Wanted(kind=kind, place_um=place_um, force_mN=FIRM_MN, strain_ppm=strain_ppm)
        _take(setup, wanted, _judge(setup, judge_place, wanted, place_um, lambda p: True))


def _along(length_um: float, count: int) -> list[float]:
    """Return places along the strip that a ruler has, in steps of 0.1 mm."""
    return np.round(np.linspace(0, length_um, count), -2).tolist()


def _forces(setup: Setup, count: int) -> None:
    places_um = [round(share * setup.length_um, -2) for share in FORCE_PLACES]
    far_um = max(places_um)
    setup.guide.begin("forces", count * len(places_um), setup.plan(), setup.length_um)
    # The least force at the dimmest place is the first press of the session, and stays so.
    least_mN = min((p.force_mN for p in setup.session.of("force")), default=None)
    if least_mN is None:
        wanted = Wanted(kind="force", place_um=far_um, force_mN=FULL_MN)
        setup.guide.want(wanted)
        least_mN = round(setup.presser.least_mN(wanted, setup.reader), 1)
    dark_mN = _DARK_SHARE * least_mN
    steps_mN = np.geomspace(least_mN - dark_mN, FULL_MN - dark_mN, count)
    forces_mN = [round(f, 1) for f in (dark_mN + steps_mN).tolist()]
    for place_um in sorted(places_um, reverse=True):
        for force_mN in forces_mN:
            wanted = Wanted(kind="force", place_um=place_um, force_mN=force_mN)
            judge = _judge(
                setup, judge_force, wanted, force_mN, lambda p, at_um=place_um: p.place_um == at_um
            )
            _take(setup, wanted, judge)


def _marks(setup: Setup) -> None:
    """Press what a re-zero will press again, when all else is known."""
    setup.guide.say("dark frames: touch nothing")
    setup.reader.set_up(dark_s=DARK_S)
    setup.guide.begin("marks for a re-zero", len(MARKS), setup.plan(), setup.length_um)
    for share in MARKS:
        place_um = round(share * setup.length_um, -2)
        _take(setup, Wanted(kind="mark", place_um=place_um, force_mN=FIRM_MN))


def _judge(setup: Setup, rule, wanted: Wanted, at: float, among: Callable[[Point], bool]):
    known = [p for p in setup.session.of(wanted.kind, wanted.strain_ppm) if among(p)]

    def judge(reading):
        if len(known) > 1:
            noise = setup.taker.noise or Noise.of(presses(known))
            rule(presses(known), at, reading.counts, noise, setup.taker.window)

    return judge


def _missing(session: Session) -> str | None:
    """Return the command that comes before a calibration can be made, or None."""
    for kind, name, least in (
        ("position", "place_um", PLACES_MIN),
        ("force", "force_mN", _FORCES_MIN),
    ):
        taken = {getattr(p, name) for p in session.of(kind)}
        cut_short = (
            kind == "position" and max(taken, default=0) < (session.length_um or 0) - _END_UM
        )
        if len(taken) < least or cut_short:
            return f"'spots calibrate {kind} --session {session.path}'"
    return None


def _finish(setup: Setup) -> None:
    """Fit all that the session has, write the file, and give it to the board."""
    session, guide = setup.session, setup.guide
    calibration = make(session, guide.say)
    file.save(calibration, setup.out)
    for residual in calibration.residuals:
        force = residual.force_rms_mN
        guide.say(
            f"at {residual.strain_ppm / 10_000:g} % strain: position "
            f"{residual.position_rms_um:.0f} um rms"
            + ("" if force is None else f", force {force:.0f} mN rms")
        )
    setup.reader.give_back()  # what is sent is saved with the settings
    name = file.send(setup.reader.board, calibration)
    guide.say(f"{setup.out}: the board uses calibration {name}, and has stored it")


def _joint(setup: Setup, count: int) -> None:
    """Take angles up and down, and write the joint's line into the file."""
    calibration = file.load(setup.out)
    board = setup.reader.board
    if setup.session.conditions not in (None, calibration.conditions):
        raise SpotsError(f"{setup.out} and the session {setup.session.path} do not belong together")
    if board.command("hello")["calibration"] != checksum(list(calibration.lines)):
        setup.reader.give_back()
        file.send(board, calibration)
    setup.reader.set_up()
    _learn_noise(setup)
    board.command("stream touch spectrum")
    setup.guide.begin("joint", 2 * count, setup.plan(), setup.length_um)
    upwards = np.linspace(0, 1, count).tolist()
    for direction, shares in ((1, upwards), (-1, upwards[::-1])):
        known = len([p for p in setup.session.of("joint") if p.direction == direction])
        setup.guide.skip(min(known, count))
        for share in shares[known:]:
            wanted = setup.presser.turn(direction, share)
            # With one angle twice, the session can no longer be fitted.
            taken = [(p.angle_deg, p.direction) for p in setup.session.of("joint")]
            if (wanted.angle_deg, wanted.direction) in taken:
                setup.guide.skip()
                setup.guide.say(f"{wanted} was taken already: turn further")
                continue
            setup.guide.want(wanted)
            reading = setup.taker.take(wanted)
            position = _positions_um(setup)
            measured = {
                "position_um": round(float(position.mean()), 2),
                "position_sigma_um": round(float(position.std(ddof=1)), 2),
            }
            setup.session.add(point(wanted, reading, setup.reader.conditions, **measured))
            setup.guide.taken(wanted, reading)
    turned = setup.session.of("joint")
    joint = fit_joint(turned)
    marks = joint_marks(turned)
    file.save(msgspec.structs.replace(calibration, joint=joint, joint_marks=marks), setup.out)
    setup.guide.say(
        f"joint: R2 {joint.r2:.5f}, resolution {joint.resolution_deg:.3f} deg, accuracy "
        f"{joint.accuracy_deg:.3f} deg, backlash {joint.backlash_deg:.3f} deg, in {setup.out}"
    )


def _positions_um(setup: Setup) -> np.ndarray:
    """Return the positions that the board reports under the press that is held now."""
    board, wanted = setup.reader.board, setup.taker.window
    begun_s = board.now_s() + 0.5e-6 * setup.reader.info["exposure_us"]
    rows = []
    for frame in board.frames(seconds=setup.presser.patience_s):
        if isinstance(frame, Touch) and frame.time_s >= begun_s and frame.trusted:
            rows.append(frame.position_um)
            if len(rows) == wanted:
                return np.array(rows, dtype=float)
    raise SpotsError("the board reports no position: press the strip firmly with the indenter")
