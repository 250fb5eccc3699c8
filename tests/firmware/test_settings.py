"""Settings: a change is atomic."""

from types import SimpleNamespace

import pytest

from spots_device.board import settings


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
        ("channels=F1,F2", "six different"),
        ("channels=F1,F2,F3,F4,F5,F9", "F9"),
        (
            "colour=red",
            "use one of average, .*led_mA, mains_hz, strain_ppm, watchdog, led, radio, channels",
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
    again.change(["channels=F3,F4,F5,F6,F7,F8"])
    assert again.values["dark"]
    again.change(["channels=F1,F4,F5,F6,F7,F8"])
    assert again.values["dark"] == []


def test_the_rate_is_what_exposure_and_average_allow():
    fresh = made()
    fresh.change(["exposure_us=2500", "average=2"])
    assert fresh.rate_mHz() == 1_000_000_000 // (2 * fresh.values["exposure_us"])
    assert fresh.rate_mHz() == 200_080  # the exposure is 2499 us
