"""A strip as a volume knob: the command ``spots volume``, and a panel of the web UI."""

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path

from spots import Board, SpotsError, Touch
from spots.cli import arguments
from spots.cli.parser import Parser
from spots.common.signals import released_by_signals
from spots.outputs.open import open_keyboard
from spots.outputs.usages import chord_of
from spots.terminal.opening import open_announced

PURPOSE = "use a strip"  # title in the help of `spots`
STEP = 2  # percent that one press of a volume key changes


class Knob:
    """A volume in percent that a sliding finger changes by 1 % a millimetre."""

    def __init__(self):
        self.percent = 50.0
        self._last_mm: float | None = None

    def take(self, touch: Touch) -> float:
        """Process a reading, and return the new volume in percent."""
        place_mm = touch.position_um / 1000 if touch.trusted else None
        if place_mm is not None and self._last_mm is not None:
            self.percent = min(max(self.percent + place_mm - self._last_mm, 0.0), 100.0)
        self._last_mm = place_mm
        return self.percent


class VolumePanel:
    """Panel of the web UI. A browser with the token can set the volume."""

    title = "Volume"
    static = Path(__file__).with_name("static")

    def __init__(self, show: Callable[[dict[str, float]], None], options: Namespace):
        self._knob, self._show = Knob(), show

    def on_touch(self, touch: Touch) -> None:
        """Process a reading, and show the volume."""
        self._show({"percent": self._knob.take(touch)})

    def on_request(self, board: Board, request: object) -> None:
        """Set the volume that a browser requests, in percent."""
        if not isinstance(request, int) or request not in range(101):
            raise SpotsError("a volume is a number of percent from 0 to 100")
        self._knob.percent = float(request)


def volume(parser: Parser) -> Callable[[Namespace], None]:
    """Change the volume of this computer with a strip.

    example:
      spots volume --dry-run
    """
    arguments.add_port(parser)
    arguments.add_seconds(parser)
    parser.flag("--dry-run", "print the keys instead of pressing them")
    return _press_keys


def _press_keys(options: Namespace) -> None:
    knob, done = Knob(), Knob().percent
    with (
        released_by_signals(),
        open_announced(options) as board,
        open_keyboard(options.dry_run) as keyboard,
    ):
        for touch in board.touches(options.seconds):
            change = knob.take(touch) - done
            if abs(change) >= STEP:
                keyboard.click(*chord_of("VOLUME_UP" if change > 0 else "VOLUME_DOWN"))
                done += STEP if change > 0 else -STEP
