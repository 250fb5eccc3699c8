"""The strip of a board that a browser has chosen: editors and calibration change this strip."""

from ..errors import SpotsError
from ..link.board import Board
from .orders import Orders


class StripChoice(Orders):
    """Chooses one strip of a board with several strips.

    Attributes
    ----------
    sensor : int
        Number of the chosen strip.
    """

    what = "the choice of a strip"

    def __init__(self):
        super().__init__("there is no board: plug one in")

    def decode(self, body: bytes) -> int:
        """Return the number of a strip; raise a ValueError if the body is not one digit."""
        if len(body) != 1 or not body.isdigit():
            raise ValueError("the body must be the number of a strip, such as 1")
        return int(body)

    def attend(self, board: Board) -> bool:
        """Handle all waiting requests; return whether another strip is chosen now."""
        self._attended = True
        before = self.sensor
        while asked := self._next():
            self._answer(asked[1], self._choose, board, asked[0])
        return self.sensor != before

    def _choose(self, board: Board, sensor: int) -> None:
        if sensor not in board.sensors:
            raise SpotsError(f"the board has no strip {sensor}: reload this window")
        self.sensor = sensor
