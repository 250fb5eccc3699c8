"""The main job on the virtual board."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import partial

from spots.errors import SpotsError
from spots.keyboard.layout import load as load_layout
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.serial_link import Tap
from spots.terminal.monitor import watch
from spots.web import browser
from spots.web.board_feed import BoardReader, finder
from spots.web.state import PageState
from spots.web.twin_feed import driven_readers

from .demo_applications import DEMO_LAYOUT, play_controller, show_gestures, type_on_board
from .faults import Faults, FaultyLink, of_scenario
from .files import ScenarioFile, SensorFile, load
from .linkage_demo import demonstrate, endless
from .lockstep import LockstepLink
from .runtimes import headline
from .scenario import Scenario
from .score import Score
from .stage import calibrate
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
) -> dict:
    """Run the virtual board, show its readings, and return the run in figures.

    Parameters
    ----------
    sensor, scenario : str
        Files, by path or name; no scenario for that of the use.
    seed : int
        Of the noise.
    seconds : float or None
        Length of the run; None for no end.
    fast : bool
        In simulated time: as fast as the machine can, the same bytes every time.
    quiet : bool
        Show nothing.
    use : str
        A key of `USES`, or `FIVEBAR`: two boards on a linkage with a path of its own.
    layout : str, optional
        Of the keyboard, by path or name.

    Returns
    -------
    dict
        The run in figures, as JSON can hold it.

    Raises
    ------
    SpotsError
        If there is no such use or file, or the virtual board does not run.
    """
    if use == FIVEBAR:
        return demonstrate(sensor, seed, seconds, fast, quiet)
    if use not in USES:
        known = ", ".join([*USES, FIVEBAR])
        raise SpotsError(f"there is no demo of '{use}': --use takes one of {known}")
    show, usual = USES[use]
    if layout:
        show = partial(_keyboard, layout=layout)
    scenario = scenario or usual
    file = load(ScenarioFile, scenario)
    truth = Scenario(file)
    if fast:
        board, digest = open_fast(sensor, truth, seed, of_scenario(file, seed))
        started_s = 0.0
    else:
        (board, started_s), digest = open_virtual(sensor, scenario, seed), None
    with board:
        if not quiet:
            print(headline(board.info["runtime"]), flush=True)
        if file.faults:
            board.command("save")  # or a restart would cost the calibration
        summary = show(board, truth, started_s, seconds, quiet)
    if digest is not None:
        summary["stream_sha256"] = digest.hexdigest()
    return summary


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


# What is shown of a board, the truth and the host time of its time 0, for so long, or quietly;
# each returns the run in figures. With it the scenario that is played if no other is named.
USES: dict[str, tuple[Callable[[Board, Scenario, float, float | None, bool], dict], str]] = {
    "strip": (_strip, "demo"),
    KEYBOARD: (_keyboard, "typing"),
    "controller": (_controller, "demo"),
    "wearable": (_wearable, "worn"),
}


def open_fast(
    sensor: str, truth: Scenario, seed: int, faults: Faults | None = None
) -> tuple[Board, hashlib._Hash]:
    """Return a calibrated virtual board in simulated time, and the SHA-256 of all it sends.

    Parameters
    ----------
    sensor : str
        A file, by path or name.
    truth : Scenario
        What happens to the strip.
    seed : int
        Of the noise.
    faults : Faults, optional
        Between board and host, and on the I2C bus.

    Returns
    -------
    board : Board
    digest : hash object
        SHA-256, updated while the board is read.

    Raises
    ------
    SpotsError
        If the sensor file is missing or invalid.
    """
    file = load(SensorFile, sensor)
    calibration = calibrate(file)
    bare = LockstepLink(file, truth, seed, faults=faults)
    digest = hashlib.sha256()
    link = FaultyLink(bare, faults) if faults else bare
    board = Board(Tap(link, lambda data, now_s: digest.update(data)))
    try:
        prepare(board, calibration)
    except BaseException:
        board.close()
        raise
    return board, digest


def show_page(use: str, sensor: str, scenario: str, seed: int) -> None:
    """Serve the virtual board, and open the page where there is a screen and somebody at it.

    Parameters
    ----------
    use : str
        ``fivebar`` shows a simulated linkage; the others are on the page all the time.
    sensor, scenario : str
        Files, by path or name.
    seed : int
        Of the noise.
    """
    from spots.web.serve import LOOPBACK, serve

    state, layout = PageState(), load_layout(_PAGE_LAYOUT)
    if use == FIVEBAR:
        readers = driven_readers(endless(sensor, seed=seed), layout, state)
    else:
        readers = [BoardReader(finder(VIRTUAL, sensor, scenario, seed), layout, state)]
    print(headline(), flush=True)
    serve(state, LOOPBACK, 0, readers, browser.show)
