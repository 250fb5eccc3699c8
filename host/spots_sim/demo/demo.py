"""``spots demo``: runs a virtual board with an application, such as the keyboard."""

from __future__ import annotations

import hashlib
from argparse import Namespace
from collections.abc import Callable
from functools import partial

from spots.errors import RequirementError, SettingError
from spots.keyboard.layout import load as load_layout
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.finder import finder
from spots.terminal.monitor import watch
from spots_linkage.panel import driven_sources
from spots_web.board_feed import BoardReader
from spots_web.cli import HTTP_PORT
from spots_web.panel_feed import readers_of, shower
from spots_web.state import PageState

from ..board.faults import Faults, FaultyLink, of_scenario
from ..board.link_wrapper import Tap
from ..board.lockstep import LockstepLink
from ..board.runtimes import headline
from ..measure.rezeroed import recalibrated
from ..measure.score import Score
from ..person.stage import calibrate, set_as_calibrated
from ..strip.files import ScenarioFile, SensorFile, load
from ..strip.scenario import Scenario
from . import browser
from .demo_applications import DEMO_LAYOUT, play_controller, show_gestures, type_on_board
from .linkage_demo import demonstrate, endless
from .virtual import VIRTUAL, open_virtual

FIVEBAR = "fivebar"
KEYBOARD = "keyboard"
_PAGE_LAYOUT = "digits"


def demo(
    sensor: str,
    scenario: str | None,
    seed: int,
    seconds: float | None,
    fast: bool,
    quiet: bool,
    use: str = "strip",
    layout: str | None = None,
    rezeroed: bool = False,
    warm: bool = False,
    cpu: str | None = None,
) -> dict:
    """Run the virtual board, show its readings, and return the results of the run for JSON.

    `use` is a key of `USES`, or `FIVEBAR` for two boards on a simulated linkage. Without `seconds`,
    the run has no limit, but with `quiet` the application ``keyboard`` ends with its scenario, and
    with `fast` ``fivebar`` ends with its path. `fast` is simulated time: as fast as possible, with
    the same bytes in each run. `rezeroed`, `warm` and `cpu` need `fast`, see `open_fast`.

    The results are those of `score.Score.summary` for the application ``strip``, of
    `linkage_demo.demonstrate` for ``fivebar``, and of `demo_applications` for the others. With
    `fast` and without ``fivebar``, ``stream_sha256`` is the hash of all bytes from the board.
    SpotsError if an argument or a file is invalid, or the virtual board does not start.
    """
    _check_use(use)
    if use == FIVEBAR:
        return demonstrate(sensor, seed, seconds, fast, quiet)
    show, usual = USES[use]
    if layout:
        show = partial(_keyboard, layout=layout)
    scenario = scenario or usual
    file = load(ScenarioFile, scenario)
    truth = Scenario(file)
    if fast:
        faults = of_scenario(file, seed)
        board, digest = open_fast(sensor, truth, seed, faults, rezeroed, warm, cpu=cpu)
        started_s = 0.0
    else:
        (board, started_s), digest = open_virtual(sensor, scenario, seed), None
    with board:
        if not quiet:
            print(headline(board.info["runtime"]), flush=True)
        if file.faults:
            board.command("save")  # otherwise a restart would lose the calibration
        summary = show(board, truth, started_s, seconds, quiet)
    if digest is not None:
        summary["stream_sha256"] = digest.hexdigest()
    return summary


def _check_use(use: str) -> None:
    if use not in (*USES, FIVEBAR):
        known = ", ".join([*USES, FIVEBAR])
        raise SettingError(f"there is no demo of '{use}': use one of {known} with --use")


def _strip(
    board: Board, truth: Scenario, started_s: float, seconds: float | None, quiet: bool
) -> dict:
    score = Score(truth, started_s)
    watch(board, seconds, quiet, score)
    return score.summary(board.info, board.stats)


def _controller(
    board: Board, truth: Scenario, started_s: float, seconds: float | None, quiet: bool
) -> dict:
    return _with_link(board, play_controller(board, truth, started_s, seconds, quiet))


def _keyboard(
    board: Board,
    truth: Scenario,
    started_s: float,
    seconds: float | None,
    quiet: bool,
    layout: str = DEMO_LAYOUT,
) -> dict:
    if seconds is None and quiet:
        seconds = truth.file.seconds - (board.now_s() - started_s)
    return _with_link(board, type_on_board(board, truth, started_s, seconds, quiet, layout))


def _wearable(
    board: Board, truth: Scenario, started_s: float, seconds: float | None, quiet: bool
) -> dict:
    return _with_link(board, show_gestures(board, seconds, quiet))


def _with_link(board: Board, figures: dict) -> dict:
    return {
        "runtime": board.info["runtime"],
        "board": board.info["board"],
        "frames": board.stats.frames,
        "lost": board.stats.lost,
        "bad_crc": board.stats.bad_crc,
        **figures,
    }


# Function and default scenario of each application. The function gets the board, the scenario, the
# host time in s at the scenario's time 0, and the duration in s. Its last argument is true to
# print nothing. It returns the results of the run.
USES: dict[str, tuple[Callable[[Board, Scenario, float, float | None, bool], dict], str]] = {
    "strip": (_strip, "demo"),
    KEYBOARD: (_keyboard, "typing"),
    "controller": (_controller, "demo"),
    "wearable": (_wearable, "worn"),
}


def open_fast(
    sensor: str,
    truth: Scenario,
    seed: int,
    faults: Faults | None = None,
    rezeroed: bool = False,
    warm: bool = False,
    lines: tuple[str, ...] | None = None,
    cpu: str | None = None,
) -> tuple[Board, hashlib._Hash]:
    """Open a calibrated virtual board in simulated time, and hash all bytes that the board sends.

    The caller closes the board; the SHA-256 is updated while the board is read. With `rezeroed`,
    the calibration was corrected with a few presses after the change that the table ``[change]`` of
    the sensor file describes; with `lines`, it is that calibration instead. With `warm`, the LED is
    warm at the start.
    """
    file = load(SensorFile, sensor)
    calibration = lines or (recalibrated(file) if rezeroed else calibrate(file))
    bare = LockstepLink(file, truth, seed, faults=faults, warm=warm, cpu=cpu)
    digest = hashlib.sha256()
    link = FaultyLink(bare, faults) if faults else bare
    board = Board(Tap(link, lambda data, now_s: digest.update(data)))
    try:
        set_as_calibrated(board, file)
        prepare(board, calibration)
    except BaseException:
        board.close()
        raise
    return board, digest


def show_page(
    use: str | None, sensor: str, scenario: str, seed: int, layout: str | None = None
) -> None:
    """Serve the web UI with a virtual board, and open it with `browser.show`.

    For ``fivebar``, the web UI shows a simulated linkage. Otherwise it shows a strip, and directly
    below the strip the panel of the application, if any. SpotsError if `use` or a file is invalid.
    """
    from spots_web.serve import LOOPBACK, serve

    if use is not None:
        _check_use(use)
    state, keys = PageState(), load_layout(layout or _PAGE_LAYOUT)
    if use == FIVEBAR:
        sources = driven_sources(endless(sensor, seed=seed), shower(state, "twin"))
        readers = readers_of(sources, keys, state)
    else:
        options = Namespace(sensor=sensor, scenario=scenario, seed=seed)
        readers = [BoardReader(finder(VIRTUAL, options), keys, state)]
        state.put("application", use)
    print(headline(), flush=True)
    try:  # a bookmark, and a page that is still open, find the next demo
        serve(state, LOOPBACK, HTTP_PORT, readers, browser.show)
    except RequirementError:  # in use
        serve(state, LOOPBACK, 0, readers, browser.show)
