"""The strip of a board that a browser has chosen: editors and calibration change this strip."""

from spots.errors import SettingError
from spots.link.board import Board

from .request_queue import RequestQueue


class StripChoice(RequestQueue):
    """Handles requests of browsers to choose one strip of a board with several strips."""

    what = "the choice of a strip"

    def decode(self, body: bytes) -> int:
        """Return the number of a strip; raise a ValueError if the body is not one digit."""
        if len(body) != 1 or not body.isdigit():
            raise ValueError("the body must be the number of a strip, such as 1")
        return int(body)

    def _handle(self, board: Board, sensor: int) -> None:
        if sensor not in board.sensors:
            raise SettingError(f"the board has no strip {sensor}: reload this window")
        self.sensor = sensor
