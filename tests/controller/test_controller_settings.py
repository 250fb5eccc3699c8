"""Settings files of the controller: messages for errors; saved files load again."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.refusals import refusal

from spots import SpotsError
from spots.controller.controller_settings import (
    ControllerSettings,
    ForceAxis,
    PositionAxis,
    Pressed,
    Tapped,
    load,
    save,
)
from spots.errors import FileError


def test_the_default_comes_with_the_package():
    settings = load()
    assert isinstance(settings.x, PositionAxis)
    assert isinstance(settings.z, ForceAxis)
    assert [type(one) for one in settings.button] == [Pressed, Tapped, Tapped]


def test_what_a_file_leaves_out_is_as_in_the_default(tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text('[x]\nfrom = "position"')
    mine, default = load(path), load()
    for key in ("hold_ms", "release_ms", "rate_hz"):
        assert getattr(mine, key) == getattr(default, key)
    assert mine.x.smooth == default.x.smooth


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("hold_ms = -1", "hold_ms"),
        ("hold_ms = inf", "not a finite number"),
        ("rate_hz = 0.01", "rate_hz"),  # a lift would arrive after 100 s
        ("speed = 3", "speed"),
        ('[x]\nfrom = "colour"', "colour"),
        ('[x]\nfrom = "position"\nrest_percent = 5', "rest_percent must be above min"),
        ('[x]\nfrom = "position"\nrest_mN = 5', "rest_mN"),
        ('[x]\nfrom = "position"\ndeadband = 1.0', "deadband"),
        ('[y]\nfrom = "force"\nrest_mN = 7000', "below max_mN"),
        ('[y]\nfrom = "force"\nrest_mN = 0.3\nmax_mN = 6', "max_mN"),  # in N
        ('[[button]]\nwhen = "pressed"\nnumber = 1\npress_mN = 5', "5 mN, .* write the force in"),
        ('[[button]]\nwhen = "tapped"\nnumber = 1\nlongest_ms = 0.2', "longest_ms"),  # in s
        ('[z]\nfrom = "position"', "position"),
        ('[z]\nfrom = "force"\ninvert = true', "cannot be inverted"),
        ('[[button]]\nwhen = "pressed"\nnumber = 17', "number"),
        ('[[button]]\nwhen = "pressed"\nnumber = 1\nrelease_mN = 5', "release_mN"),
        ('[[button]]\nwhen = "tapped"\nnumber = 1\nfrom_percent = 60\nto_percent = 50', "below"),
        ("= 5", "Invalid"),
    ],
)
def test_what_is_wrong_is_one_sentence_with_file_and_key(tmp_path, text, complaint):
    path = tmp_path / "mine.toml"
    path.write_text(text)
    with pytest.raises(SpotsError, match=complaint) as error:
        load(path)
    assert str(path) in str(error.value)


def test_no_such_file_says_how_to_make_one(tmp_path):
    with refusal(FileError, file="none.toml"):
        load(tmp_path / "none.toml")
    with refusal(FileError, file="none"):
        save(ControllerSettings(), tmp_path / "none" / "none.toml", None)


POSITIONS = st.lists(st.floats(0, 100), min_size=3, max_size=3, unique=True).map(sorted)


@pytest.mark.board
@given(POSITIONS, st.floats(0, 0.9), st.floats(0, 1), st.booleans(), st.integers(1, 16))
def test_what_is_written_is_read_back(tmp_path_factory, places, deadband, expo, invert, number):
    low, rest, high = places
    settings = ControllerSettings(
        hold_ms=deadband * 1000,
        x=PositionAxis(
            min_percent=low, rest_percent=rest, max_percent=high, deadband=deadband, expo=expo
        ),
        y=ForceAxis(invert=invert),
        button=[Pressed(number=number, press_mN=500.0), Tapped(number=17 - number)],
    )
    path = tmp_path_factory.mktemp("settings") / "mine.toml"
    save(settings, path, None)
    assert load(path) == settings


def test_the_default_is_read_back_too(tmp_path):
    save(load(), tmp_path / "mine.toml", None)
    assert load(tmp_path / "mine.toml") == load()


def test_a_full_disk_leaves_the_file_that_was_there(tmp_path, full_disk):
    path = tmp_path / "mine.toml"
    save(ControllerSettings(hold_ms=42.0), path, None)
    refused = refusal(FileError, file="mine.toml")
    with full_disk(10), refused:
        save(load(), path, ControllerSettings(hold_ms=42.0))
    assert load(path) == ControllerSettings(hold_ms=42.0)
    assert list(tmp_path.iterdir()) == [path]
