"""Results of the driver benchmark; simulated time gives the same results on all computers."""

from __future__ import annotations

import pytest


@pytest.fixture(params=[(0, 10.0, 5.0), (1, 2.78, 12.0)], ids=["10 ms", "2.78 ms"])
def at(request, results):
    """Results for one integration time, and the least ratio of our rate to Adafruit's."""
    i, integration_ms, goal = request.param
    part = results["driver"]["integrations"][i]
    assert part["integration_ms"] == integration_ms
    return part, goal


def test_readings_come_at_several_times_the_rate(at):
    part, goal = at
    assert part["rate_ratio"] >= goal
    assert part["rate_ratio"] == pytest.approx(
        part["spots"]["rate_Hz"] / part["adafruit"]["rate_Hz"], rel=0.01
    )


def test_an_auto_zero_at_every_start_is_not_all_of_the_lead(at):
    part, _ = at
    assert 2 < part["rate_ratio_if_auto_zero_once"] < part["rate_ratio"]


def test_our_chip_integrates_nearly_all_the_time(at):
    part, _ = at
    assert 0.98 <= part["spots"]["integrating_fraction"] <= 1.001
    assert 0 < part["adafruit"]["integrating_fraction"] < 0.5


def test_a_reading_is_a_sample_and_none_is_missed(at):
    part, _ = at
    assert part["spots"]["rate_Hz"] == pytest.approx(1000 / part["integration_ms"], rel=0.002)
    assert part["spots"]["missed_samples"] == 0


def test_a_reading_takes_one_transfer_or_two_and_few_polls_in_vain(at):
    spots = at[0]["spots"]
    assert 1 < spots["transactions_per_reading"] < 2 + 0.25 * 2
    # 16 bytes of level and sample; or 4 bytes of level, and 15 of the sample.
    assert 16 < spots["wire_bytes_per_reading"] < 19 + 0.25 * 8
    assert spots["bus_kHz"] == 400


def test_the_peer_has_the_rate_it_had_on_another_emulated_bus(at):
    part, _ = at
    known_Hz = {10.0: 17, 2.78: 22}[part["integration_ms"]]
    assert part["adafruit"]["rate_Hz"] == pytest.approx(known_Hz, rel=0.05)
    assert part["adafruit"]["transactions_per_reading"] > 90


def test_bus_time_is_what_the_bytes_on_the_wire_take(at):
    for cost in (at[0]["spots"], at[0]["adafruit"]):
        clocks = 9 * cost["wire_bytes_per_reading"]
        framing = cost["bus_ms_per_reading"] * cost["bus_kHz"] - clocks
        per_transaction = framing / cost["transactions_per_reading"]
        assert 2 <= per_transaction < 3.01  # START, STOP and, in a read, a second START
