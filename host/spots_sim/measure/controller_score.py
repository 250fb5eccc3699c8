"""Measures how closely a game controller (`spots.controller`) follows the finger of a scenario."""

from __future__ import annotations

import math

from spots.controller.controller_settings import ControllerSettings
from spots.controller.gamepad_engine import axis_value, span, usable
from spots.controller.shaping import deflection
from spots.link.frames import Touch
from spots.outputs.devices import AXIS_MAX, REST, State

from ..strip.scenario import Scenario

# Longest latency of a gamepad state: exposure, transfer, filter, and the time until the force of a
# finger reaches the touch threshold.
_BACK_S = 0.05
# A lifting finger is below the touch threshold up to this time before its end in the scenario.
_LIFT_S = 0.1
_STEP_S = 0.001


class ControllerScore:
    """Compares a controller's axis X with the true X, computed from the scenario's only finger.

    `started_s` is the host time at which the scenario's time is 0.
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
        """Compare the X that the controller computed from a reading with the true X at its time."""
        wanted = self._wanted(touch.time_s)
        if usable(touch) and wanted is not None:
            self._squares += (state.x - wanted) ** 2
            self._compared += 1

    def sent(self, state: State, now_s: float) -> None:
        """Compare the change of X since the last sent state with the finger's movement."""
        start_s = max(self._last_s, now_s - 1) - _BACK_S
        end_s = now_s + (_LIFT_S if state[:3] == REST[:3] else 0)
        count = round((end_s - start_s) / _STEP_S)
        wanted = [self._wanted(start_s + i * _STEP_S) or 0 for i in range(count + 1)]
        step = abs(state.x - self._last.x) - (max(wanted) - min(wanted))
        self._jump = max(self._jump, step)
        self._last, self._last_s = state, now_s
        self.states += 1

    def _wanted(self, time_s: float) -> int | None:
        """Return the true value of the axis X at `time_s` seconds of host time.

        None if the number of fingers is not 1, or the controller has no axis X.
        """
        presses = self._scenario.presses(time_s - self._started_s)
        if len(presses) != 1 or self._settings is None:
            return None
        field, rest, low, high = self._span
        press = presses[0]
        value = press.force_mN if field == "force_mN" else 1000 * press.position_mm
        return axis_value(deflection(value, rest, low, high), self._settings)

    def summary(self) -> dict:
        """Return the results of the run, in per cent of the range from the centre of X to its end.

        A jump is *unexplained* by what it exceeds the change that the finger's movement causes. The
        root mean square error is None without a compared reading.
        """
        rms = math.sqrt(self._squares / self._compared) if self._compared else None
        return {
            "states": self.states,
            "largest_unexplained_jump_percent": _percent(self._jump),
            "x_rms_percent": None if rms is None else _percent(rms),
        }


def _percent(value: float) -> float:
    return round(100 * value / AXIS_MAX, 3)
