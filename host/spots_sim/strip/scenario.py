"""Scenarios: the true fingers, strain and light on a simulated strip over time."""

from __future__ import annotations

import math
from bisect import bisect_right

import msgspec
from msgspec.structs import asdict, replace

from .change import NONE, Change
from .files import Ambient, Finger, ScenarioFile, Surroundings

_NEAR_S = 1e-6  # more than the rounding errors of a time
_LEAVES = 1.0, 2**0.5, 5**0.5  # frequencies of the light through leaves, as multiples; assumed
_TREMOR_HZ = 9.3  # physiological tremor of fingers: 8 to 12 Hz


class Press(msgspec.Struct, frozen=True):
    """A finger or an indenter on the strip at one moment.

    The position is counted from the sensor's end. The tilt is the pressure at the far edge minus
    the mean pressure, in per cent of the mean. A `hand` shades the strip, `skin` reflects light.
    """

    position_mm: float
    force_mN: float
    width_mm: float
    tilt_percent: float = 0.0
    hand: bool = True
    skin: bool = True


class Pose(msgspec.Struct, frozen=True):
    """Strain, bend and leak of the strip at one moment.

    `strain` is elongation by length at rest. A leak is light that couples without a finger, as a
    share of full contact, at `leak_mm` from the sensor's end.
    """

    strain: float = 0.0
    bend_deg: float = 0.0
    leak_share: float = 0.0
    leak_mm: float = 0.0


class Scenario:
    """Fingers, strain and light of a scenario file, which is repeated without end."""

    still = False
    unplugged = False

    def __init__(self, file: ScenarioFile):
        self.file = file
        self._strain = file.strain or [(0.0, file.strain_percent)]
        self._bend = file.bend or [(0.0, file.bend_deg)]
        self._leak = file.leak or [(0.0, 0.0, 0.0)]
        moves = max(map(len, (self._strain, self._bend, self._leak))) > 1
        self._only_pose = None if moves else self._pose(0.0)
        self._stays_dark = not (moves or self._only_pose.leak_share)  # without a finger
        self._moved = {k: v for k, v in asdict(file.change).items() if v}
        # Active touches in each interval between two moments at which a touch begins or ends.
        spans = [(touch, [point[0] for point in touch.points]) for touch in file.touch]
        self._edges = sorted({edge for _, times in spans for edge in (times[0], times[-1])})
        self._down = [[]] + [
            [span for span in spans if span[1][0] <= edge < span[1][-1]] for edge in self._edges
        ]

    def pose(self, time_s: float) -> Pose:
        """Return strain, bend and leak of the strip at `time_s` seconds of the scenario."""
        return self._only_pose or self._pose(time_s % self.file.seconds)

    def change(self, time_s: float) -> Change:
        """Return the sensor's change since the calibration, at `time_s` seconds of the scenario."""
        if not self._moved:
            return NONE
        phase_s = time_s % self.file.seconds
        return Change(**{name: _on_lines(v, phase_s)[0] for name, v in self._moved.items()})

    def presses(self, time_s: float) -> list[Press]:
        """Return the fingers with a force above 0 at `time_s` seconds of the scenario."""
        phase_s = time_s % self.file.seconds
        found = []
        for touch, times in self._down[bisect_right(self._edges, phase_s)]:
            press = _between(touch, bisect_right(times, phase_s), phase_s)
            if press.force_mN > 0:
                found.append(press)
        return found

    def is_dark(self, start_s: float, end_s: float) -> bool:
        """Return whether no light of the LED can couple into the strip in an interval.

        Also False where the answer is not certain: near the start or the end of a touch, and in
        every scenario with a leak or with a pose that changes.
        """
        first_s = start_s % self.file.seconds - _NEAR_S
        i = bisect_right(self._edges, first_s)
        upcoming_s = self._edges[i] if i < len(self._edges) else self.file.seconds
        last_s = first_s + (end_s - start_s) + 2 * _NEAR_S
        return self._stays_dark and not self._down[i] and last_s < upcoming_s

    def ambient_uW_cm2(self, start_s: float, end_s: float) -> float:
        """Return the mean irradiance of the ambient light over an interval."""
        ambient = self.file.ambient
        if ambient is None:
            return 0.0
        level = _step(ambient, start_s % self.file.seconds)
        level *= flicker(ambient, start_s, end_s) * unshaded(ambient, self, start_s)
        return level * _leaves(ambient, start_s, end_s) if ambient.leaves_percent else level

    def _pose(self, phase_s: float) -> Pose:
        (percent,) = _on_lines(self._strain, phase_s)
        (bend_deg,) = _on_lines(self._bend, phase_s)
        return Pose(percent / 100, bend_deg, *_on_lines(self._leak, phase_s))


class Held:
    """A scenario with one press, which a simulated stage sets; has the methods of `Scenario`.

    Without a press, `press` is None. `strain` is elongation by length at rest; the leak is that of
    `Pose`. `changed` is the change since the calibration. `tremor` is the amplitude of the force's
    tremor as a share of the force, 0 for an indenter. With `still`, the light of an exposure is
    computed one time, for its middle. With `unplugged`, an LED that is otherwise always on has no
    power.
    """

    still = True

    def __init__(self):
        self.press: Press | None = None
        self.strain = 0.0
        self.bend_deg = 0.0
        self.leak_share = self.leak_mm = 0.0
        self.changed = NONE
        self.tremor = 0.0
        self.unplugged = False

    def pose(self, time_s: float) -> Pose:
        return Pose(self.strain, self.bend_deg, self.leak_share, self.leak_mm)

    def change(self, time_s: float) -> Change:
        return self.changed

    def presses(self, time_s: float) -> list[Press]:
        if self.press is None:
            return []
        if not self.tremor:
            return [self.press]
        return [replace(self.press, force_mN=self.press.force_mN * _swing(self.tremor, time_s))]

    def is_dark(self, start_s: float, end_s: float) -> bool:
        return False  # unknown: `person.follow` replaces `presses`

    def ambient_uW_cm2(self, start_s: float, end_s: float) -> float:
        return 0.0


def flicker(lamp: Ambient | Surroundings, start_s: float, end_s: float) -> float:
    """Return the mean light of a lamp over an interval, divided by its mean over all time.

    `end_s` must be larger than `start_s`.
    """
    omega, phase = 2 * math.pi * lamp.flicker_hz, math.radians(lamp.flicker_phase_deg)
    swing = math.sin(omega * end_s + phase) - math.sin(omega * start_s + phase)
    return 1 + lamp.flicker_percent / 100 * swing / (omega * (end_s - start_s))


def unshaded(lamp: Ambient | Surroundings, scenario: Scenario | Held, time_s: float) -> float:
    """Return the share of a lamp's light that no hand shades."""
    shades = lamp.shaded_percent and any(press.hand for press in scenario.presses(time_s))
    return 1 - lamp.shaded_percent / 100 if shades else 1.0


def _leaves(ambient: Ambient, start_s: float, end_s: float) -> float:
    # The mean of oscillations whose sum does not repeat.
    swing = 0.0
    for ratio in _LEAVES:
        omega = 2 * math.pi * ratio * ambient.leaves_hz
        swing += (math.cos(omega * start_s) - math.cos(omega * end_s)) / (omega * (end_s - start_s))
    return 1 + ambient.leaves_percent / 100 * swing / len(_LEAVES)


def _between(touch: Finger, i: int, time_s: float) -> Press:
    (t0, x0, f0), (t1, x1, f1) = touch.points[i - 1], touch.points[i]
    share = (time_s - t0) / (t1 - t0)
    x_mm, force_mN = x0 + share * (x1 - x0), f0 + share * (f1 - f0)
    if touch.roll_mm:
        first_s, last_s = touch.points[0][0], touch.points[-1][0]
        x_mm += touch.roll_mm * (time_s - first_s) / (last_s - first_s)
    if i == len(touch.points) - 1:
        x_mm += touch.slide_mm * share
    if touch.tremor_percent:
        force_mN *= _swing(touch.tremor_percent / 100, time_s)
    return Press(max(x_mm, 0.0), force_mN, touch.width_mm, touch.tilt_percent)


def _swing(tremor: float, time_s: float) -> float:
    return 1 + tremor * math.sin(2 * math.pi * _TREMOR_HZ * time_s)


def _on_lines(points: list, time_s: float) -> tuple[float, ...]:
    # Linear interpolation at a time. The first value of each point is its time.
    i = bisect_right(points, time_s, key=lambda point: point[0])
    if i in (0, len(points)):
        return tuple(points[max(0, i - 1)][1:])
    before, after = points[i - 1], points[i]
    share = (time_s - before[0]) / (after[0] - before[0])
    return tuple(a + share * (b - a) for a, b in zip(before[1:], after[1:]))


def _step(ambient: Ambient, time_s: float) -> float:
    level = 0.0
    for start_s, irradiance in ambient.steps:
        if time_s >= start_s:
            level = irradiance
    return level
