"""Draws the pictures of the demos, from runs in simulated time, and the wiring of each board."""

from __future__ import annotations

import io
import math
from pathlib import Path
from string import Template
from typing import NamedTuple

from make import moving
from rich.console import Console

from spots.advice.calibrated import hello_calibrated
from spots.common import atomic
from spots.controller import controller as play
from spots.controller.controller_settings import load as load_controller
from spots.deploy.staging import board_names, device_of
from spots.keyboard import timing_picture
from spots.keyboard.key_engine import KeyEngine
from spots.keyboard.keys import push
from spots.keyboard.layout import load as load_layout
from spots.link.frames import Spectrum, Touch
from spots.terminal.view import StripView
from spots.wearable import wearable_view
from spots.wearable.gestures import Gestures
from spots.wearable.wearable import Mapping
from spots_device.board.light import LEDS
from spots_linkage import Linkage, Twin
from spots_linkage.twin_view import TwinView
from spots_make.drawing import SVG
from spots_sim.demo import typing_view
from spots_sim.demo.demo import open_fast
from spots_sim.demo.demo_applications import NoGamepad
from spots_sim.measure.score import Score
from spots_sim.measure.simulated_linkage import START_S, Simulation
from spots_sim.person.mechanism import guided
from spots_sim.person.typist import TypedText
from spots_sim.strip.files import (
    LinkageFile,
    PathFile,
    ScenarioFile,
    SensorFile,
    load,
)
from spots_sim.strip.scenario import Scenario

_TEMPLATES = Path(__file__).parent
_PICTURES = _TEMPLATES.parent / "pictures"


class Wire(NamedTuple):
    """Route of a wire in the wiring picture; all coordinates are in SVG units.

    Attributes
    ----------
    colour : str
        Colour in SVG notation.
    breakout_y : int
        y at the breakout.
    lane_x : int
        x of the wire's vertical part between board and breakout.
    left_x, below_y : int
        x and y of the route around the lower left corner of the board.
    """

    colour: str
    breakout_y: int
    lane_x: int
    left_x: int
    below_y: int


_WIRES = {
    "ground": Wire("#222222", 110, 270, 12, 406),
    "power": Wire("#d00000", 160, 300, 18, 399),
    "sda": Wire("#0057d9", 270, 360, 28, 388),
    "scl": Wire("#e0a800", 320, 330, 40, 376),
}

# Moments of the pictures, in seconds of each scenario.
MOVING_S = 10.0  # demo: all of its presses
_STEP_S = 0.1
MOMENT_S = 4.0  # demo: a finger slides back towards the sensor
HARD_S = 6.5  # demo: a finger presses hard
WORN_S = 24.6  # worn: a finger slides on the strip
WROTE_S = 10.0  # sust: the linkage writes its last letter but one
# Text at the moment of the keyboard's picture.
TYPED = "hello strip, ty"


def main() -> None:
    """Draw the pictures of the demos and the wirings, and print their paths."""
    applications = keyboard(), flavors(), controller(), wearable(), twin()
    for path in (strip(), demo(), *applications, *wirings()):
        print(path)


def wirings(folder: Path = _PICTURES) -> list[Path]:
    """Draw the wiring of every real board, for each wiring of the LED; return the files' paths.

    The names are wiring-BOARD.svg for an LED on the chip's pin LDR, and wiring-BOARD-LED.svg for
    the other values of `LEDS`.
    """
    template = _template("wiring")
    paths = []
    for device in map(device_of, board_names()):
        if "drawn" in device.wiring:
            drawn = device.wiring["drawn"]
            places = {name: (drawn[name], 1 / drawn["rows"]) for name in _WIRES}
            pins = [_pin(device.wiring[name], *place) for name, place in places.items()]
            wires = [_wire(_WIRES[name], *place) for name, place in places.items()]
            for led in LEDS:
                more = {"gpio": ("supply", "led"), "always": ("supply",)}.get(led, ())
                at = {f"{name}_path": _out(*drawn[name], drawn["rows"]) for name in more}
                ground_y = _height(drawn["ground"][1], 1 / drawn["rows"])
                at["ground_y"] = f"{max(ground_y, _WIRES['ground'].breakout_y):g}"
                more_pins = [
                    _pin(device.wiring[name], drawn[name], 1 / drawn["rows"]) for name in more
                ]
                text = template.substitute(
                    title=device.title,
                    pins="\n".join(pins + more_pins),
                    wires="\n".join(wires),
                    led=_template(f"wiring-{led}").substitute(at).rstrip(),
                )
                kind = "" if led == "ldr" else f"-{led}"
                paths.append(folder / f"wiring-{device.name}{kind}.svg")
                atomic.write_text(text, paths[-1], SVG)
    return paths


def _template(name: str) -> Template:
    return Template((_TEMPLATES / f"{name}.svg.in").read_text(encoding="utf-8"))


def _height(row: int, pitch: float) -> float:
    return 60 + 300 * (row - 0.5) * pitch


def _pin(label: str, drawn: tuple[str, int], pitch: float) -> str:
    side, row = drawn
    y = _height(row, pitch)
    x, text_x, anchor = (60, 72, "start") if side == "left" else (230, 218, "end")
    return (
        f'  <circle cx="{x}" cy="{y:g}" r="6" fill="#ffd966" stroke="#7a5c00"/>\n'
        f'  <text x="{text_x}" y="{y + 4:g}" text-anchor="{anchor}" fill="#fff" font-size="12">'
        f"{label}</text>"
    )


def _out(side: str, row: int, rows: int) -> str:
    """Return the start of an SVG path, from a pin to the margin of the board.

    `side` is ``left`` or ``right``; `row` counts the board's `rows` rows of pins from 1.
    """
    y = _height(row, 1 / rows)
    return f"M53 {y:g} H16" if side == "left" else f"M237 {y:g} H252"


def _wire(wire: Wire, drawn: tuple[str, int], pitch: float) -> str:
    side, row = drawn
    start = f"M237 {_height(row, pitch):g}"
    if side == "left":  # around the lower end of the board
        start = f"M53 {_height(row, pitch):g} H{wire.left_x} V{wire.below_y}"
    path = f"{start} H{wire.lane_x} V{wire.breakout_y} H423"
    return f'    <path d="{path}" stroke="{wire.colour}"/>'


def demo() -> Path:
    """Run the demo up to `MOMENT_S` and draw demo.svg; return its path."""
    truth = Scenario(load(ScenarioFile, "demo"))
    board, _ = open_fast("default", truth, seed=0)
    score = Score(truth, 0.0)
    with board:
        board.command("stream touch spectrum")
        view = StripView(board.command("hello"), board.port)
        for frame in board.frames():
            view.take(frame)
            if isinstance(frame, Touch):
                score.take(frame, board.now_s())
            if board.now_s() > MOMENT_S:
                break
        picture = view.picture(board.stats, score)
    return _drawn(picture, "demo.svg", "spots demo")


def strip() -> Path:
    """Run the demo for `MOVING_S` and draw strip.svg, which moves; return its path."""
    truth = Scenario(load(ScenarioFile, "demo"))
    board, _ = open_fast("default", truth, seed=0)
    frames: dict[type, dict[int, Touch | Spectrum]] = {Touch: {}, Spectrum: {}}
    with board:
        board.command("stream touch spectrum")
        length_mm = hello_calibrated(board)["length_um"] / 1000
        begin_s = math.ceil(board.now_s() / truth.file.seconds) * truth.file.seconds
        for frame in board.frames(begin_s + MOVING_S - board.now_s()):
            if type(frame) in frames and frame.time_s >= begin_s:
                frames[type(frame)][round((frame.time_s - begin_s) / _STEP_S)] = frame
    touches, spectra = frames[Touch], frames[Spectrum]
    dark = [min(counts) for counts in zip(*(one.counts for one in spectra.values()))]
    brightest = max(max(one.counts) for one in spectra.values())
    moments = []
    for number in range(round(MOVING_S / _STEP_S)):
        touch, spectrum = touches[number], spectra[number]
        fingers = truth.presses(touch.time_s)
        light = [((count - low) / brightest) ** 0.5 for count, low in zip(spectrum.counts, dark)]
        moments.append(
            moving.Moment(
                number * _STEP_S,
                fingers[0].position_mm if fingers else None,
                touch.position_um / 1000 if touch.trusted else None,
                touch.force_mN / 1000 if touch.trusted else 0.0,
                light,
            )
        )
    path = _PICTURES / "strip.svg"
    atomic.write_text(moving.picture(moments, length_mm), path, SVG)
    return path


def twin() -> Path:
    """Run a simulated linkage up to `WROTE_S` and draw linkage/twin.svg; return its path."""
    files = load(SensorFile, "default"), load(LinkageFile, "default")
    motion = guided(load(PathFile, "sust"), START_S)
    with Simulation(*files, motion, 0, 30_000) as simulation:
        mechanism = simulation.mechanism
        linkage = Linkage(mechanism.bar_mm, mechanism.base_mm)
        one = Twin(linkage, simulation.encoders())
        for terminal in one.follow(simulation.readings()):
            if terminal.time_s > WROTE_S:
                break
        stats = [board.stats for board in simulation.boards]
        view = TwinView(one, [board.port for board in simulation.boards])
        picture = view.picture(stats, WROTE_S)
    return _drawn(picture, "linkage/twin.svg", "spots twin --port virtual")


def controller() -> Path:
    """Run the controller up to `HARD_S` and draw controller.svg; return its path."""
    truth = Scenario(load(ScenarioFile, "demo"))
    board, _ = open_fast("default", truth, seed=0)
    settings = load_controller()
    with board, NoGamepad() as gamepad:
        made = play.controller_for(board, settings)
        view = play.ControllerView(board, made, settings)
        play.play(board, made, gamepad, HARD_S - board.now_s(), [view])
        picture = view.picture()
    return _drawn(picture, "controller.svg", "spots demo --use controller")


def keyboard() -> Path:
    """Run the keyboard until it has typed `TYPED` and draw keyboard.svg; return its path."""
    truth = Scenario(load(ScenarioFile, "typing"))
    layout = load_layout("mini")
    typed, touch = TypedText(), None
    board, _ = open_fast("default", truth, seed=0)
    with board:
        push(board, layout)
        info = hello_calibrated(board)
        engine = KeyEngine(layout, info["length_um"], typed, info["decay"])
        board.command("stream touch")
        for frame in board.frames():
            if isinstance(frame, Touch):
                touch = frame
                engine.take(frame, board.now_s())
            if typed.text == TYPED and touch.touching:
                break
        picture = typing_view.picture(layout, engine, touch, typed, board.stats)
    return _drawn(picture, "keyboard.svg", "spots demo --use keyboard")


def flavors() -> Path:
    """Draw when a key is a tap and when a hold, flavors.svg; return its path."""
    path = _PICTURES / "flavors.svg"
    atomic.write_text(timing_picture.document(), path, SVG)
    return path


def wearable() -> Path:
    """Run a strip on an arm up to `WORN_S` and draw wearable.svg; return its path."""
    truth = Scenario(load(ScenarioFile, "worn"))
    mapping, found, touch = Mapping(), [], None
    gestures = Gestures()
    board, _ = open_fast("default", truth, seed=0)
    with board:
        board.command("stream touch")
        for frame in board.frames(WORN_S - board.now_s()):
            if isinstance(frame, Touch):
                touch = frame
                found += gestures.take(frame, board.now_s())
        length_um = hello_calibrated(board)["length_um"]
        picture = wearable_view.picture(touch, length_um, found, mapping.names, board.stats)
    return _drawn(picture, "wearable.svg", "spots demo --use wearable")


def _drawn(picture, name: str, title: str) -> Path:
    console = Console(
        file=io.StringIO(), record=True, width=82, force_terminal=True, color_system="truecolor"
    )
    console.print(picture)
    path = _PICTURES / name
    atomic.write_text(console.export_svg(title=title), path, SVG)
    return path


if __name__ == "__main__":
    main()
