"""Calibrates a joint: takes readings at its angles, in both directions."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import numpy as np

from spots_device.board.settings import checksum

from ...errors import SettingError
from .. import calibration_file as file
from .. import pressers
from ..fit.points import Wanted
from .bench import Bench, Held
from .joint import fit_joint, joint_marks
from .order import Order, run, store
from .session_file import Session


class _Angles(Order):
    """A number of angles upwards, then as many downwards; the indenter always presses the strip."""

    def __init__(self, bench: Bench, session: Session, count: int):
        super().__init__(bench, session)
        self._count = count

    def __iter__(self) -> Iterator[Wanted]:
        bench, session = self.bench, self.session
        upwards = np.linspace(0, 1, self._count).tolist()
        for direction, shares in ((1, upwards), (-1, upwards[::-1])):
            known = len([p for p in session.of("joint") if p.direction == direction])
            bench.guide.skip(min(known, self._count))
            for share in shares[known:]:
                wanted = bench.presser.turn(direction, share)
                # Two points with the same angle and direction cannot be fitted.
                taken = [(p.angle_deg, p.direction) for p in session.of("joint")]
                if (wanted.angle_deg, wanted.direction) in taken:
                    bench.guide.skip()
                    bench.guide.say(f"{wanted} was measured already: turn the joint further")
                else:
                    yield wanted

    def store(self, held: Held, read: Wanted) -> None:
        """Store an angle with the position that the board computes."""
        bench = self.bench
        position = bench.reader.positions_um(bench.window, bench.presser.patience_s)
        store(
            bench,
            self.session,
            read,
            held.reading,
            position_um=round(float(position.mean()), 2),
            position_sigma_um=round(float(position.std(ddof=1)), 2),
        )


def turn_joint(bench: Bench, session: Session, count: int) -> None:
    """Calibrate a joint with readings at `count` angles upwards, then at `count` downwards."""
    guide = bench.guide
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
    bench.with_joint(calibration.lines)
    board.command("stream touch spectrum")
    bench.begin("joint", 2 * count)
    run(_Angles(bench, session, count))
    turned = session.of("joint")
    joint = fit_joint(turned)
    marks = joint_marks(turned)
    calibration = msgspec.structs.replace(calibration, joint=joint, joint_marks=marks)
    file.save(calibration, bench.path, before)
    guide.say(
        f"joint: R2 {joint.r2:.5f}, resolution {joint.resolution_deg:.3f} deg, accuracy "
        f"{joint.accuracy_deg:.3f} deg, backlash {joint.backlash_deg:.3f} deg, in {bench.path}"
    )
