"""Measures the time to compute a five-bar linkage's end point: for arrays, and for scalars."""

from __future__ import annotations

import math
from statistics import median
from time import process_time

import numpy as np

from spots_linkage.fivebar import Linkage

_SAMPLES = 1_000_000
_CALLS, _LOOPS = 5_000, 100_000  # fewer samples, because these take longer
_ROUNDS = 5
_BAR_MM, _BASE_MM = 100.0, 80.0


def measure() -> dict:
    """Time `Linkage.forward` with an array, alternating with two loops in Python.

    Returns
    -------
    dict
        End points per second of processor time. ``array``: one call for all samples. ``calls``: one
        call for each sample. ``math``: the formula for equal bars with Python's module `math`,
        without a check of limits. Also the ratio of the first rate to each of the other two.
    """
    linkage = Linkage(_BAR_MM, _BASE_MM)
    rng = np.random.default_rng(0)
    places = np.stack([rng.uniform(0, 80, _SAMPLES), rng.uniform(110, 170, _SAMPLES)], axis=-1)
    theta1, theta2 = (np.ma.getdata(angle) for angle in linkage.inverse(*places.T))
    pairs = list(zip(theta1[:_LOOPS].tolist(), theta2[:_LOOPS].tolist()))
    parts = {
        "array": (lambda: linkage.forward(theta1, theta2), _SAMPLES),
        "calls": (lambda: [linkage.forward(*pair) for pair in pairs[:_CALLS]], _CALLS),
        "math": (lambda: [_by_math(*pair) for pair in pairs], _LOOPS),
    }
    rates = {name: [] for name in parts}
    for _ in range(_ROUNDS):
        for name, (work, count) in parts.items():
            began_s = process_time()
            found = work()
            rates[name].append(count / (process_time() - began_s))
            found = np.transpose(found) if name == "array" else found
            if not np.allclose(found[:_CALLS], places[:_CALLS], atol=1e-6):
                raise AssertionError(f"the end points of '{name}' differ")
    figures = {name: {"terminals_per_s": round(median(of))} for name, of in rates.items()}
    for name in ("calls", "math"):
        ratio = median(a / b for a, b in zip(rates["array"], rates[name]))
        figures[f"rate_ratio_over_{name}"] = round(ratio, 1)
    return figures


def _by_math(theta1: float, theta2: float) -> tuple[float, float]:
    x1, y1 = _BAR_MM * math.sin(theta1), _BAR_MM * math.cos(theta1)
    dx = _BASE_MM - _BAR_MM * math.sin(theta2) - x1
    dy = _BAR_MM * math.cos(theta2) - y1
    off = math.sqrt(_BAR_MM * _BAR_MM / (dx * dx + dy * dy) - 0.25)
    return x1 + dx / 2 - off * dy, y1 + dy / 2 + off * dx
