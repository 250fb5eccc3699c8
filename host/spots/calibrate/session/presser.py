"""Asks a person to press the strip during a session; subclasses can ask a machine instead."""

from __future__ import annotations

from msgspec.structs import replace

from ...errors import SettingError, SpotsError
from ...link.board import Board
from ..calibration_file import FINGER, INDENTER
from ..calibration_file import Presser as Kind
from ..fit.points import Wanted
from ..fit.presses import FIRM_MN
from .dark import take_dark
from .dialog import PRESS, RELEASE, Dialog
from .spectra import SpectrumReader
from .typed import FORCES, decimal, grams, typed

_ANGLE_MAX_DEG = 3600.0


class Presser:
    """A person who presses, with ruler and scale; a subclass for a machine overrides all methods.

    A request must lead to a steady press within `patience_s`. A valid press needs `steady`
    successive steady readings.
    """

    patience_s = 120.0
    steady = 3

    def __init__(self, guide: Dialog):
        self._guide = guide

    def stretch(self, strain_ppm: int, length_um: float) -> None:
        """Stretch the strip to a length, while nothing presses the strip.

        `length_um` is that of the stretched strip. Strain 0 relaxes the strip, which a person is
        not asked to do.
        """
        if strain_ppm:
            length = f"the strip to {length_um / 1000:.1f} mm ({strain_ppm / 10_000:g} %)"
            self._guide.ask(f"stretch {length}, do not touch it, then press Enter: ")

    def press(self, wanted: Wanted) -> None:
        """Begin a press at the position and with the force of `wanted`."""
        if wanted.kind == "mark" and wanted.angle_deg is not None:
            text = f"turn the joint upwards to {wanted.angle_deg:g} degrees and hold"
            self._guide.request(PRESS, text)
        elif wanted.kind == "mark" and not wanted.force_mN:
            place = f"{wanted.place_um / 1000:.1f} mm"
            self._guide.request(PRESS, f"press the mark at {place} with a firm finger and hold")
        elif wanted.kind in ("hand", "choose"):
            firm = "a firm finger" if wanted.kind == "hand" else "your hardest press"
            force = f"about {grams(wanted.force_mN)}" if wanted.force_mN else firm
            hold = f" for {wanted.hold_s:.0f} s: keep the force" if wanted.hold_s else ""
            place = f"{wanted.place_um / 1000:.1f} mm"
            self._guide.request(PRESS, f"press at {place} with {force} and hold{hold}")
        elif wanted.kind != "joint":
            self._guide.request(PRESS, f"press at {wanted} and hold")

    def change(self, wanted: Wanted) -> None:
        """Change the force of a press to the second force of `wanted`, without a release."""
        text = f"without lifting, go to about {grams(wanted.then_mN)} and hold"
        self._guide.request(PRESS, text)

    def release(self) -> None:
        """End the press that `press` began."""
        self._guide.request(RELEASE, "release")

    def read_off(self, wanted: Wanted, length_um: float) -> Wanted | None:
        """Ask for the true place and force of a press by hand, as ruler and scale showed them.

        If the force of `wanted` is 0, the question is only for the place. None to repeat the press.
        A press of another kind is where the session asked for it.
        """
        if wanted.kind != "hand":
            return wanted
        default, what = f"{wanted.place_um / 1000:.1f} mm", "does the ruler show"
        if wanted.force_mN:
            default = f"{default} {wanted.force_mN / FORCES['g']:.0f} g"
            what = "do ruler and scale show"
        if wanted.then_mN:
            what += " at the first force"
        read = self._read(what, default, length_um, wanted.force_mN)
        if read is None:
            return None
        place_um, force_mN = read
        then_mN = wanted.then_mN
        if then_mN:
            default = f"{then_mN / FORCES['g']:.0f} g"
            what = "does the scale show at the second force"
            read = self._read(what, default, length_um, then_mN, force_only=True)
            if read is None:
                return None
            then_mN = read[1] or then_mN
        return replace(
            wanted,
            place_um=min(wanted.place_um if place_um is None else place_um, length_um),
            force_mN=force_mN or wanted.force_mN,
            then_mN=then_mN,
        )

    def _read(
        self,
        what: str,
        default: str,
        length_um: float,
        wanted_mN: float,
        force_only: bool = False,
    ):
        """Ask for position and force until the answer is valid; return them as `typed` does.

        The question is ``what {what}?``. It shows `default`, the answer that the Enter key gives.
        `wanted_mN` is the requested force in mN. `force_only` refuses a position. Returns None if
        the person wants to repeat the press.
        """
        while True:
            answer = self._guide.ask(f"what {what}? (Enter: {default}; again; undo) ")
            if answer.lower() == "again":
                return None
            try:
                read = typed(answer, length_um, wanted_mN or FIRM_MN)
                if force_only and read[0] is not None:
                    raise SettingError(f"'{answer}' has a position: type only the force")
                return read
            except SpotsError as error:
                self._guide.say(str(error))

    def next_presser(self) -> Kind | None:
        """Return what will press the strip after a session with an indenter.

        None if a finger will, but does not press the marks now.
        """
        offered = {"": FINGER, "now": FINGER, "indenter": INDENTER, "later": None}
        while True:
            answer = self._guide.ask(
                "draw marks at 10, 50 and 90 % of the strip, and press them with the finger that "
                "will use it (Enter: now; later; indenter) "
            ).lower()
            if answer in offered:
                return offered[answer]
            self._guide.say(
                f"'{answer}': press Enter for a finger, or type 'later', or 'indenter' if an "
                "indenter or a joint will use the strip"
            )

    def dark(self, board: Board) -> None:
        """Ask the person to unplug an LED that is always on, then take the dark frame."""
        take_dark(board, self._guide.ask)

    def least_mN(self, wanted: Wanted, reader: SpectrumReader) -> float:
        """Find the least force that gives light in every channel at a position.

        A machine presses at most with the force of `wanted`, and reads the channels.
        """
        # The limits reject a force that was typed in grams, and a strip that needs more than the
        # force of a firm press.
        return 1000 * self._number(
            f"press at {wanted.place_um / 1000:.1f} mm with the least force that lights every "
            "channel; what does the scale show, in N? ",
            0.01,
            FIRM_MN / 1000,
        )

    def turn(self, direction: int, share: float) -> Wanted:
        """Turn the joint to its next angle; return a press of kind ``joint`` with this angle.

        `direction` is 1 up, -1 down; `share` is that of the joint's travel. A person may turn the
        joint to another angle.
        """
        way = "up" if direction > 0 else "down"
        angle = self._number(
            f"turn the joint {way} to its next angle and hold; what is the angle, in degrees? ",
            -_ANGLE_MAX_DEG,
            _ANGLE_MAX_DEG,
        )
        return Wanted(kind="joint", place_um=0, force_mN=0, angle_deg=angle, direction=direction)

    def _number(self, question: str, lowest: float, highest: float) -> float:
        """Ask `question` until the answer is a number from `lowest` to `highest`.

        A decimal comma is valid.
        """
        while True:
            answer = self._guide.ask(question)
            try:
                if lowest <= (value := decimal(answer)) <= highest:
                    return value
                trouble = f"'{answer}' is not valid"
            except SpotsError as error:
                trouble = str(error)
            self._guide.say(f"{trouble}: type a number from {lowest:g} to {highest:g}")
