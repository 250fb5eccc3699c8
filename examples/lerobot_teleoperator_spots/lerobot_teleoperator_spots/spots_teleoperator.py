"""The teleoperator, as LeRobot calls it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

from lerobot.teleoperators.config import TeleoperatorConfig
from lerobot.teleoperators.teleoperator import Teleoperator

import spots

from .mapping import REST, Mapping


@TeleoperatorConfig.register_subclass("spots")
@dataclass
class SpotsTeleoperatorConfig(TeleoperatorConfig):
    """Options of the teleoperator, such as ``--teleop.port=/dev/ttyACM0``."""

    port: str | None = None
    sensor: int = 0
    light_N: float = 0.5
    closed_N: float = 5.0


class SpotsTeleoperator(Teleoperator):
    """A strip whose presses are actions."""

    config_class = SpotsTeleoperatorConfig
    name = "spots"

    def __init__(self, config: SpotsTeleoperatorConfig):
        super().__init__(config)
        self.config = config
        self._board: spots.Board | None = None
        self._mapping: Mapping | None = None
        self._action = dict(REST)

    @cached_property
    def action_features(self) -> dict[str, type]:
        return dict.fromkeys(REST, float)

    @cached_property
    def feedback_features(self) -> dict[str, type]:
        return {}

    @property
    def is_connected(self) -> bool:
        return self._board is not None

    @property
    def is_calibrated(self) -> bool:
        return self._mapping is not None

    def connect(self, calibrate: bool = True) -> None:
        """Open the board; `calibrate` is ignored, because 'spots calibrate' does it."""
        board = spots.open(self.config.port) if self.config.port else spots.open()
        try:
            sensor = self.config.sensor
            info = board.command(f"hello sensor={sensor}" if sensor else "hello")
            if not info["length_um"]:
                raise spots.SpotsError("the strip is not calibrated: run 'spots calibrate'")
            config = self.config
            self._mapping = Mapping(info["length_um"], config.light_N, config.closed_N)
            board.stream("touch", "spectrum")
            self._spectra = board.spectra()
        except BaseException:
            board.close()
            raise
        self._board, self._counts = board, None

    def calibrate(self) -> None:
        """Do nothing: 'spots calibrate' calibrates a strip."""

    def configure(self) -> None:
        """Do nothing: the board stores its settings."""

    def get_action(self) -> dict[str, Any]:
        """Return position, force and gripper of the newest reading; never waits."""
        if self._board is None or self._mapping is None:
            raise spots.SpotsError("the strip is not connected: call connect() first")
        touch = self._board.latest(self.config.sensor)
        self._action = self._mapping.action(touch, self._action)
        return dict(self._action)

    def tactile(self) -> tuple[int, ...] | None:
        """Return the six counts of the newest spectrum; None before the first one."""
        while self._spectra.unread:
            spectrum = next(self._spectra)
            if spectrum.sensor == self.config.sensor:
                self._counts = spectrum.counts
        return self._counts

    def send_feedback(self, feedback: dict[str, Any]) -> None:
        """Do nothing: a strip cannot move."""

    def disconnect(self) -> None:
        """Close the board."""
        board, self._board = self._board, None
        if board is not None:
            board.close()
