"""Chooses gain, LED current and channels at the start of a session."""

from __future__ import annotations

import argparse
from dataclasses import replace

from spots_device.sensor.exposure import full_scale, registers

from ...advice import lamps
from ...errors import SettingError
from ...link.connect import ensured
from ..fit.choose import choose, passes
from ..fit.points import Wanted, presses
from ..fit.presses import FIRM_MN, FULL_MN
from . import baseline
from .bench import Bench, Held
from .judge import BadPressError
from .order import along, store
from .session_file import Session, point

# Number of positions at which the channels are compared, by kind; other kinds compare none.
_CHOOSE_PLACES = {"position": 9, "force": 9, "fine": 4}
_SENSOR_END_UM = 2_000.0  # position of the brightest press, which sets the exposure


def settle(bench: Bench, session: Session, options: argparse.Namespace, kind: str) -> None:
    """Choose gain, LED current and channels, unless earlier presses of the session fix them.

    `kind` and `options` are those of `steps.calibrate`.
    """
    reader = bench.reader
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
        _mains(bench)
        _autoexpose(bench, session, 0.0 if kind == "rough" else FULL_MN)
    # With an LED that is always on, each plan would need its own dark frame.
    places = _CHOOSE_PLACES.get(kind)
    if places and not wanted_plan and reader.info["led"] != "always":
        _choose(bench, session, places)


def _mains(bench: Bench) -> None:
    reader, guide = bench.reader, bench.guide
    if reader.info["mains_hz"] != 0:  # set by hand
        return
    guide.say("measuring the flicker of lamps: touch nothing")
    if mains_hz := lamps.mains_hz(reader.board):
        reader.set_up(f"mains_hz={mains_hz}")
        ensured(reader.board, "save")  # a later run then sets the same exposure
        guide.say(f"lamps flicker at {2 * mains_hz} Hz: mains_hz={mains_hz}")


def _autoexpose(bench: Bench, session: Session, force_mN: float) -> None:
    bench.untouched()
    bench.begin("exposure", 1)
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
        _exposed(bench, session)
    led = f"{found['led_mA']} mA" if kind == "ldr" else kind
    bench.guide.say(f"gain {found['gain']}, LED {led}, exposure {found['exposure_us']} us")


def _exposed(bench: Bench, session: Session) -> None:
    """Read the same press once more, at the settings that `_autoexpose` found.

    The light of the untouched strip is measured after the release, and then subtracted. The
    person then types the true position, and the press is stored as a press by hand.
    """
    held = Held(Wanted(kind="hand", place_um=_SENSOR_END_UM, force_mN=0.0))
    try:
        bench.read(held)
    except BadPressError:  # the session requests a press at this position
        bench.release()
        return
    bench.release()
    bench.untouched()
    light = bench.reader.baseline
    reading = replace(held.reading, counts=held.reading.counts - light, baseline=light)
    if read := bench.presser.read_off(held.wanted, bench.length_um):
        store(bench, session, read, reading, length_um=bench.length_um)


def _choose(bench: Bench, session: Session, places: int) -> None:
    reader = bench.reader
    known = session.of("choose")
    plans = passes(known[0].plan if known else reader.conditions.plan)
    row = [Wanted(kind="choose", place_um=_SENSOR_END_UM, force_mN=FULL_MN)]
    for place_um in along(bench.length_um, places):
        row.append(Wanted(kind="choose", place_um=place_um, force_mN=FIRM_MN))
    for plan in plans:  # else light without a press would look like a press
        _set_plan(bench, plan)
        bench.untouched()
    bench.begin("choice of channels", len(row))
    for wanted in row:
        missing = [plan for plan in plans if not session.has(wanted, plan)]
        if not missing:
            bench.guide.skip()
            continue
        _set_plan(bench, missing[0])
        reading = bench.take(wanted, session).reading
        for plan in missing:
            if plan != reader.conditions.plan:
                # The LED is off in a dark frame, so the strip may be pressed.
                _set_plan(bench, plan)
                reading = reader.read(bench.window)
            session.add(point(wanted, reading, reader.conditions, length_um=bench.length_um))
        baseline.check(session)
        bench.guide.taken(wanted, reading)
        bench.release()
    measured = tuple(presses([p for p in session.of("choose") if p.plan == plan]) for plan in plans)
    choice = choose(plans, measured, full_scale(*registers(reader.conditions.exposure_us)))
    _set_plan(bench, choice.plan)
    bench.guide.say(
        f"noise of one sample: {choice.sigma_um:.0f} um with channels {' '.join(choice.plan)}, "
        f"{choice.present_sigma_um:.0f} um with {' '.join(plans[0])}"
    )


def _set_plan(bench: Bench, plan: tuple[str, ...]) -> None:
    if plan != bench.reader.conditions.plan:
        bench.reader.set_up("channels=" + ",".join(plan))
