"""Fixtures: a board with a radio, in the air with hosts on Bumble, all in simulated time."""

import pytest
from support.boards import store

from radio_air import Air
from radio_hosts import Host
from spots.keyboard.layout import load as load_layout
from spots.link.board import Board
from spots_sim.board.lockstep import LockstepLink
from spots_sim.person.stage import calibrate
from spots_sim.strip.files import SensorFile, load
from spots_sim.strip.scenario import Held, Press

SENSOR = load(SensorFile, "default")
KEY_MM = 8.5  # width of a key of the layout `digits`


class Rig:
    """A board whose settings have ``radio`` and ``keys``, in `air`; `board` is its USB port."""

    def __init__(self, folder, radio="both"):
        store(
            folder,
            calibration=calibrate(SENSOR),
            layout=load_layout("digits").lines,
            settings=[f"radio={radio}", "keys=1"],
        )
        self.air, self.held = Air(), Held()
        self.link = LockstepLink(SENSOR, self.held, folder=folder, air=self.air)
        self.board = Board(self.link)
        self.run(0.5)

    def run(self, seconds):
        end_s = self.link.now_s() + seconds
        while self.link.now_s() < end_s:
            self.step()

    def step(self):
        self.link.run_once()

    def press(self, key):
        """Press key number `key` of the strip, from 0, and leave it pressed."""
        self.held.press = Press((key + 0.5) * KEY_MM, 2000, 4.0)
        self.run(0.1)

    def lift(self):
        self.held.press = None
        self.run(0.1)

    def tap(self, key):
        self.press(key)
        self.lift()

    def received(self):
        """Return the bytes that the board has sent by USB since the last call."""
        return self.link.read(0)

    def host(self, **options):
        return Host(self.air, self.step, **options)

    def bonded(self, **options):
        """Return a new host that has paired with the board, and uses all that it offers."""
        host = self.host(**options)
        host.connect()
        host.pair(self.passkey())
        host.use()
        return host

    def passkey(self):
        """Open the window for a new bond; return the passkey."""
        return int(self.board.command("radio pair")["passkey"])

    def close(self):
        self.board.close()
        self.air.close()


@pytest.fixture
def rig(tmp_path):
    made = Rig(tmp_path)
    yield made
    made.close()
