"""After a lost reply, the board itself is asked; nothing is assumed about what it has done."""

import pytest
from support.refusals import refusal

from spots.calibrate import calibration_file
from spots.calibrate.session.rezero import use
from spots.errors import CalibrationError, NoReplyError
from spots.keyboard import keys
from spots.keyboard.layout import load
from spots.link.board import Board
from spots.link.connect import prepare, upload
from spots_device.board.settings import checksum
from spots_device.reading.calibration import Calibration
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.scenario import Held

pytestmark = pytest.mark.board

MINI = load("mini")


@pytest.fixture
def board(sensor, calibration):
    with Board(LockstepLink(sensor, Held())) as board:
        prepare(board, calibration)
        board.command("save")
        yield board


@pytest.fixture
def lose(board, monkeypatch):
    """Return a function that loses the next replies to commands that begin with a text."""

    def lose(begin, times=1):
        exchange, left = board.channel.exchange, [times]

        def losing(line, timeout_s):
            reply = exchange(line, timeout_s)
            if line.startswith(begin) and left[0]:
                left[0] -= 1
                return None
            return reply

        monkeypatch.setattr(board.channel, "exchange", losing)
        return left

    return lose


def restarted(board, name):
    """Return a field of the reply to ``hello`` after a restart of the board."""
    board.command("stream touch")
    board.command("reboot")
    list(board.frames(1.0))
    return board.command("hello")[name]


@pytest.mark.parametrize("line", ["layout begin", "layout key", "layout end", "set keys", "save"])
def test_a_lost_reply_of_a_pushed_layout_changes_nothing(board, lose, line):
    left = lose(line)
    keys.push(board, MINI)
    assert left == [0]
    assert board.command("get")["keys"] == 1
    assert restarted(board, "layout") == checksum(MINI.lines)


@pytest.mark.parametrize("line", ["cal begin", "cal x", "cal end"])
def test_a_lost_reply_of_an_upload_changes_nothing(board, lose, calibration, line):
    board.command("cal clear")
    left = lose(line)
    upload(board, calibration)
    assert left == [0]
    assert board.command("hello")["calibration"] == checksum(calibration)


def test_an_end_whose_replies_are_lost_is_no_error(board, lose):
    lose("layout end", 2)
    keys.push(board, MINI)
    assert board.command("hello")["layout"] == checksum(MINI.lines)


@pytest.mark.parametrize(("line", "has"), [("layout key", False), ("save", True)])
def test_a_second_lost_reply_is_an_error(board, lose, line, has):
    lose(line, 2)
    with refusal(NoReplyError):
        keys.push(board, MINI)
    assert board.command("hello")["layout"] == (checksum(MINI.lines) if has else None)


@pytest.fixture
def rezeroed(board, calibration, tmp_path):
    """Calibration files before and after a re-zero, and the `Bench` with the path of the file."""

    class Bench:
        path = tmp_path / "calibration.toml"

        class reader:  # noqa: N801
            pass

    Bench.reader.board = board
    conditions = Calibration(calibration).conditions._asdict()
    made, new = (
        calibration_file.CalibrationFile(
            date=calibration_file.now(), **conditions, lines=tuple(lines)
        )
        for lines in (calibration, [*calibration[:-1], moved(calibration[-1])])
    )
    calibration_file.save(made, Bench.path, None)
    return Bench, made, new


def moved(line):
    """Return the last line of a calibration, a row of a table, with another brightness."""
    *words, last = line.split()
    return " ".join([*words, str(int(last) + 1)])


def test_a_rezero_whose_save_is_not_confirmed_is_undone_also_in_the_flash(board, lose, rezeroed):
    bench, made, new = rezeroed
    lose("save", 2)
    with pytest.raises(NoReplyError):
        use(bench, made, new)
    assert calibration_file.load(bench.path) == made
    assert restarted(board, "calibration") == checksum(made.lines)


def test_a_rezero_of_unknown_outcome_is_reported_as_unknown(lose, rezeroed):
    bench, made, new = rezeroed
    lose("", 99)
    with refusal(CalibrationError):
        use(bench, made, new)
    assert calibration_file.load(bench.path) == made
