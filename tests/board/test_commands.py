"""Commands to the real firmware: each line gets one reply, and an invalid line changes nothing."""

import ast
from pathlib import Path

import pytest
from support.refusals import refusal

import spots_device
from spots.errors import BoardError, CalibrationError, NoReplyError, SettingError
from spots.link.board import Board
from spots.link.board_errors import REASONS
from spots.link.connect import upload
from spots_device.board.settings import checksum
from spots_sim.board.link_wrapper import LinkWrapper
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.scenario import Held

pytestmark = pytest.mark.board


@pytest.mark.usefixtures("in_micropython")
def test_hello_returns_identity_and_settings(rig):
    info = rig().board.info
    assert info["protocol"] == 3
    assert info["board"] == "virtual"
    assert info["runtime"].startswith("micropython 1.")
    assert info["channels"] == ["F3", "F4", "F5", "F6", "F7", "F8"]
    assert (info["exposure_us"], info["gain"], info["led_mA"]) == (10_000, 9, 20)
    assert info["calibration"] is None


class Hesitant(LinkWrapper):
    """A link that delays or drops the board's data for some time after a call of `hold`."""

    def __init__(self, link, loses=False):
        super().__init__(link)
        self._loses, self._until_s, self._held = loses, 0.0, b""

    def hold(self, for_s):
        self._until_s = self.now_s() + for_s

    def read(self, timeout_s):
        data = super().read(timeout_s)
        if self.now_s() < self._until_s:
            self._held += b"" if self._loses else data
            return b""
        held, self._held = self._held, b""
        return held + data


class HesitantAtSync(Hesitant):
    """A `Hesitant` link that calls `hold` at the fourth command ``sync``."""

    def __init__(self, link, for_s, loses):
        super().__init__(link, loses)
        self._for_s, self._asked = for_s, 0

    def write(self, data):
        super().write(data)
        self._asked += data == b"sync\n"
        if self._asked == 4 and not self._until_s:
            self.hold(self._for_s)


@pytest.mark.parametrize("loses", [False, True])
@pytest.mark.parametrize("for_s", [0.51, 1.2])
def test_a_reply_that_is_late_or_lost_neither_stops_the_opening_nor_bends_time(
    sensor, for_s, loses
):
    with Board(LockstepLink(sensor, Held())) as board:
        in_time = board.channel.clocks.clock
    with Board(HesitantAtSync(LockstepLink(sensor, Held()), for_s, loses)) as board:
        late = board.channel.clocks.clock
    assert late.uncertainty_s < 0.001
    assert late.host_s(5_000_000, 5.0) == pytest.approx(in_time.host_s(5_000_000, 5.0), abs=0.002)


@pytest.mark.parametrize("loses", [False, True])
def test_a_late_reply_is_not_that_to_the_next_command(sensor, loses):
    link = Hesitant(LockstepLink(sensor, Held()), loses)
    with Board(link) as board:
        link.hold(4.1)
        with refusal(NoReplyError):
            board.command("stream touch")
        assert board.command("stream spectrum")["stream"] == ["spectrum"]
        assert board.command("stream off")["stream"] == ["off"]


def test_a_reply_may_take_some_seconds(sensor):
    link = Hesitant(LockstepLink(sensor, Held()))
    with Board(link) as board:
        link.hold(3.5)
        assert board.command("stream touch")["stream"] == ["touch"]


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("dance", "no_command"),
        ("gain 3", "no_command"),
        ("set", "bad_value"),
        ("set gain=99", "bad_value"),
        ("set gain=x", "bad_value"),
        ("set gain=3 colour=red", "bad_value"),
        ("set channels=F1,F1,F2,F3,F4,F5", "bad_value"),
        ("stream", "bad_value"),
        ("stream touch off", "bad_value"),
        ("stream sideways", "bad_value"),
        ("cal end 0000", "bad_calibration"),
        ("cal", "bad_calibration"),
        ("get sensor=1", "no_sensor"),
    ],
)
def test_a_bad_line_changes_nothing(rig, line, why):
    made = rig()
    before = made.board.command("get")
    with refusal(BoardError, why=why):
        made.board.command(line)
    assert made.board.command("get") == before


@pytest.mark.parametrize(
    ("raw", "why"),
    [(b"\xffhello\n", "bad_line"), (b"x" * 300 + b"\n", "bad_line"), (b" \n", "no_command")],
)
def test_a_line_that_is_no_text_is_answered_and_the_next_one_works(rig, raw, why):
    made = rig()
    made.link.write(raw)
    made.settle(0.05)
    reply = made.replies[-1]
    assert (reply["re"], reply["why"]) == ("", why)
    assert reply["error"]
    assert made.board.command("hello")["protocol"] == 3


def test_lines_in_one_piece_get_one_reply_each(rig):
    made = rig()
    made.link.write(b"sync\nget\r\nhello\n")
    made.settle(0.1)
    assert [reply["re"] for reply in made.replies] == [
        "sync",
        "get",
        "hello",
    ]


def test_settings_take_effect_on_the_sensor(rig):
    made = rig()
    reply = made.board.command(
        "set exposure_us=2780 gain=5 led_mA=50 channels=F1,F2,F3,F4,CLEAR,NIR"
    )
    assert reply["exposure_us"] == 2780
    made.press(5.0, 5000.0)
    frames = made.spectra(100)
    assert frames[-1].gain == 5
    assert made.link.chip._led_mA() == 50
    step_us = (frames[-1].t_us - frames[0].t_us) / 99
    assert step_us == pytest.approx(2780, rel=2e-3)
    assert made.board.stats.lost == 0
    assert made.board.command("get")["missed"] == 0


def test_a_calibration_is_taken_only_whole(rig, calibration):
    made = rig(calibration=calibration)
    before = made.board.command("hello")["calibration"]
    assert before == checksum(calibration)
    for lines, code, why in (
        (calibration[:-1], checksum(calibration), "bad_calibration"),  # truncated
        (calibration[:-40], checksum(calibration[:-40]), "bad_calibration"),
        (["nonsense 1", *calibration], checksum(["nonsense 1", *calibration]), "bad_calibration"),
    ):
        made.board.command("cal begin")
        for line in lines:
            made.board.command("cal " + line)
        with refusal(BoardError, why=why):
            made.board.command("cal end " + code)
        assert made.board.command("hello")["calibration"] == before
    made.board.command("cal clear")
    assert made.board.command("hello")["calibration"] is None


def test_a_calibration_without_end_is_dropped_and_the_board_goes_on(rig, calibration):
    made = rig(calibration=calibration)
    made.board.command("cal begin")
    for _ in range(65):
        made.board.command("cal x " + "9" * 240)
    with refusal(BoardError, why="bad_calibration"):
        made.board.command("cal x " + "9" * 240)
    assert made.board.command("hello")["calibration"] == checksum(calibration)


def test_an_empty_statement_is_refused(rig):
    made = rig()
    made.board.command("cal begin")
    with refusal(BoardError, why="bad_calibration"):
        made.board.command("cal")


@pytest.mark.parametrize("line", ["", "  ", "x" * 256, "hello\nhello", "h\x03", "höhe"])
def test_what_is_no_command_is_not_sent(rig, line):
    made = rig()
    with refusal(SettingError):
        made.board.command(line)


def test_a_long_unknown_name_is_answered_all_the_same(rig):
    with refusal(BoardError, why="no_command"):
        rig().board.command("a" * 100)


def test_a_request_cut_short_by_a_reboot_is_answered(rig):
    made = rig()
    made.link.write(b"dark\nreboot\n")
    made.settle(0.3)
    replies = made.replies
    assert [reply["re"] for reply in replies] == ["dark", "reboot"]
    assert replies[0]["why"] == "canceled"


def test_a_calibration_for_something_else_is_refused_with_what_to_do(rig, calibration):
    made = rig()
    foreign = ["board 0000" if line.startswith("board") else line for line in calibration]
    with refusal(CalibrationError):
        upload(made.board, foreign)
    made.board.command("set gain=8")
    with refusal(CalibrationError):
        upload(made.board, calibration)
    assert made.board.command("hello")["calibration"] is None


def test_running_out_of_memory_is_not_reported_as_older_firmware(rig, calibration, monkeypatch):
    made = rig()
    command = made.board.command

    def without_memory(line, **options):
        if line.startswith("cal end"):
            raise BoardError("no memory is left", "no_memory")
        return command(line, **options)

    monkeypatch.setattr(made.board, "command", without_memory)
    with refusal(BoardError, why="no_memory") as caught:
        upload(made.board, calibration)
    assert "spots flash" not in str(caught.value)


def test_each_code_of_the_firmware_is_in_the_table():
    folder = Path(spots_device.__file__).parent
    codes = set()
    for path in folder.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "ValueError":
                codes.update(ast.unparse(one) for one in node.args[1:])
            elif isinstance(node, ast.Dict):
                pairs = zip(map(ast.unparse, filter(None, node.keys)), node.values)
                codes.update(ast.unparse(value) for key, value in pairs if key == "'why'")
    codes = {code.strip("'") for code in codes} - {"why"}
    assert len(codes) >= 9
    assert codes <= set(REASONS)


def test_the_board_itself_tells_a_foreign_calibration(rig, calibration):
    made = rig()
    foreign = ["board 0000" if line.startswith("board") else line for line in calibration]
    made.board.command("cal begin")
    for line in foreign:
        made.board.command("cal " + line)
    assert "made on board 0000" in made.board.command("cal end " + checksum(foreign))["note"]
    assert made.board.command("hello")["calibration"] is None


def test_a_setting_that_leaves_the_calibration_says_so_and_coming_back_restores_it(
    rig, calibration
):
    made = rig(calibration=calibration)
    assert "calibrate again" in made.board.command("set gain=8")["note"]
    made.press(42.0, 3000.0)
    assert all(not r.touching and r.flags & 1 << 6 for r in made.readings(5))
    assert "note" not in made.board.command("set gain=9")
    assert all(r.trusted for r in made.readings(5))


def test_what_was_saved_survives_a_reboot_and_what_was_not_does_not(rig, calibration, tmp_path):
    made = rig(folder=tmp_path)
    made.board.command("set average=4")
    upload(made.board, calibration)
    made.board.command("save")
    made.board.command("set gain=2")
    made.board.command("reboot")
    made.settle(0.5)
    info = made.board.command("hello")
    assert (info["gain"], info["average"]) == (9, 4)
    assert info["calibration"] == checksum(calibration)


def test_damaged_files_on_the_board_give_the_defaults(rig, tmp_path):
    (tmp_path / "saved-a.txt").write_text("generation 1\ncrc 0000\n")
    (tmp_path / "settings-a.txt").write_text("gain=3\n")
    (tmp_path / "calibration-a.txt").write_bytes(b"\xff\x00")
    made = rig(folder=tmp_path)
    assert made.board.info["gain"] == 9
    assert made.board.info["calibration"] is None
    assert "the default settings are used" in made.board.info["boot"][0]
    made.board.command("save")
    assert made.board.command("hello")["boot"] == []


def test_a_request_that_is_interrupted_is_answered(rig):
    made = rig()
    made.link.write(b"autoexpose\nset gain=5\n")
    made.settle(0.1)
    replies = made.replies
    assert [reply["re"] for reply in replies] == ["autoexpose", "set"]
    assert "before the command ended" in replies[0]["error"]


def test_one_request_at_a_time(rig):
    made = rig()
    made.link.write(b"dark\ndark\n")
    made.settle(1.0)
    replies = made.replies
    assert sorted("error" in reply for reply in replies) == [False, True]
