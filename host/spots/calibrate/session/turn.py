"""Calibrates a joint: takes readings at its angles, in both directions."""

from __future__ import annotations

import msgspec
import numpy as np

from spots_device.board.settings import checksum

from ...errors import SettingError
from .. import calibration_file as file
from .. import pressers
from ..fit.points import Wanted
from .joint import fit_joint, joint_marks
from .spectra import DARK_S
from .taker import Taker


def turn_joint(taker: Taker, count: int) -> None:
    """Calibrate a joint with readings at `count` angles upwards, then at `count` downwards."""
    bench, guide, session = taker.bench, taker.bench.guide, taker.session
    before = file.load(bench.path)
    # The indenter of the joint presses the strip; the file keeps the tables for a finger.
    calibration = pressers.used_by(before, before.presser)
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
    taker.begin("joint", 2 * count)
    upwards = np.linspace(0, 1, count).tolist()
    for direction, shares in ((1, upwards), (-1, upwards[::-1])):
        known = len([p for p in session.of("joint") if p.direction == direction])
        guide.skip(min(known, count))
        for share in shares[known:]:
            _turn(taker, bench.presser.turn(direction, share))
    turned = session.of("joint")
    joint = fit_joint(turned)
    marks = joint_marks(turned)
    calibration = msgspec.structs.replace(calibration, joint=joint, joint_marks=marks)
    file.save(calibration, bench.path, before)
    guide.say(
        f"joint: R2 {joint.r2:.5f}, resolution {joint.resolution_deg:.3f} deg, accuracy "
        f"{joint.accuracy_deg:.3f} deg, backlash {joint.backlash_deg:.3f} deg, in {bench.path}"
    )


def _turn(taker: Taker, wanted: Wanted) -> None:
    # Two points with the same angle and direction cannot be fitted.
    taken = [(p.angle_deg, p.direction) for p in taker.session.of("joint")]
    if (wanted.angle_deg, wanted.direction) in taken:
        taker.bench.guide.skip()
        taker.bench.guide.say(f"{wanted} was measured already: turn the joint further")
        return
    reading = taker.bench.take(wanted, taker.noise())
    position = taker.bench.reader.positions_um(taker.bench.window, taker.bench.presser.patience_s)
    taker.add(
        wanted,
        reading,
        position_um=round(float(position.mean()), 2),
        position_sigma_um=round(float(position.std(ddof=1)), 2),
    )
