"""`spots dark`: the guided dark frame of an LED that is always on."""

import pytest
from support.refusals import refusal

from spots.calibrate.session.dark import take_dark
from spots.cli import main
from spots.errors import BoardError
from spots.link.board import Board
from spots_device.reading.decode import DARK_SAMPLES
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.files import SensorFile, load
from spots_sim.strip.scenario import Held, Press


class Person:
    """A person who unplugs the LED and plugs it in again, as requested."""

    def __init__(self, folder, forgets=0):
        self.held = Held()
        self.held.press = Press(2.0, 6_000, 4.0)  # untouched, the strip is always dark
        self.board = Board(LockstepLink(load(SensorFile, "always"), self.held, folder=folder))
        self.asked = []
        self._forgets = forgets

    def ask(self, text):
        self.asked.append(text)
        self.held.unplugged = len(self.asked) > self._forgets and "in again" not in text
        return ""


@pytest.fixture
def person(tmp_path):
    made = []

    def make(**options):
        made.append(Person(tmp_path, **options))
        return made[-1]

    yield make
    for one in made:
        one.board.close()


def test_the_dark_frame_is_taken_unplugged_and_survives_a_restart(person):
    first = person()
    first.board.command("set led=always gain=7")
    dark = take_dark(first.board, first.ask)
    assert max(dark) < 5 * DARK_SAMPLES
    assert [text.split()[0] for text in first.asked] == ["unplug", "plug"]
    assert not first.held.unplugged
    first.board.close()
    again = person()
    info = again.board.command("hello")
    assert (info["led"], info["gain"]) == ("always", 7)
    assert again.board.command("dark")["dark"] == dark


def test_who_forgets_to_unplug_it_is_asked_again(person):
    forgetful = person(forgets=2)
    forgetful.board.command("set led=always gain=7")
    dark = take_dark(forgetful.board, forgetful.ask)
    assert max(dark) < 5 * DARK_SAMPLES
    assert [text.split()[0] for text in forgetful.asked] == ["unplug", "the", "the", "plug"]
    assert "of full scale" in forgetful.asked[1]


@pytest.mark.parametrize("led", ["ldr", "gpio"])
def test_a_board_that_switches_its_led_needs_no_guide(person, led):
    other = person()
    other.board.command(f"set led={led}")
    with refusal(BoardError, why="led_switched"):
        take_dark(other.board, other.ask)
    assert not other.asked


@pytest.mark.board
def test_a_strip_whose_led_is_always_on_is_calibrated_by_the_command(tmp_path, capsys):
    sensor = "always"
    session = tmp_path / "session.jsonl"
    arguments = ["--port", "virtual", "--sensor", sensor, "--session", str(session)]
    assert main(["calibrate", "position", "--places", "12", *arguments]) == 0
    assert f"LED {sensor}," in capsys.readouterr().out
    assert main(["calibrate", "force", *arguments]) == 0
    assert "led_mA = 0" in session.with_suffix(".toml").read_text()
