"""How the fingers of the simulated typist move; when they move is in `times`."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Hands:
    """Forces and movements of the fingers that type; a pair is the least and the largest value.

    `force_mN` is the median of the largest force of a touch, `force_spread` the standard deviation
    of its natural logarithm. Source: Effects of key stiffness on force and the development of
    fatigue while typing, Am. Ind. Hyg. Assoc. J. 57, 849, 1996, doi 10.1080/15428119691014549.
    People press a key that needs 0.28 N with 4.1 to 7.0 times this force; a key that needs 0.83 N,
    with 2.2 to 3.5 times this force. All other values are *assumed*.

    - `rise_s`, `lift_s`: time in which the force rises, and in which it falls, at most `ramp_share`
      of the duration of the touch.
    - `same_s`: shortest pause between two touches at the same position.
    - `apart_mm`: smallest distance between two fingers.
    - `roll_mm`: standard deviation of the distance that a finger rolls during a touch.
    - `rolls_mm`, `slides_mm`: distance by which a finger moves in addition to `roll_mm`, in a
      random direction: while it rolls during a touch, and while it slides as it lifts.
    - `tremor_percent`: amplitude of the force's tremor, in per cent of the force.
    - `palm_mN`, `palm_wobble_percent`: force with which the palm rests at the far end of the strip
      while the fingers type, 0 if it does not; and amplitude of this force's tremor.
    """

    force_mN: float = 2000.0
    force_spread: float = 0.35
    rise_s: tuple[float, float] = (0.012, 0.03)
    lift_s: tuple[float, float] = (0.012, 0.03)
    ramp_share: float = 0.4
    same_s: float = 0.03
    apart_mm: float = 8.0
    roll_mm: float = 0.15
    rolls_mm: tuple[float, float] = (0.0, 0.0)
    slides_mm: tuple[float, float] = (0.0, 0.0)
    tremor_percent: tuple[float, float] = (0.0, 0.0)
    width_mm: tuple[float, float] = (4.0, 4.0)
    palm_mN: float = 0.0
    palm_wobble_percent: float = 0.0


USUAL = Hands()
# Hands that differ from the usual ones in one behaviour. All sizes are assumed.
HANDS = {
    "usual": USUAL,
    "rolling-little": Hands(rolls_mm=(1.0, 2.0)),
    "rolling": Hands(rolls_mm=(2.0, 3.0)),
    "sliding": Hands(slides_mm=(3.0, 6.0)),
    "sliding-slowly": Hands(slides_mm=(3.0, 6.0), lift_s=(0.03, 0.06)),
    "trembling": Hands(tremor_percent=(15.0, 30.0)),
    "narrow": Hands(width_mm=(3.0, 5.0)),
    "wide": Hands(width_mm=(14.0, 18.0)),
    "resting-palm": Hands(palm_mN=1500.0),
    "wobbling-palm": Hands(palm_mN=1500.0, palm_wobble_percent=10.0),
}
