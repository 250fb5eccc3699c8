"""Simulated creep and hysteresis of silicone: sizes as in the sensor file, only where pressed."""

import numpy as np
import pytest
from msgspec import structs

from spots_sim.strip.files import SensorFile, load
from spots_sim.strip.scenario import Held, Press
from spots_sim.strip.silicone import FULL_MN, Memory, Silicone
from spots_sim.strip.world import World

MODELS = ["spectrum", "power"]
PLACE_MM = 42.7


def pressed(memory, forces_mN, start_s=0.0, step_s=0.01, place_mm=PLACE_MM):
    """Return the effective forces in mN of a finger whose force changes every `step_s`."""
    found = []
    for i, force_mN in enumerate(forces_mN):
        press = [Press(place_mm, float(force_mN), 4.0)]
        found += memory.effective_mN(press, start_s + step_s * i)
    return np.array(found)


@pytest.mark.parametrize("model", MODELS)
def test_a_held_press_creeps_by_the_share_of_the_file_and_recovers(model):
    memory = Memory(Silicone(model=model, creep_percent=5.0))
    held = pressed(memory, [5000.0] * 6001)
    assert held[0] == pytest.approx(5000, abs=1)
    assert held[-1] == pytest.approx(5250, abs=2)
    # Creep is nearly linear in the logarithm of time: a decade has at least a sixth of the creep.
    assert held[600] - held[60] > 40
    assert memory.effective_mN([], 60.01) == []
    soon = pressed(memory, [5000.0], 61.0)[0]
    assert memory.effective_mN([], 61.01) == []
    assert soon > 5020 > pressed(memory, [5000.0], 90_000.0)[0]


@pytest.mark.parametrize("model", MODELS)
def test_unloading_is_above_loading_by_the_share_of_the_file(model):
    load_mN = np.linspace(0, FULL_MN, 500)
    memory = Memory(Silicone(model=model, hysteresis_percent=3.0))
    up, down = pressed(memory, load_mN), pressed(memory, load_mN[::-1], 5.0)[::-1]
    gap = down - up
    assert gap.max() == pytest.approx(300, rel=0.12)
    assert gap.min() > -1
    assert up == pytest.approx(load_mN, abs=1)  # a first load has no hysteresis
    slow = Memory(Silicone(model=model, hysteresis_percent=3.0))
    assert pressed(slow, load_mN, step_s=1.0) == pytest.approx(up, abs=1e-6)


@pytest.mark.parametrize("model", MODELS)
def test_the_first_load_softens_the_place_and_no_other(model):
    memory = Memory(Silicone(model=model, softening_percent=15.0))
    first = pressed(memory, [3000.0])[0]
    pressed(memory, [FULL_MN], 1.0)
    later = pressed(memory, [3000.0], 2.0)[0]
    assert later > 1.05 * first
    assert pressed(memory, [3000.0], 3.0, place_mm=10.0)[0] == pytest.approx(first)
    loaded = Memory(Silicone(model=model, softening_percent=15.0, preload_mN=FULL_MN))
    assert pressed(loaded, [3000.0])[0] == pytest.approx(later)


def test_an_ideal_material_costs_nothing_and_a_slow_press_reads_more(sensor):
    def counts(sensor):
        held = Held()
        held.press = Press(PLACE_MM, 3000.0, 4.0)
        world = World(sensor, held, np.random.default_rng(0))
        assert (world._memory is None) == sensor.silicone.ideal
        return [world.collect(10_000 * i, 10_000 * (i + 1), 20)["F8"] for i in range(300)]

    ideal = counts(sensor)
    slow = counts(structs.replace(sensor, silicone=Silicone(creep_percent=5.0)))
    assert slow[0] == pytest.approx(ideal[0], rel=1e-6)
    assert slow[-1] > 1.005 * ideal[-1]


def test_the_imperfect_strip_has_all_effects():
    silicone = load(SensorFile, "real").silicone
    assert min(silicone.creep_percent, silicone.hysteresis_percent, silicone.softening_percent) > 0
