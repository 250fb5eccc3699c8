"""Calibration sessions in the web UI: a person presses the strip, and answers in a browser."""

from argparse import Namespace
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Literal

import msgspec
import numpy as np

from spots.calibrate import calibration_file
from spots.calibrate.fit.points import Wanted
from spots.calibrate.session.bench import Bench
from spots.calibrate.session.dialog import Progress, UndoError
from spots.calibrate.session.presser import Presser
from spots.calibrate.session.rezero import rezero, use
from spots.calibrate.session.session_file import Session, settings
from spots.calibrate.session.spectra import Reading, SpectrumReader
from spots.calibrate.session.steps import COUNTS, LENGTH_UM, calibrate
from spots.common.atomic import check_writable
from spots.errors import FileError, SpotsError, StateError, printable
from spots.link.board import Board

from .one_strip import OneStrip
from .request_queue import RequestQueue
from .state import PageState

_SAID = 4  # number of messages that are shown
_PASSING = "touch nothing"  # end of a message that is shown only during its step
_PLACES_MIN = 3  # positions needed to know how the colour changes along the strip
_ALONG = "hand", "position", "force", "mark"  # kinds of presses that show this change
_MORE = 6  # presses to add if a finished session is continued
ASK, WORK, END = "ask", "work", "end"  # further phases of a session, for the web UI
REZERO = "rezero"  # kind of a session that corrects the drift of a calibration
_STOPPED = "stopped: the presses are stored, and the same session can be continued"
_UNCHANGED = "stopped: nothing was saved"  # for a re-zero
_BEHIND = "the request is for an earlier step: follow the step that the web UI shows"
_RUNNING = "a session is running already: stop it before you start another one"


class Start(msgspec.Struct, tag_field="do", tag="start", forbid_unknown_fields=True):
    """Request of a browser: start or continue a session with a strip of length `length_mm`.

    `kind` is ``rough`` (with a fingertip and a ruler), ``fine`` (with an indenter, a ruler and a
    scale) or ``rezero`` (corrects the drift of a calibration). `length_mm` is not used for
    ``rezero``, because the calibration contains the length.
    """

    kind: Literal["rough", "fine", "rezero"]
    length_mm: Annotated[float, msgspec.Meta(ge=1, le=1000)]


class Answer(msgspec.Struct, tag_field="do", tag="answer", forbid_unknown_fields=True):
    """Request of a browser: answer the question of step `step`.

    Each question, press and release of a session is a step; steps are numbered.
    """

    step: int
    text: Annotated[str, msgspec.Meta(max_length=40)]


class Undo(msgspec.Struct, tag_field="do", tag="undo", forbid_unknown_fields=True):
    """Request of a browser: drop the last press, if the session is still at step `step`."""

    step: int


class Cancel(msgspec.Struct, tag_field="do", tag="cancel", forbid_unknown_fields=True):
    """Request of a browser: end the session. The presses stay in the session file."""


class PageCalibration(RequestQueue):
    """Runs calibration sessions for browsers, one at a time, in the thread that reads the board.

    `path` is the session file of strip 0. The calibration file has the same name with the suffix
    ``.toml``. File names of any other strip contain its number, such as ``-1``, before the suffix.
    A session sets the parts ``calibration``, ``hold`` and ``spectrum`` of the state. FileError if
    `path` is not the name of a file, the session file is damaged, or one of the two files could not
    be written or is of another kind.
    """

    what = "a session"
    nobody = "there is no board to calibrate: plug one in"
    requests = Start | Answer | Undo | Cancel

    def __init__(self, path: Path, state: PageState):
        if not path.name:
            raise FileError(
                f"{path} is not a session file: give a name such as calibration.jsonl", path
            )
        check_writable(path, append=True)
        check_writable(path.with_suffix(".toml"))
        super().__init__()
        self._first, self._state = path, state
        self._step = 0
        self._shown = {"running": False}
        self._use(path)

    def _use(self, path: Path) -> None:
        self._path, self._out = path, path.with_suffix(".toml")
        calibration_file.KIND.check(self._out)  # raises an error for a file of another kind
        self._show(file=self._out.name, rezero=self._out.exists(), length_um=LENGTH_UM)
        self._session = Session(path)
        if self._session.length_um:
            self._show(length_um=self._session.length_um)

    def attend(self, board: Board | OneStrip) -> bool:
        """Run a session to its end if a browser has requested one; return whether a session ran."""
        path = self._first
        if isinstance(board, OneStrip) and board.sensor:
            path = path.with_stem(f"{path.stem}-{board.sensor}")
        if path != self._path:
            with suppress(SpotsError):  # the next session reports a damaged file
                self._use(path)
        while asked := self._next():
            request, answer = asked
            if isinstance(request, Start):
                answer.set_result(None)
                self._run(board, request)
                return True
            answer.set_exception(StateError("no session runs: start one"))
        return False

    def _run(self, board: Board | OneStrip, start: Start) -> None:
        self._restarts, self._board, self._live = board.stats.restarts, board, board.spectra()
        self._show(
            running=True, kind=start.kind, length_um=1000 * start.length_mm, phase=WORK, title="",
            done=0, total=0, at=None, todo=None, note=None, said=[], fitted=None, end=None,
        )  # fmt: skip
        ended: Future = Future()
        if start.kind == REZERO:
            self._answer(ended, self._rezero)
        else:
            self._answer(ended, self._calibrate, start)
        error = ended.exception()
        why = error and str(error)
        end = "done" if error is None else "stopped" if why == self._stopped else "failed"
        self._live.close()
        self._state.put("hold", None)
        end_of = {"phase": END, "end": end, "note": why, "rezero": self._out.exists()}
        self._show(running=False, at=None, todo=None, **end_of)

    @property
    def _stopped(self) -> str:
        return _UNCHANGED if self._shown["kind"] == REZERO else _STOPPED

    def _rezero(self) -> None:
        made = calibration_file.load(self._out)
        with SpectrumReader(self._board) as reader:
            bench = Bench(reader, Presser(self), self, made.length_um, self._out)
            new = rezero(bench, made)
            reader.restore()
            use(bench, made, new)
            self.say(f"the drift was: {new.rezeros[-1].drift}")

    def _calibrate(self, start: Start) -> None:
        self._session = Session(self._path)
        board, made = self._board, self._session.conditions
        # A board that was unplugged has lost settings that were not saved.
        if made is not None and made.board == board.info["id"]:
            board.command("set " + settings(made))
        with SpectrumReader(board) as reader:
            bench = Bench(reader, Presser(self), self, 1000 * start.length_mm, self._out)
            options = Namespace(channels=None, keep_settings=False)
            taken, usual = len(self._session.of("hand")), COUNTS[start.kind][0]
            count = usual if taken < usual else taken + _MORE
            calibrate(bench, self._session, start.kind, count, None, options)

    # The dialog of the session, see `calibrate.session.dialog.Dialog`.

    def begin(self, title: str, total: int, plan: tuple[str, ...], length_um: float) -> None:
        """Show the title of a series of presses and their number, see `Dialog.begin`."""
        self._plan = plan
        self._show(title=title, done=0, total=total, length_um=length_um, phase=WORK, note=None)

    def skip(self, count: int = 1) -> None:
        """Add `count` to the displayed number of presses taken; a negative number subtracts."""
        self._show(done=self._shown["done"] + count)

    def want(self, wanted: Wanted) -> None:
        """Show where to press next."""
        self._show(at={"place_um": wanted.place_um, "force_mN": wanted.force_mN})

    def request(self, phase: str, text: str) -> None:
        """Show a request to press or to release the strip, see `Dialog.request`."""
        self._step += 1
        self._state.put("hold", None)
        note = self._shown["note"]
        if note and note.endswith(_PASSING):
            note = None
        self._show(phase=phase, step=self._step, todo=printable(text), note=note)

    def watch(self, reading: Reading, trouble: str | None, steady: float) -> None:
        """Show a reading of a press, see `Dialog.watch`; handle the requests of browsers."""
        place_um = self._place_um(reading.counts)
        self._state.put("hold", {"trouble": trouble, "steady": steady, "place_um": place_um})
        if self._board.stats.restarts != self._restarts:
            rezero = self._shown["kind"] == REZERO
            kept = "nothing was saved" if rezero else "the stored presses are kept"
            raise StateError(f"the board has restarted: start again; {kept}")
        self._listen()

    def taken(self, wanted: Wanted, reading: Reading) -> None:
        """Show that one more press was taken, see `Dialog.taken`."""
        self._show(done=self._shown["done"] + 1, phase=WORK, note=None)

    def fitted(self, progress: Progress) -> None:
        """Show the errors of all presses, and those expected for later presses, see `Progress`."""
        rows = np.column_stack(
            (progress.place_um, progress.force_mN, progress.off_um, progress.off_share)
        )
        sigmas = {"sigma_um": progress.sigma_um, "sigma_share": progress.sigma_share}
        fitted = {"presses": rows.tolist(), "thin": progress.thin, **sigmas}
        self._show(fitted=fitted, done=progress.done, total=progress.total)

    def say(self, text: str) -> None:
        """Show a message to the person."""
        text = printable(text)
        kept = [] if text.endswith(_PASSING) else [text]
        self._show(note=text, said=[*self._shown["said"], *kept][-_SAID:])

    def ask(
        self, question: str, place_um: float | None = None, force_mN: float | None = None
    ) -> str:
        """Show a question, and wait for the answer of a browser; see `Dialog.ask`."""
        self._step += 1
        self._show(phase=ASK, step=self._step, todo=printable(question))
        while (text := self._listen()) is None:
            self._live.wait()
        self._show(phase=WORK)
        return text

    def _listen(self) -> str | None:
        """Show the newest spectrum, and handle one request; return the text of an `Answer`.

        Return None if there is no request, or if the request is refused.
        """
        while self._live.unread:
            counts = next(self._live).counts
            if not self._live.unread:
                self._state.put("spectrum", {"counts": counts})
        if self.stopping:
            raise StateError(self._stopped)
        asked = self._next()
        if asked is None:
            return None
        request, answer = asked
        if isinstance(request, Start):
            answer.set_exception(StateError(_RUNNING))
            return None
        behind = not isinstance(request, Cancel) and request.step != self._step
        if behind or (isinstance(request, Answer) and self._shown["phase"] != ASK):
            answer.set_exception(StateError(_BEHIND))
            return None
        if isinstance(request, Undo) and self._shown["kind"] == REZERO:
            answer.set_exception(StateError("a re-zero stores no press: stop it and start again"))
            return None
        answer.set_result(None)
        if isinstance(request, Undo):
            raise UndoError
        if isinstance(request, Cancel):
            raise StateError(self._stopped)
        return request.text

    def _place_um(self, counts: np.ndarray) -> float | None:
        """Estimate the position of a press in um from earlier presses; None if impossible."""
        known = [p for p in self._session.points if p.plan == self._plan and p.kind in _ALONG]
        known.sort(key=lambda p: p.place_um)
        if len({p.place_um for p in known}) < _PLACES_MIN or (counts < 1).any():
            return None
        logs = np.log2(np.maximum([p.counts for p in known], 1))
        way = logs[-1] - logs[0]
        way -= way.mean()  # removes the brightness
        colours = logs @ way
        order = np.argsort(colours)
        places_um = np.array([p.place_um for p in known])
        return float(np.interp(np.log2(counts) @ way, colours[order], places_um[order]))

    def _show(self, **parts) -> None:
        self._shown = {**self._shown, **parts}
        self._state.put("calibration", self._shown)
