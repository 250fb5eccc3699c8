"""A simulated linkage whose two boards a twin reads."""

from __future__ import annotations

import math

from spots.calibrate import calibration_file as file
from spots.link.board import Board
from spots_linkage import mounted
from spots_linkage.mounted import Mounted, Mounting
from spots_sim.board.faults import Faults
from spots_sim.board.lockstep import LockstepLink
from spots_sim.measure.simulated_linkage import START_S, calibrated
from spots_sim.person.mechanism import Mechanism, guided
from spots_sim.strip.files import (
    LinkageFile,
    PathFile,
    load,
)

EXPOSURE_US = 30_000


class Machine:
    """A simulated linkage that moves along a path; its boards are on the ports ``0`` and ``1``.

    Attributes
    ----------
    arm : Path
        Linkage file with the true lengths.
    """

    def __init__(self, sensor, folder):
        linkage = load(LinkageFile, "default")
        self._sensor = sensor
        self.strip = calibrated(sensor, 0, EXPOSURE_US)
        self.mechanism = mechanism = Mechanism(linkage, sensor)
        self.motion = guided(load(PathFile, "sust"), START_S)
        self._scenarios = mechanism.drive(self.motion)
        file.save(self.strip, folder / "strip.toml", None)
        self.arm = folder / "arm.toml"
        joints = [
            Mounting(calibration="strip.toml", offset_deg=math.degrees(zero))
            for zero in mechanism.zero_rad
        ]
        arm = Mounted(bar_mm=mechanism.bar_mm, base_mm=mechanism.base_mm, joint=joints)
        mounted.save(arm, self.arm, None)
        self.faults = {}

    def link(self, port):
        number = int(port)
        faults = self.faults.get(number)
        faults = Faults(faults, 3600.0) if faults else None
        return LockstepLink(
            self._sensor, self._scenarios[number], number, started_s=0.012 * number, faults=faults
        )

    def open(self, port):
        return Board(self.link(port))
