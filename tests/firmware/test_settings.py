"""Settings: a change is atomic; a save survives a power cut at every step."""

import os
from types import SimpleNamespace

import pytest

from spots_device import settings


def made(**config):
    return settings.BoardSettings(SimpleNamespace(LED_MAX_MA=100, **config))


def test_defaults_are_within_their_own_limits():
    fresh = made()
    fresh.change(fresh.lines())
    assert fresh.values == made().values


def test_the_exposure_becomes_what_the_chip_can_do():
    fresh = made()
    fresh.change(["exposure_us=12345"])
    assert fresh.values["exposure_us"] == 12346  # 4441 steps of 2.78 us
    fresh.change(fresh.lines())
    assert fresh.values["exposure_us"] == 12346


@pytest.mark.parametrize(
    ("word", "says"),
    [
        ("gain=11", "0 to 10"),
        ("gain=-1", "0 to 10"),
        ("gain=", "whole number"),
        ("gain=9.5", "whole number"),
        ("gain", "whole number"),
        ("exposure_us=0", "1000 to 1000000"),
        ("average=65", "1 to 64"),
        ("led_mA=101", "0 to 100"),
        ("led_mA=3", "4 to 100"),
        ("plan=F1,F2", "six different"),
        ("plan=F1,F2,F3,F4,F5,F9", "F9"),
        (
            "colour=red",
            "use one of average, .*led_mA, mains_hz, strain_ppm, watchdog, led, plan",
        ),
        ("", "use one of"),
        ("led=torch", "ldr, gpio, always"),
        ("led=gpio", "STRIP_LED_PIN"),
        ("dark=1", "six sums"),
        ("dark=9,10000,1,2,3,4,5", "six sums"),
        ("dark=9,10000,1,2,3,4,5,-6", "six sums"),
        ("dark=11,10000,1,2,3,4,5,6", "six sums"),
        ("dark=9,10000,1,2,3,4,5,x", "six sums"),
    ],
)
def test_a_bad_setting_is_named_and_nothing_is_taken(word, says):
    fresh = made()
    with pytest.raises(ValueError, match=says):
        fresh.change(["gain=3", word])
    assert fresh.values == made().values


def test_the_current_becomes_what_the_chip_makes_of_it():
    fresh = made()
    fresh.change(["led_mA=21"])
    assert fresh.values["led_mA"] == 20


def test_no_current_is_allowed_for_it_means_off():
    fresh = made()
    fresh.change(["led_mA=0"])
    assert fresh.values["led_mA"] == 0


@pytest.mark.parametrize("led", ["gpio", "always"])
def test_an_led_that_the_sensor_does_not_drive_has_no_current(led):
    fresh = made(STRIP_LED_PIN=15)
    fresh.change(["led=" + led])
    assert fresh.values["led_mA"] == 0
    fresh.change(["led_mA=20"])
    assert fresh.values["led_mA"] == 0
    fresh.change(["led=ldr"])
    assert fresh.values["led_mA"] == 20


def test_a_board_file_chooses_the_led_and_settings_of_before_load():
    fresh = made(STRIP_LED="gpio", STRIP_LED_PIN=15)
    fresh.change(["exposure_us=10000", "gain=9", "led_mA=20"])
    assert (fresh.values["led"], fresh.values["led_mA"]) == ("gpio", 0)


def test_a_dark_frame_belongs_to_its_channels_and_is_saved():
    fresh = made()
    fresh.change(["led=always", "dark=9,10000,1,2,3,4,5,6"])
    assert fresh.values["dark"] == [9, 10_000, 1, 2, 3, 4, 5, 6]
    again = made()
    again.change(fresh.lines())
    assert again.values == fresh.values
    again.change(["plan=F3,F4,F5,F6,F7,F8"])
    assert again.values["dark"]
    again.change(["plan=F1,F4,F5,F6,F7,F8"])
    assert again.values["dark"] == []


def test_what_was_saved_is_loaded(tmp_path):
    path = str(tmp_path / "f")
    settings.save_lines(path, ["a", "b c"])
    settings.save_lines(path, ["d"])
    assert settings.load_lines(path) == ["d"]


def test_nothing_saved_is_nothing_loaded(tmp_path):
    assert settings.load_lines(str(tmp_path / "f")) == []


def test_two_damaged_files_are_told_from_none(tmp_path):
    (tmp_path / "f").write_text("a\ncrc 0000\n")
    (tmp_path / "f.old").write_text("")
    with pytest.raises(ValueError, match="damaged"):
        settings.load_lines(str(tmp_path / "f"))


@pytest.mark.parametrize("damage", [b"", b"d\n", b"d\ncrc 0000\n", b"\xff\xfe"])
def test_a_damaged_file_gives_way_to_the_last_good_one(tmp_path, damage):
    path = tmp_path / "f"
    settings.save_lines(str(path), ["a"])
    settings.save_lines(str(path), ["b"])
    path.write_bytes(damage)
    assert settings.load_lines(str(path)) == ["a"]


class PowerCutError(Exception):
    pass


class Flash:
    """A file system that loses power after a given number of bytes and directory changes."""

    def __init__(self, steps):
        self.left = steps

    def step(self):
        if self.left == 0:
            raise PowerCutError
        self.left -= 1

    def open(self, path, mode="r"):
        if mode == "r":
            return open(path)
        self.step()  # after this step the file is empty
        return Writer(self, path)

    def change(self, operation):
        def do(*paths):
            self.step()
            operation(*paths)

        return do


class Writer:
    def __init__(self, flash, path):
        self._flash, self._file = flash, open(path, "w")

    def write(self, text):
        for character in text:
            self._flash.step()
            self._file.write(character)

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self._file.close()


def store(monkeypatch, path, lines, steps):
    """Save lines; cut the power after a number of steps. Return whether the save was complete."""
    flash = Flash(steps)
    with monkeypatch.context() as patch:
        patch.setattr(settings, "open", flash.open, raising=False)
        patch.setattr(settings.os, "rename", flash.change(os.rename))
        patch.setattr(settings.os, "remove", flash.change(os.remove))
        try:
            settings.save_lines(path, lines)
        except PowerCutError:
            return False
    return True


def loaded(path):
    try:
        return settings.load_lines(str(path))
    except ValueError as error:
        return str(error)


@pytest.mark.parametrize(
    "before", [[], ["one"], ["one", "two"], ["one", "two", "damaged"], ["damaged"]]
)
def test_a_cut_at_any_byte_of_a_save_leaves_the_old_or_the_new(tmp_path, monkeypatch, before):
    steps, lasted = 0, False
    while not lasted:
        path = tmp_path / str(steps)
        for line in before:
            if line == "damaged":
                path.write_text("two\ncrc")
            else:
                settings.save_lines(str(path), [line])
        known = loaded(path)
        lasted = store(monkeypatch, str(path), ["three"], steps)
        found = loaded(path)
        assert found == ["three"] if lasted else found in (known, ["three"])
        # The power fails again, during the next save.
        store(monkeypatch, str(path), ["four"], steps // 2)
        assert loaded(path) in (found, ["four"])
        steps += 1
    assert steps > len("three\ncrc 0000\n")


def test_what_is_stored_already_is_not_written_again(tmp_path, monkeypatch):
    path = str(tmp_path / "f")
    settings.save_lines(path, ["one"])
    assert store(monkeypatch, path, ["one"], steps=0)
