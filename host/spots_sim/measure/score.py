"""Scores a run of a virtual board: errors of position and force, rate, latency."""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from spots.link.frames import LinkStats, Touch

from ..strip.scenario import Scenario

# Percentiles are computed over this number of readings, which limits the memory.
_RECENT = 10_000


class Score:
    """Accumulates the error, rate and latency of readings, in bounded memory.

    Rate and latency are those of all readings. For the error, a reading is *compared* with the true
    finger if it is a trusted touch and the scenario has exactly one finger at this time.
    `started_s` is the host time at which the scenario's time is 0.
    """

    def __init__(self, scenario: Scenario, started_s: float):
        self._scenario = scenario
        self._started_s = started_s
        self._position_um2 = self._force_mN2 = 0.0  # sums of squared errors
        self._compared = self._pressed = 0  # trusted readings of one finger, and all of one finger
        self._errors_um: deque[float] = deque(maxlen=_RECENT)
        self._latencies_ms: deque[float] = deque(maxlen=_RECENT)
        self._touching = False
        self._first_s = self._last_s = math.nan
        self.readings = 0
        self.touches = 0

    def take(self, touch: Touch, arrived_s: float) -> None:
        """Process a reading; compare it with the scenario's finger if there is exactly one."""
        if not self.readings:
            self._first_s = touch.time_s
        self._last_s = touch.time_s
        self.readings += 1
        self._latencies_ms.append(1000 * (arrived_s - touch.time_s))
        self.touches += touch.touching and not self._touching
        self._touching = touch.touching
        presses = self._scenario.presses(touch.time_s - self._started_s)
        if not touch.touching or len(presses) != 1:
            return
        self._pressed += 1
        if touch.trusted:
            error_um = touch.position_um - 1000 * presses[0].position_mm
            self._errors_um.append(abs(error_um))
            self._position_um2 += error_um**2
            self._force_mN2 += (touch.force_mN - presses[0].force_mN) ** 2
            self._compared += 1

    @property
    def rate_hz(self) -> float:
        """Mean rate of the readings in Hz; 0 for fewer than two readings."""
        span_s = self._last_s - self._first_s
        return (self.readings - 1) / span_s if span_s > 0 else 0.0

    @property
    def position_rmse_um(self) -> float | None:
        """Root mean square error of the position in um; None if no reading was compared."""
        return self._rms(self._position_um2)

    @property
    def position_median_um(self) -> float | None:
        """Median absolute error of the position in um; None if no reading was compared.

        The rms error depends mainly on the one or two faintest readings: at the force at which a
        touch begins, the error of a single reading can exceed 1 mm. The median hardly depends on
        them.
        """
        return _rounded(np.median(self._errors_um)) if self._compared else None

    @property
    def trusted_percent(self) -> float | None:
        """Percentage of readings that are trusted, while exactly one finger touches the strip.

        None without a reading of such a touch. Only trusted readings are compared.
        """
        return _rounded(100 * self._compared / self._pressed) if self._pressed else None

    @property
    def force_rmse_mN(self) -> float | None:
        """Root mean square error of the force in mN; None if no reading was compared."""
        return self._rms(self._force_mN2)

    def latency_ms(self, percentile: float) -> float | None:
        """Return a percentile (0 to 100) of the latency in ms; None before the first reading.

        The latency is the time from the middle of a reading's integration to its arrival.
        """
        return _rounded(np.percentile(self._latencies_ms, percentile)) if self.readings else None

    def _rms(self, squares: float) -> float | None:
        return _rounded(math.sqrt(squares / self._compared)) if self._compared else None

    def facts(self) -> dict:
        """Return the texts that the terminal shows, see `spots.terminal.view.Judge.facts`."""
        if not self.readings:
            return {"link": {}, "rows": []}
        rows = []
        if self.position_rmse_um is not None:
            error = f"{self.position_rmse_um:.0f} µm, {self.force_rmse_mN:.0f} mN rms"
            rows.append({"touches": self.touches, "error against the scenario": error})
        latency = f"{self.latency_ms(50):.1f} ms"
        return {"link": {"rate": f"{self.rate_hz:.1f} Hz", "latency": latency}, "rows": rows}

    def summary(self, info: dict, stats: LinkStats) -> dict:
        """Return the results of the run: from the reply to ``hello``, the link, and this class."""
        return {
            "runtime": info["runtime"],
            "board": info["board"],
            "frames": stats.frames,
            "lost": stats.lost,
            "bad_crc": stats.bad_crc,
            "restarts": stats.restarts,
            "rate_hz": _rounded(self.rate_hz),
            "touches": self.touches,
            "trusted_percent": self.trusted_percent,
            "position_median_um": self.position_median_um,
            "position_rmse_um": self.position_rmse_um,
            "force_rmse_mN": self.force_rmse_mN,
            "latency_ms": {"p50": self.latency_ms(50), "p99": self.latency_ms(99)},
        }


def _rounded(value: float) -> float:
    return round(float(value), 3)
