"""Wrong arguments of the public functions are a SpotsError, which names what is allowed."""

import math
import time
from pathlib import Path

import pytest
from support.refusals import refusal

import spots
import spots_linkage
import spots_sim
from spots.calibrate import calibration_file
from spots.errors import SettingError
from spots.recording.export import export
from spots.recording.writer import Writer
from spots_linkage import twin_source

DATA = Path(__file__).parents[1] / "data"
RUN, JOINT = DATA / "run.spots", DATA / "joint.toml"


def arm():
    return spots_linkage.Linkage(100, 80)


CALLS = {
    "port 5": (lambda: spots.open(5), "a port must be a text or a pathlib.Path, not 5"),
    "bytes": (lambda: spots.open(b"virtual"), "a port must be a text"),
    "sensor": (lambda: spots_sim.open(sensor=5), "the name of a sensor file must be a text"),
    "scenario": (lambda: spots_sim.open(scenario=None), "name of a scenario file must be"),
    "seed": (lambda: spots_sim.open(seed="x"), "the seed must be a whole number of 0 or"),
    "decimal seed": (lambda: spots_sim.open(seed=1.5), "the seed must be a whole number"),
    "recording": (lambda: spots.Recording(5), "the path of a recording must be a text"),
    "blocks": (lambda: spots.RecordingBlocks(None), "the path of a recording must be a text"),
    "arrays": (lambda: spots.read_arrays([]), r"a recording must be .* not \[\]"),
    "replay": (lambda: spots.open_recording(5), "the path of a recording must be a text"),
    "speed": (lambda: spots.open_recording(RUN, "x"), "speed of a recording must be more than 0"),
    "no speed": (lambda: spots.open_recording(RUN, None), "must be more than 0, not None"),
    "no port": (lambda: spots.open(""), "a port must be a name, not ''"),
    "no name": (lambda: spots.open_recording(""), "path of a recording must be a name, not ''"),
    "zero": (lambda: spots.read_arrays("a\0b"), r"a recording must be a name, not 'a\\x00b'"),
    "linkage": (lambda: twin_source.opened(5).__enter__(), "path of a linkage file must be a text"),
    "calibration": (lambda: calibration_file.load(None), "the path of a file must be a text"),
    "format": (
        lambda: export(RUN, "xls"),
        "there is no format 'xls': valid names are mcap, csv, npz, lerobot, ros2",
    ),
    "export": (lambda: export(RUN, "csv", 5), "the name of an export must be a text"),
    "text for bytes": (lambda: spots.Decoder().feed("x"), "a decoder needs bytes, not 'x'"),
    "none for bytes": (lambda: spots.Decoder().feed(None), "a decoder needs bytes, not None"),
    "link": (lambda: spots.Board("COM3"), r"a Board needs a link, not 'COM3': call spots.open"),
    "new file": (lambda: Writer(time.monotonic, 5, dict), "path of a recording must be a text"),
    "size": (lambda: Writer(time.monotonic, "x", dict, rotate_bytes=-1), "must be more than 0"),
    "size x": (
        lambda: Writer(time.monotonic, "x", dict, rotate_bytes="1"),
        "more than 0, not '1'",
    ),
    "encoder": (lambda: spots_linkage.Encoder(5), "is not the calibration of a joint"),
    "offset": (lambda: spots_linkage.Encoder(JOINT, "x"), "must be finite numbers"),
    "twin": (lambda: spots_linkage.Twin(arm(), 5), "a linkage needs two encoders, not 5"),
    "text": (lambda: arm().forward("x", 1), "must be numbers, or arrays whose shapes broadcast"),
    "none": (lambda: arm().forward(None, 1), "must be numbers, or arrays whose shapes broadcast"),
    "shapes": (lambda: arm().inverse([1, 2], [1, 2, 3]), "arrays whose shapes broadcast"),
    "degrees": (lambda: arm().forward(90, 90), "is in rad, at most 12.57: convert degrees with"),
    "array": (lambda: arm().forward_limits([0, -30], 0), "convert degrees with numpy.radians"),
    "jacobian": (lambda: arm().jacobian(0.1, 45), "convert degrees with numpy.radians"),
    "covariance": (lambda: arm().covariance(0.1, 0.2, [1, 2, 3]), "must be an array of numbers"),
}


@pytest.mark.parametrize("name", CALLS)
def test_a_wrong_argument_is_named(name):
    call, says = CALLS[name]
    with pytest.raises(spots.SpotsError, match=says):
        call()


@pytest.mark.parametrize("seconds", [math.nan, "x", [1]])
@pytest.mark.parametrize("name", ["touches", "spectra", "keys", "contacts", "frames"])
def test_a_wrong_duration_is_named(name, seconds):
    board = spots.open_recording(RUN, math.inf)
    with refusal(SettingError):
        getattr(board, name)(seconds)
    with refusal(SettingError):
        board.read_latest(seconds)
    with refusal(SettingError):
        board.command("hello", seconds)


def test_wrong_arguments_of_a_board_are_named():
    board = spots.open_recording(RUN, math.inf)
    for call, says in (
        (lambda: board.command(5), "a command must be a text, not 5"),
        (lambda: board.set(gain=None), "gain must be a whole number or a text, not None"),
        (lambda: board.set(gain=0.5), "gain must be a whole number or a text, not 0.5"),
        (lambda: board.subscribe(5), "the callback must be a function, not 5"),
        (lambda: board.subscribe(print, 5), "must be one of Touch, Spectrum, Key, Contact, not 5"),
        (
            lambda: board.set(channels=[1, 2]),
            r"channels must be a whole number or a text, not \[1, 2\]",
        ),
        (lambda: board.when_state_changes(5), "the callback must be a function, not 5"),
        (lambda: board.when_closed(None), "the callback must be a function, not None"),
        (lambda: board.latest(9), "the board has no strip 9: its strips are 0"),
    ):
        with pytest.raises(spots.SpotsError, match=says):
            call()
    assert [*board.touches(seconds=0), *board.touches(seconds=-1)] == []
