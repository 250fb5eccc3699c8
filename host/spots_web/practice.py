"""Practice of calibration sessions in the web UI, with a simulated strip; no file is written."""

from argparse import Namespace
from contextlib import ExitStack

from spots.calibrate.session.practice import practise
from spots.common import atomic
from spots.errors import SettingError

from .calibration import PageCalibration, Start
from .state import PageState


class PagePractice(PageCalibration):
    """Runs practice sessions for browsers, see `calibrate.session.practice`."""

    def __init__(self, options: Namespace, state: PageState):
        self._folder = ExitStack()
        folder = self._folder.enter_context(atomic.temporary())
        super().__init__(folder / "practice.jsonl", state)
        self._options = Namespace(**{**vars(options), "channels": None, "keep_settings": False})
        self._show(practice=True, ruler=None)

    @property
    def _stopped(self) -> str:
        return "stopped: practice stores no presses"

    def _rezero(self) -> None:
        raise SettingError(
            "practice has no re-zero: start 'spots serve --session' with a real board"
        )

    def _calibrate(self, start: Start) -> None:
        self._options.length_mm = start.length_mm
        practise(self._options, start.kind, 0, self)

    def ask(
        self, question: str, place_um: float | None = None, force_mN: float | None = None
    ) -> str:
        self._show(ruler={"place_um": place_um, "force_mN": force_mN})
        try:
            return super().ask(question)
        finally:
            self._show(ruler=None)
