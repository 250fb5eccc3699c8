"""A calibration by hand of a simulated person at a plain terminal."""

import argparse
import io

import numpy as np
from rich.console import Console

from spots.calibrate import calibration_file as file
from spots.calibrate.fit.decoded import Decoded
from spots.calibrate.session import steps
from spots.calibrate.session.bench import Bench
from spots.calibrate.session.guide import Guide
from spots.calibrate.session.presser import Presser
from spots.calibrate.session.session_file import Session
from spots_device.reading.calibration import Calibration
from spots_sim.person.person import Person, follow

PLAN = "F3,F4,F5,F6,F7,F8"


# A third of the samples of 10 ms, for tests of what a session says.
LONG = "exposure_us=30000"


PATIENCE_S = 25.0  # timeout of a press; longer than the delays of the simulated person


class Room(io.StringIO):
    """A simulated person at a plain terminal, who presses the strip of a simulated board."""

    def __init__(self, stage, habits, seed=1):
        super().__init__()
        self.stage = stage
        self.person = Person(self.move, stage.length_um / 1000, habits, seed)
        self.question, self.answers, self.asked = "", [], []

    def move(self, way):
        follow(self.stage.held, way)

    def write(self, text):
        self.question = text.strip() or self.question
        for line in text.splitlines():
            self.person.hear(line)
        return super().write(text)

    def readline(self):
        if "draw marks" in self.question:
            return "later\n"  # only the presses of the indenter count
        answer = self.person.answer(self.question)
        self.asked.append((self.question, answer))
        return ((self.answers.pop(0) if self.answers else "") or answer) + "\n"


def calibrate(room, path, kind, count, plan=PLAN):
    shown = Guide(Console(file=room, width=200), stdin=room)
    stage, presser = room.stage, Presser(shown)
    presser.patience_s = PATIENCE_S
    bench = Bench(stage.reader, presser, shown, stage.length_um, path.with_suffix(".toml"))
    options = argparse.Namespace(channels=plan, keep_settings=False)
    steps.calibrate(bench, Session(path), kind, count, None, options)
    room.move([])
    return file.load(path.with_suffix(".toml"))


def errors_um(stage, made):
    """Return the position errors in um of readings at 13 positions, with a force of 3 N."""
    decode = Decoded()
    decode.calibration = Calibration(made.lines)
    del stage.held.presses
    found = []
    for place_um in np.linspace(0.05, 0.95, 13) * stage.length_um:
        stage.press(place_um, 3000.0)
        decode.update_mean(stage.reader.read(16).counts)
        found.append(decode.position_um - place_um)
    return np.array(found)
