"""Measures calibrations by a simulated person, who knows only what a terminal or the web UI shows.

The person reads places to ±0.5 mm and forces to ±5 %. The person also omits or repeats presses,
lifts early, and mixes units. Prints one line of JSON for each strip and seed. For silicone with
creep and hysteresis, the line has the force errors without and with compensation, too. The exit
code is 1 if a session took too many presses, or a calibration has too large an error or a wrong key
in 100 taps.

With ``--exact`` the person reads exactly. The item ``ratio`` is then the position error of this
calibration, divided by that of a session on the linear stage (``spots calibrate position`` and
``force``).
"""

from __future__ import annotations

import argparse
import json
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from playwright.sync_api import sync_playwright

from spots.calibrate import calibration_file as file
from spots.calibrate.fit.decoded import Decoded
from spots.calibrate.pressers import used_by
from spots.calibrate.session.session_file import settings
from spots.keyboard.layout import load as load_layout
from spots.link.board import Board
from spots.link.connect import prepare
from spots_device.reading.calibration import Calibration
from spots_sim.board.lockstep import LockstepLink
from spots_sim.demo.demo_applications import type_on_board
from spots_sim.person.loading import record
from spots_sim.person.person import Habits, Person, follow
from spots_sim.person.stage import Stage
from spots_sim.person.typist import Typist
from spots_sim.strip.files import ScenarioFile, SensorFile, load
from spots_sim.strip.scenario import Held, Scenario

sys.path.insert(0, str(Path(__file__).parents[1]))

from support import person as web
from support.bring_browser import launch_options
from support.serving import Bench, Serving
from support.terminal_session import calibrate_in_terminal

_STRIPS = "default,short_30mm,long_200mm,weak_dye,strong_dye"
_EXACT = Habits(place_mm=0.0, force_share=0.0, decimals=3)
_RATIO_MAX = 1.15
_PRESSES_MAX, _ERROR_MAX_UM = {"rough": 12, "fine": 48}, {"rough": 1000.0, "fine": 150.0}
_SPEED = 8.0
_START_S, _SESSION_S = 300.0, 7200.0  # timeouts; that of the session is simulated time
_BLIND_S = 2.0  # longest simulated time between two looks at the web UI
_TAPS = 100
_LOADS = [(0.5, 9000.0, ramp_s, 0.0) for ramp_s in (0.5, 2.0, 8.0)]


class _Reader(web.Person):
    """Reads the texts of the web UI, and lets the simulated person act on them."""

    def __init__(self, page, held, length_mm, habits, seed):
        super().__init__(page, held, length_mm)
        self.person = Person(lambda way: follow(held, way), length_mm, habits, seed)

    def act(self, seen):
        asked = seen["todo"], seen["share"], seen["count"], seen["asks"]
        if asked == self._last:
            return
        self._last = asked
        text = seen["todo"][:1].lower() + seen["todo"][1:]
        if not seen["asks"]:
            self.person.hear(text)
            return
        form = self.page.locator("#calibration .answer")
        typed = dict.fromkeys(("Position in mm", "Force"), "")
        for word in self.person.answer(text).replace(" cm", "cm").replace(" N", "N").split():
            typed["Position in mm" if word.endswith("m") else "Force"] = word
        for name, word in typed.items():
            if word:
                form.get_by_label(name, exact=True).fill(word)
        form.locator(".main").click()


def _on_page(kind, strip, sensor, habits, seed, folder):
    held, path = Held(), folder / "calibration.jsonl"
    bench = Bench(sensor, None, held, session=path, speed=_SPEED)
    server = Serving(bench.state, queues=bench.queues)
    try:
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(**launch_options(playwright))
            page = browser.new_page(viewport={"width": 390, "height": 844})
            page.goto(server.url)
            reader = _Reader(page, held, sensor.length_mm, habits, seed)
            reader.wait(lambda seen: seen["starts"], timeout_s=_START_S)
            page.get_by_label("Length of the strip").fill(f"{sensor.length_mm:g}")
            reader.start(kind)
            reader.now_s = bench.link.now_s

            def looked():  # the board's time stops if the person does not look for `_BLIND_S`
                bench.link.pause_s = bench.link.now_s() + _BLIND_S

            reader.looked = looked
            seen = reader.go_on(timeout_s=_SESSION_S)
            browser.close()
    finally:
        if bench.link:
            bench.link.pause_s = math.inf
        server.stop()
        bench.close()
    assert seen["todo"] == "The board is calibrated", seen
    return reader.person.presses


def _in_terminal(kind, strip, sensor, habits, seed, folder):
    words = ["--rough"] * (kind == "rough") + ["--seed", str(seed), "--sensor", strip]
    person, code, text = calibrate_in_terminal(folder, words, sensor.length_mm, habits, seed)
    assert code == 0, text[-2000:]
    return person.presses


_FACES = {"page": _on_page, "terminal": _in_terminal}


def _on_stage(strip, seed, folder):
    """Return the calibration of a session with exact presses by the simulated linear stage."""
    for kind in ("position", "force"):
        command = [sys.executable, "-m", "spots", "calibrate", kind, "--port", "virtual"]
        command += ["--sensor", strip, "--seed", str(seed), "--session", "stage.jsonl"]
        subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return file.load(folder / "stage.toml")


def _error_um(sensor, seed, made) -> float:
    """Return the mean position error in um of readings at 37 positions, with a force of 3 N."""
    decode, found = Decoded(), []
    decode.calibration = Calibration(made.lines)
    with Stage(sensor, seed) as stage:
        stage.board.command("set " + settings(made.conditions))
        stage.take_dark()
        stage.reader.set_up(dark_s=2.5)
        stage.held.tremor = 0.02
        for place_um in np.linspace(0.05, 0.95, 37) * stage.length_um:
            stage.press(place_um, 3000.0)
            for row in stage.reader.samples(8)[0]:
                decode.update_mean(row)
                found.append(decode.position_um - place_um)
    return float(np.abs(found).mean())


def _loop_error_mN(sensor, lines) -> int:
    """Return the mean error in mN of forces from 0.5 to 9 N, while the force rises and falls."""
    _, force_mN, read_mN, *_ = record(sensor, lines, _LOADS)
    inside = (force_mN > 500) & (force_mN < 9000)
    return round(float(np.abs(read_mN - force_mN)[inside].mean()))


def _right(sensor, seed, made) -> int:
    """Return the number of right keys in 100 taps on ten keys, minus wrong and additional keys."""
    layout = load_layout("digits")
    typist = Typist(layout, sensor.length_mm, np.random.default_rng(seed), start_s=8.0)
    typist.type("".join(map(str, np.random.default_rng((seed, 1)).integers(0, 10, _TAPS))))
    truth = Scenario(ScenarioFile(seconds=typist.seconds + 5, touch=typist.touches))
    with Board(LockstepLink(sensor, truth, seed)) as board:
        board.command("set " + settings(made.conditions))
        prepare(board, made.lines)
        score = type_on_board(board, truth, 0.0, typist.seconds + 3, True, "digits")
    return score["right"] - score["wrong"] - score["extra"]


def main() -> int:
    """Run the sessions; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("kind", choices=_PRESSES_MAX)
    parser.add_argument("--face", choices=_FACES, default="page")
    parser.add_argument("--strips", default=_STRIPS, help=f"sensor files ({_STRIPS})")
    parser.add_argument("--seeds", default="1", help="random seeds, such as 1,2,3 (1)")
    parser.add_argument("--exact", action="store_true", help="a person who reads exactly")
    options = parser.parse_args()
    habits = _EXACT if options.exact else Habits()
    good = True
    for seed in map(int, options.seeds.split(",")):
        for strip in options.strips.split(","):
            sensor = load(SensorFile, strip).unchanged()
            with tempfile.TemporaryDirectory() as folder:
                run = _FACES[options.face]
                presses = run(options.kind, strip, sensor, habits, seed, Path(folder))
                made = file.load(Path(folder) / "calibration.toml")
                made = used_by(made, made.presser)  # the readings below are of the same presser
                staged = _on_stage(strip, seed, Path(folder)) if options.exact else None
            found = {"strip": strip, "seed": seed, "presses": presses}
            found["error_um"] = round(_error_um(sensor, seed, made), 1)
            found["right"] = _right(sensor, seed, made)
            if options.kind == "fine" and not sensor.silicone.ideal:
                plain = [line for line in made.lines if not line.startswith("silicone")]
                found["loop_mN"] = [_loop_error_mN(sensor, one) for one in (plain, made.lines)]
            if staged:
                found["ratio"] = round(found["error_um"] / _error_um(sensor, seed, staged), 3)
            ok = (
                presses <= _PRESSES_MAX[options.kind]
                and found["error_um"] <= _ERROR_MAX_UM[options.kind]
                and found["right"] == _TAPS
                and found.get("ratio", 0.0) <= _RATIO_MAX
            )
            print(json.dumps(found | {"ok": ok}), flush=True)
            good = good and ok
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
