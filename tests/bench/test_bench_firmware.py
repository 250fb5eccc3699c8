"""Results of the firmware benchmark: bytes have fixed values; times must only be present."""

from __future__ import annotations

import pytest
from support.viper import need_viper

from bench import firmware

pytestmark = pytest.mark.board

FLOATS = ("float_json", "float_struct")
OURS = ("spots", "spots_viper")
PATHS = OURS + FLOATS


@pytest.fixture(autouse=True)
def _all_paths_are_there(request):
    if "viper" in request.node.name:
        need_viper()


@pytest.mark.parametrize("path", OURS)
def test_a_sample_of_ours_takes_no_heap(results, path):
    assert results["firmware"][path]["heap_bytes_per_sample"] == 0


def test_arithmetic_and_framing_are_several_times_faster_by_viper(results, sensor, calibration):
    figures, ratios = results["firmware"], []
    for _ in range(5):  # other load on the computer only lowers the ratio
        ratios.append(figures["spots_viper"]["vm_time_ratio_of_portable_from_sums"])
        if ratios[-1] >= 5:
            break
        figures, _ = firmware.measure(sensor, firmware.for_canned_board(calibration))
    assert max(ratios) >= 5


@pytest.mark.parametrize("path", FLOATS)
def test_a_sample_in_floats_takes_heap(results, path):
    assert results["firmware"][path]["heap_bytes_per_sample"] > 0


@pytest.mark.parametrize("path", OURS)
def test_a_touch_frame_is_28_bytes_on_the_wire(results, path):
    assert results["firmware"][path]["wire_bytes_per_sample"] == 28


def test_a_line_of_json_is_several_times_as_long(results):
    assert results["firmware"]["float_json"]["wire_bytes_per_sample"] > 3 * 28


def test_both_paths_find_the_same_positions(results):
    # Otherwise the variants would not be timed at the same task.
    assert results["firmware"]["largest_position_difference_um"] <= 1


@pytest.mark.parametrize("path", PATHS)
@pytest.mark.parametrize("time", ["vm_us_per_sample", "vm_us_per_sample_from_counts"])
def test_every_path_has_its_time(results, path, time):
    assert results["firmware"][path][time] > 0


@pytest.mark.parametrize("path", FLOATS)
def test_ratios_are_those_of_the_times(results, path):
    ours, theirs = results["firmware"]["spots"], results["firmware"][path]
    for suffix in ("", "_from_counts"):
        ratio = theirs["vm_us_per_sample" + suffix] / ours["vm_us_per_sample" + suffix]
        assert theirs["vm_time_ratio_to_spots" + suffix] == pytest.approx(ratio, rel=0.01)
