"""``spots rezero``: corrects the drift of a calibration with new presses at marked positions.

These positions (marks) were also pressed for the calibration. The shift of a mark is log2 of its
present counts minus log2 of its counts at the calibration. At the end, the new calibration is
written to both the file and the board; on error, both keep the old one.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from msgspec.structs import replace
from numpy.polynomial import polynomial

from spots_device.reading.calibration import Calibration
from spots_device.reading.log2 import ONE as ONE_Q20

from ...errors import CalibrationError, FileError, SettingError, SpotsError
from ...link.board import Board
from .. import calibration_file as file
from .. import pressers
from ..fit.cross_lines import CrossLines
from ..fit.drift import described
from ..fit.points import Wanted
from . import baseline
from .bench import Bench, Held
from .order import Order, run
from .spectra import DARK_S

_STRAY_UM = 1500.0  # largest distance from the other presses at a mark; a person achieves 300 um
_LIGHT_MAX = 1.0  # log2; a strip whose light has halved or doubled needs a new calibration
_STRAY_SHARE = 0.5  # largest distance from the mark, as a share of the distance to the next mark
_STRAYS = 5  # largest number of repeated presses of a mark


def rezero(
    bench: Bench,
    made: file.CalibrationFile,
    presses: int = 1,
    marks: int = 3,
    force_mN: float | None = None,
    joint: bool = False,
    presser: file.Presser | None = None,
) -> file.CalibrationFile:
    """Ask for presses at the marks, and return the corrected calibration without writing a file.

    With one of the `marks`, only the middle one, LED and filters are corrected, but not the dye;
    with more than three, also a dye that has changed at one place. With `force_mN` of each press,
    read off a scale, the drift of the force is corrected, too. With `joint`, the marks are those of
    the joint instead of those that a person presses. If no `presser` is given, it is what uses the
    strip. SpotsError if the calibration has not so many marks or was made on another board or at
    other settings, or if the presses at a mark disagree.
    """
    # The marks of a joint were pressed as they are now, and say nothing about another presser.
    presser = made.presser if joint else presser or pressers.awaited(made)
    known = marks_of(made, bench.path, marks, joint, force_mN)
    at = _evenly(len(known.place_um), marks)
    table, reader = Calibration(made.lines), bench.reader
    reason = table.mismatch(reader.conditions)
    if reason is not None:
        raise CalibrationError(f"{bench.path}: {reason}")
    longer = reader.conditions.exposure_us / table.conditions.exposure_us
    if joint:
        bench.with_joint(made.lines)
    else:
        bench.untouched(DARK_S)
    place_um = tuple(known.place_um[i] for i in at)
    logs = np.array(known.logs)[at]
    bench.begin("re-zero", presses * len(place_um))
    asked_mN = force_mN or (0.0 if presser == file.FINGER else known.force_mN)
    original = made.original or made.lines
    cross = CrossLines(original)
    angles_deg = known.angle_deg or (None,) * len(known.logs)
    shifts, before_C = [], _temperature_C(bench)
    with _without_keys(reader.board):
        for x_um, log, angle_deg in zip(place_um, logs, (angles_deg[i] for i in at)):
            wanted = Wanted(kind="mark", place_um=x_um, force_mN=asked_mN, angle_deg=angle_deg)
            # The colour of firm presses: the drift does not contain the effect of another force.
            firm = log - cross.logs(x_um, np.exp2(log))

            def shift(counts, x_um=x_um, firm=firm) -> np.ndarray:
                return np.log2(counts) - cross.logs(x_um, counts / longer) - firm

            mark = _Mark(bench, wanted, shift, known, max(marks, 3), presses)
            run(mark)
            shifts.append(mark.shifts.mean(axis=0))
    shifts = np.array(shifts)
    if force_mN is None:  # the mean shift of all channels is due to another force
        shifts -= shifts.mean(axis=1, keepdims=True)
    else:
        then_now_mN = [known.force_mN, force_mN]
        then, now = np.interp(then_now_mN, table.forces_mN, table.brightnesses) / ONE_Q20
        shifts -= now - then + np.log2(longer)
        _check_light(shifts.mean(axis=1), place_um, force_mN)
    if not joint and marks > 1:
        shifts = _straightened(place_um, logs, shifts)
    done = file.Rezero(
        date=file.now(),
        place_um=place_um,
        shifts=tuple(map(tuple, shifts.round(6).tolist())),
        drift=_drift(made, presser, place_um, logs, shifts),
        presser=presser,
        temperature_C=_mean(before_C, _temperature_C(bench)),
    )
    lines = baseline.replaced(made.lines, reader.baseline / longer)
    new = replace(made, lines=tuple(lines), original=original, rezeros=[*made.rezeros, done])
    return pressers.used_by(new, presser)


def _drift(made: file.CalibrationFile, presser, place_um, logs, shifts) -> str:
    """Describe a drift; the difference between two pressers is none."""
    before = pressers.reference(made, presser, place_um)
    if before is None:
        return f"first marks by {pressers.ONE[presser]}"
    return described(place_um, logs, shifts - before, made.plan)


def marks_of(
    made: file.CalibrationFile, path: Path, count: int, joint: bool, force_mN: float | None
) -> file.Marks:
    """Return the marks; SpotsError if there are not `count`, or if the force is invalid."""
    marks = made.joint_marks if joint else made.marks
    if marks is None:
        again = "run 'spots calibrate joint' again" if joint else "calibrate again"
        raise FileError(
            f"{path} has no section [{'joint_' * joint}marks], which a re-zero needs: "
            f"{again} to make it",
            path,
        )
    if not _evenly(len(marks.place_um), count):
        raise FileError(
            f"{path} has {len(marks.place_um)} marks{' of a joint' * joint}, which cannot be "
            f"reduced to {count}: use --marks 3, or calibrate again to make more",
            path,
        )
    forces_mN = Calibration(made.lines).forces_mN
    low_mN, high_mN = forces_mN[0], forces_mN[-1]
    if force_mN is not None and not low_mN <= force_mN <= high_mN:
        raise SettingError(
            f"{force_mN / 1000:g} N is not a force of this calibration: press with a force from "
            f"{low_mN / 1000:.2g} to {high_mN / 1000:.2g} N, and give it with --force-N"
        )
    return marks


def _evenly(known: int, count: int) -> list[int]:
    """Return which of the known marks are `count` at equal distances; empty if none are."""
    if count == 1:
        return [known // 2]
    step, rest = divmod(known - 1, count - 1)
    return [] if rest or not step else list(range(0, known, step))


def use(bench: Bench, made: file.CalibrationFile, new: file.CalibrationFile) -> str:
    """Write a corrected calibration to the file and to the board; return its checksum.

    SpotsError if the file or the board cannot be written. The calibration `made` from before the
    re-zero is then restored in both; if the board does not answer, the message says that it can
    have either calibration.
    """
    file.save(new, bench.path, made)
    try:
        return file.send(bench.reader.board, new)
    except BaseException:
        file.save(made, bench.path, new)
        try:
            file.send(bench.reader.board, made)
        except SpotsError as error:
            raise CalibrationError(
                f"{bench.path} has the calibration before the re-zero again, but the board can "
                f"have either one ({error}): reconnect the board, and start the re-zero again"
            ) from None
        raise


@contextmanager
def _without_keys(board: Board) -> Iterator[None]:
    """Keep a board that is a keyboard from typing while a person presses its marks."""
    if not board.command("hello")["keys"]:
        yield
        return
    board.command("set keys=0")
    try:
        yield
    finally:
        with suppress(SpotsError):  # a lost board starts with its stored setting
            board.command("set keys=1")


def _temperature_C(bench: Bench) -> float | None:
    """Return the temperature of the board, or None if the board cannot measure it."""
    mC = bench.reader.board.command("get").get("temperature_mC")
    return None if mC is None else mC / 1000


def _mean(before: float | None, after: float | None) -> float | None:
    return None if before is None or after is None else round((before + after) / 2, 3)


def _check_light(off: np.ndarray, place_um, force_mN: float) -> None:
    """Raise an error if presses with a known force gave far more or less light than expected.

    `off` is log2 of the light divided by the expected light, for each mark at `place_um`.
    """
    worst = int(np.argmax(np.abs(off)))
    if abs(off[worst]) > _LIGHT_MAX:
        raise CalibrationError(
            f"the press at {place_um[worst] / 1000:.1f} mm gave {2 ** off[worst]:.2g} times the "
            f"light of {force_mN / 1000:g} N: check the scale and --force-N, or leave out "
            "--force-N; nothing was saved"
        )


def _straightened(place_um, logs: np.ndarray, shifts: np.ndarray) -> np.ndarray:
    """Return the shifts of three or more marks, corrected for presses that missed their mark.

    The arguments are those of `drift.described`. A drift of LED, filters or dye changes the colours
    as if each mark had moved. This apparent movement is a linear function of the mark's position,
    so deviations from a straight line are errors of the presses, or a dye that has changed at one
    place. With three marks they are removed; who presses more wants to measure this change.
    """
    slopes = polynomial.polyval(place_um, polynomial.polyder(polynomial.polyfit(place_um, logs, 2)))
    slopes = slopes.T - slopes.mean(axis=0)[:, None]
    off_um = (shifts * slopes).sum(axis=1) / (slopes**2).sum(axis=1)
    straight_um = polynomial.polyval(place_um, polynomial.polyfit(place_um, off_um, 1))
    errors_um = np.abs(straight_um - off_um)
    if errors_um.max() > _STRAY_UM:
        raise CalibrationError(
            f"the press at {place_um[np.argmax(errors_um)] / 1000:.1f} mm was "
            f"{errors_um.max() / 1000:.1f} mm away from its mark: draw the marks on the strip and "
            "start the re-zero again; nothing was saved"
        )
    if len(shifts) > 3:
        return shifts
    return shifts + (straight_um - off_um)[:, None] * slopes


class _Mark(Order):
    """Presses at a mark until `presses` of them agree; `shifts` are theirs, shape (presses, 6).

    A shift is a change of log2 of the counts. `wanted` is the press to ask for, and `shift` is a
    function that returns the shift for its counts. `marks` are all marks of the calibration, of
    which `count` are pressed; a press nearer to another one of these is repeated.
    """

    given_up = "nothing was saved"

    def __init__(self, bench: Bench, wanted: Wanted, shift, marks: file.Marks, count, presses):
        super().__init__(bench, None)
        logs, length_um = np.array(marks.logs), marks.place_um[-1] - marks.place_um[0]
        self._limit_um = _STRAY_SHARE * length_um / (count - 1)
        colour_per_um = (logs[-1] - logs[0]) / length_um
        self._colour_per_um = colour_per_um - colour_per_um.mean()
        self._wanted, self._shift, self._presses = wanted, shift, presses
        self.shifts = np.empty((0, logs.shape[1]))

    def __iter__(self) -> Iterator[Wanted]:
        guide, colour_per_um = self.bench.guide, self._colour_per_um
        for _ in range(self._presses + _STRAYS):
            yield self._wanted
            off_um = self.shifts @ colour_per_um / (colour_per_um @ colour_per_um)
            good = np.abs(off_um) <= self._limit_um
            if len(good) == self._presses:
                good &= np.abs(off_um - np.median(off_um)) <= _STRAY_UM
            if not good.all():
                guide.say(
                    f"{self._wanted}: a press is too far from its mark; press this mark again"
                )
                guide.skip(-int((~good).sum()))
                self.shifts = self.shifts[good]
            if len(self.shifts) == self._presses:
                return
        raise CalibrationError(
            f"the presses at the mark at {self._wanted.place_um / 1000:.1f} mm are more than "
            f"{_STRAY_UM / 1000:g} mm apart, or too far from the mark: draw the mark on the strip "
            "and start the re-zero again; nothing was saved"
        )

    def store(self, held: Held, read: Wanted) -> None:
        """Keep the shift of a press."""
        self.bench.guide.taken(read, held.reading)
        self.shifts = np.vstack([self.shifts, self._shift(held.reading.counts)])
