"""Scores how closely a controller followed the finger of a scenario."""

from __future__ import annotations

import math

from spots.controller.controller_settings import ControllerSettings
from spots.controller.gamepad_engine import axis_value, span
from spots.controller.shaping import deflection
from spots.link.frames import Touch
from spots.outputs.devices import AXIS_MAX, REST, State

from .scenario import Scenario

# What a state may still answer: exposure, transfer, filter, a landing's way over the threshold.
_BACK_S = 0.05
# A finger on its way up is away for the strip before it is for the scenario.
_LIFT_S = 0.1
_STEP_S = 0.001


class ControllerScore:
    """Compares X with where the one finger of the scenario is, through the same curve.

    Parameters
    ----------
    settings : ControllerSettings
    length_um : float
        Of the strip.
    scenario : Scenario
        The truth.
    started_s : float
        Host time of the scenario's time 0.

    Attributes
    ----------
    states : int
        How many were sent.
    """

    def __init__(
        self, settings: ControllerSettings, length_um: float, scenario: Scenario, started_s: float
    ):
        self._settings = settings.x
        self._span = settings.x and span(settings.x, length_um)
        self._scenario = scenario
        self._started_s = started_s
        self._squares = 0.0
        self._compared = 0
        self._last, self._last_s = REST, -math.inf
        self._jump = 0.0
        self.states = 0

    def read(self, touch: Touch, state: State) -> None:
        """Compare the state made of a reading with the truth at its time.

        Parameters
        ----------
        touch : Touch
            The reading.
        state : State
            What the controller makes of it.
        """
        wanted = self._wanted(touch.time_s)
        if touch.trusted and wanted is not None:
            self._squares += (state.x - wanted) ** 2
            self._compared += 1

    def sent(self, state: State, now_s: float) -> None:
        """Compare a step of X with the finger's movement since the last state.

        Parameters
        ----------
        state : State
            What the gamepad gets.
        now_s : float
            In seconds by the link's clock.
        """
        start_s = max(self._last_s, now_s - 1) - _BACK_S
        end_s = now_s + (_LIFT_S if state[:3] == REST[:3] else 0)
        count = round((end_s - start_s) / _STEP_S)
        wanted = [self._wanted(start_s + i * _STEP_S) or 0 for i in range(count + 1)]
        step = abs(state.x - self._last.x) - (max(wanted) - min(wanted))
        self._jump = max(self._jump, step)
        self._last, self._last_s = state, now_s
        self.states += 1

    def _wanted(self, time_s: float) -> int | None:
        """Return X for the one finger at a time, None without or with two."""
        presses = self._scenario.presses(time_s - self._started_s)
        if len(presses) != 1 or self._settings is None:
            return None
        field, rest, low, high = self._span
        press = presses[0]
        value = press.force_mN if field == "force_mN" else 1000 * press.position_mm
        return axis_value(deflection(value, rest, low, high), self._settings)

    def summary(self) -> dict:
        """Return the run in figures; per cent of the way from rest to an end of X."""
        rms = math.sqrt(self._squares / self._compared) if self._compared else None
        return {
            "states": self.states,
            "largest_unexplained_jump_percent": _percent(self._jump),
            "x_rms_percent": None if rms is None else _percent(rms),
        }


def _percent(value: float) -> float:
    return round(100 * value / AXIS_MAX, 3)
