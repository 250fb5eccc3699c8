"""Calibration by hand: asks a person for the presses that improve the fit most.

The person presses with an indenter, and reads position and force off a ruler and a scale. In a
rough session, the person presses with a finger and has no scale.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..fit.points import Wanted, presses
from ..fit.presses import FIRM_MN, FULL_MN, MARKS, Noise, Presses
from ..fit.surface import Surface
from ..fit.surface_search import fitted
from ..fit.surface_sizes import Sizes
from .bench import Bench, Held
from .dialog import Dialog, Progress
from .judge import BadPressError, TooDarkError, samples_of
from .order import Order, store
from .session_file import Session
from .typed import grams

_KINDS = ("hand", "position", "force", "mark")
# Presses with two forces, which measure hysteresis and creep: first force in mN, second force in
# mN, least duration of the first force in s.
_LOADS = (
    (2000.0, 9000.0, 0.0),
    (9000.0, 1000.0, 0.0),
    (9000.0, 2500.0, 0.0),
    (5000.0, 1200.0, 30.0),
    (2000.0, 800.0, 0.0),
    (4500.0, 1000.0, 0.0),
)
_LOADS_FROM = 12  # number of earlier presses, which show what forces give light in all channels
_UNLOADED = 0.6  # largest ratio of a lower second force to the first force
_NEAR_UM = 3000.0  # presses nearer to each other than this are on the same softened place
_SOFTENED_MN = 4000.0  # a force this far below an earlier one shows most of the softening
_SOFTENED_MIN_MN = 300.0  # weaker presses are not used: creep of earlier presses disturbs them
_SOFTER, _SOFTER_SIGMAS = 0.05, 2.5  # least softening to report: share, standard deviations
# First presses of a fine and of a rough session: position as a share of the length, force in mN.
_FIRST = [(share, FIRM_MN) for share in MARKS] + [(MARKS[1], FIRM_MN / 3)]
_FIRST_ROUGH = [(share, 0.0) for share in (0.02, *MARKS, 0.98, 0.3, 0.7)]
# By `rough`: number of presses that a session may ask for without storing them (for exposure,
# choice of channels, repeats). Each further press that is not stored replaces a press by hand. So a
# rough session has at most 12 presses, a fine session 45. A rough session also stores the press for
# the exposure.
_OTHERS = {True: 0, False: 6}
_FITTED_MIN = 6  # presses; from fewer, the sizes of errors cannot be estimated
_MISFIT_MAX = 50.0  # chi-squared of six channels; less than 1 of 1e8 good presses exceeds it
_REMOVALS = 0.2  # largest share of removed presses; above it, the model does not fit the strip
_HARDER = 1.4  # factor by which a repeated press is stronger if the press was too dark
_END_UM = 2000.0  # a press nearer to an end is partly beside the strip
_THIN = 1.5  # more presses are needed where the error is above this multiple of the mean error
_GOOD_UM, _GOOD_SHARE = 50.0, 0.01  # with a smaller error, no more presses are needed
_ALONG, _FORCES = 33, 30  # number of positions and of forces that `material` computes
_UNSURE = 2.0  # below this multiple of the least force, the fitted light may fall with the force


class NextBest(Order):
    """The presses by hand that improve the fit most, until the session has `count` of them.

    If many presses are refused or repeated, fewer are taken, down to `least`, so that the person
    does not press more often in total. With `rough`, the person has no scale, and the forces are
    unknown.
    """

    def __init__(self, bench: Bench, session: Session, count: int, least: int, rough: bool):
        super().__init__(bench, session)
        self._count, self._least, self._rough = count, least, rough
        self._dark_mN = 0.0  # largest force that was too weak to light every channel

    def __iter__(self) -> Iterator[Wanted]:
        bench, session, guide = self.bench, self.session, self.bench.guide
        bench.begin("presses by hand", self._count)
        guide.skip(len(session.of("hand")))
        surface, removals, advised = _surface(session, bench.length_um), 0, False
        while (done := len(session.of("hand"))) < self._total():
            if session.removed:
                again = session.removed.pop()
                yield _wanted(again.place_um, again.force_mN, again.then_mN, again.hold_s)
            else:
                yield _next(session, surface, bench.length_um, self._rough, self._dark_mN)
            surface = _surface(session, bench.length_um, surface)
            if done < _FITTED_MIN:
                continue
            if removals < _REMOVALS * self._count and _removed(session, surface, guide):
                removals += 1
                surface = _surface(session, bench.length_um, surface)
            else:
                guide.fitted(_progress(surface, done + 1, self._total()))
            if not (self._rough or advised) and done >= _LOADS_FROM:
                softer, sigma = _softening(session, surface)
                if advised := softer > max(_SOFTER, _SOFTER_SIGMAS * sigma):
                    guide.say(
                        f"firm presses have softened the strip by about {softer:.0%}: press it "
                        "everywhere with 10 N (1 kg) several times, then begin another session"
                    )

    def instead(self, held: Held, bad: BadPressError) -> Wanted | None:
        """Return a stronger press if a force was too dark; None if it cannot be stronger."""
        wanted = held.wanted
        if not isinstance(bad, TooDarkError):
            return wanted
        if len(held.holds) > 1:  # the second force was too dark
            more_mN = _HARDER * wanted.then_mN
            return _wanted(wanted.place_um, wanted.force_mN, more_mN, wanted.hold_s)
        if wanted.force_mN >= FULL_MN:
            return None
        if not wanted.force_mN:
            return wanted
        self._dark_mN = wanted.force_mN
        return _wanted(wanted.place_um, min(_HARDER * wanted.force_mN, FULL_MN))

    def store(self, held: Held, read: Wanted) -> None:
        """Store a press; with a known force also its trace, to which the silicone is fitted."""
        traced = {"trace": tuple(held.trace), "holds": tuple(held.holds)} if read.force_mN else {}
        length_um = self.bench.length_um
        store(self.bench, self.session, read, held.reading, length_um=length_um, **traced)

    def _total(self) -> int:
        session = self.session
        spent = self.bench.asked - (len(session.of("hand")) - session.begun)
        return min(self._count, max(self._least, self._count + _OTHERS[self._rough] - spent))


def material(session: Session, length_um: float) -> tuple[Surface, Presses, Presses]:
    """Fit a session by hand, and compute from the fit the presses that `fit.fit` needs.

    They are presses along the strip with one firm force, and presses at a few positions with
    ascending forces. The fit is returned, too.
    """
    surface = _surface(session, length_um).moved()
    along = surface.presses(np.linspace(0, length_um, _ALONG), np.full(_ALONG, FIRM_MN))
    forces_mN = np.geomspace(surface.least_mN, surface.most_mN, _FORCES)
    # The light rises steeply from the least force, so errors of weak forces can make the fitted
    # light fall with the force.
    light = surface.logs(np.full_like(forces_mN, length_um / 2), forces_mN).mean(axis=1)
    falls = (np.diff(light) <= 0) & (forces_mN[1:] < _UNSURE * surface.least_mN)
    forces_mN = forces_mN[np.flatnonzero(falls).max(initial=-1) + 1 :]
    places_um = np.array(MARKS) * length_um
    pressed = surface.presses(
        np.tile(places_um, len(forces_mN)), np.repeat(forces_mN, len(places_um))
    )
    return surface, along, pressed


def _wanted(place_um: float, force_mN: float, then_mN: float = 0.0, hold_s: float = 0.0) -> Wanted:
    force_mN, then_mN = float(f"{force_mN:.2g}"), float(f"{then_mN:.2g}")
    place_um = float(place_um)
    return Wanted(kind="hand", place_um=place_um, force_mN=force_mN, then_mN=then_mN, hold_s=hold_s)


def _load(session: Session, surface: Surface, place_um: float) -> tuple | None:
    """Return the next press that has two forces, one after the other.

    The result is the first force in mN, the second force in mN, and how long to hold the first
    force in s. If the second force is lower, both forces are increased where the fit `surface`
    expects too little light at the position `place_um`. Returns None until `_LOADS_FROM` presses by
    hand are done, and after the last press with two forces.
    """
    hand = session.of("hand")
    loads = sum(bool(p.then_mN) for p in hand)
    if loads == len(_LOADS) or len(hand) < _LOADS_FROM:
        return None
    force_mN, then_mN, hold_s = _LOADS[loads]
    if then_mN < force_mN:
        least_mN = surface.least_lit_mN(place_um)
        force_mN = max(force_mN, least_mN / _UNLOADED)
        then_mN = min(max(then_mN, least_mN), _UNLOADED * force_mN)
    return force_mN, then_mN, hold_s


def _softening(session: Session, surface: Surface) -> tuple[float, float]:
    """Return how much firm presses have softened the strip, and the standard deviation of this.

    A softened place gives more light under forces below the largest earlier force at this place.
    A softening of 0.1 means: as much light as a 10 % larger force gave before. With too few
    presses, the softening is 0, and its standard deviation is infinity. The softening is fitted to
    the relative errors of the forces, together with a constant and a multiple of the logarithm of
    the force.
    """
    forces_mN, off_share = surface.taken.force_mN, surface.misfits[2]
    errors = dict(zip(zip(surface.taken.position_um, forces_mN), off_share))
    rows, off = [], []
    for i, p in enumerate(session.points):
        weak = p.force_mN < _SOFTENED_MIN_MN
        if p.kind != "hand" or weak or (p.place_um, p.force_mN) not in errors:
            continue
        before = [q for q in session.points[:i] if abs(q.place_um - p.place_um) < _NEAR_UM]
        most_mN = max((max(q.force_mN, q.then_mN) for q in before), default=0.0)
        softer = np.tanh(max(most_mN - p.force_mN, 0.0) / _SOFTENED_MN)
        rows.append((1.0, np.log(p.force_mN), softer))
        off.append(errors[p.place_um, p.force_mN])
    design, off = np.array(rows), np.array(off)
    if np.linalg.matrix_rank(design) < design.shape[1] or len(off) <= design.shape[1]:
        return 0.0, np.inf
    inverse = np.linalg.inv(design.T @ design)
    found = inverse @ design.T @ off
    variance = np.sum((off - design @ found) ** 2) / (len(off) - len(found))
    return float(found[2]), float(np.sqrt(variance * inverse[2, 2]))


def _next(
    session, surface: Surface | None, length_um: float, rough: bool, dark_mN: float
) -> Wanted:
    known = [p for kind in _KINDS for p in session.of(kind) if p.force_mN or rough]
    first = _FIRST_ROUGH if rough else _FIRST
    # Presses of a stage with one force say nothing about the others.
    one_force = not rough and len({p.force_mN for p in known}) == 1
    if len(known) < len(first) or one_force or surface is None:
        share, force_mN = first[min(len(known), len(first) - 1)]
        place_um = share * length_um
    elif rough:  # without a scale, only the place can be chosen
        places_um, sigma_um = surface.bent.errors()[0]
        place_um, force_mN = places_um[np.argmax(sigma_um)], 0.0
    else:
        # Not a fixed grid: with as many presses, its positions have larger errors.
        place_um, force_mN = surface.bent.next_press(dark_mN)
    place_um = np.clip(round(place_um, -3), _END_UM, length_um - _END_UM)
    load = _load(session, surface, place_um) if surface and not rough else None
    return _wanted(place_um, *(load or (force_mN,)))


def _surface(session: Session, length_um: float, start: Surface | None = None) -> Surface | None:
    """Return the fit of all presses of a session; None if the session has fewer than four presses.

    `length_um` is the length of the strip. The search for the best fit begins at `start`, if given.
    """
    taken = presses([p for kind in _KINDS for p in session.of(kind) if min(p.counts) > 1])
    if len(taken.force_mN) < len(_FIRST):
        return None
    samples = samples_of("hand", session.conditions.exposure_us)
    if len(taken.force_mN) < _FITTED_MIN:
        return Surface(taken, Noise.of(taken), samples, length_um)
    return fitted(taken, Noise.of(taken), samples, length_um, start.sizes if start else Sizes())


def _removed(session: Session, surface: Surface, guide: Dialog) -> bool:
    """If the worst-fitting press by hand of a session is an outlier, remove it.

    `surface` is the fit of the session, and `guide` shows a message to the person. Returns False if
    there is no outlier.
    """
    misfit, taken = surface.misfits[0], surface.taken
    worst = int(np.argmax(misfit))
    at = taken.position_um[worst], taken.force_mN[worst]
    found = [p for p in session.of("hand") if (p.place_um, p.force_mN) == at]
    if misfit[worst] < _MISFIT_MAX or not found:
        return False
    place_um, force_mN = surface.without(worst).find(taken.counts[worst])
    like = f"{place_um / 1000:.1f} mm" + (f" with {grams(force_mN)}" if at[1] else "")
    guide.say(f"the press at {found[-1]} is removed: its light fits a press at {like}; press again")
    session.remove(found[-1])
    return True


def _progress(surface: Surface, done: int, total: int) -> Progress:
    (places_um, sigma_um), (forces_mN, sigma_share) = surface.errors()
    thin = []
    if sigma_um.max() > max(_THIN * sigma_um.mean(), _GOOD_UM):
        thin.append(f"near {places_um[np.argmax(sigma_um)] / 1000:.0f} mm")
    if len(sigma_share) and sigma_share.max() > max(_THIN * sigma_share.mean(), _GOOD_SHARE):
        thin.append(f"near {grams(forces_mN[np.argmax(sigma_share)])}")
    sigmas = float(sigma_um.mean()), float(sigma_share.mean()) if len(sigma_share) else np.nan
    places_um, forces_mN = surface.taken.position_um, surface.taken.force_mN
    errors = surface.misfits[1:]
    return Progress(places_um, forces_mN, *errors, *sigmas, tuple(thin), done, total)
