"""The unique id of a virtual board: a hash of its sensor file, without ``[change]``."""

from __future__ import annotations

import hashlib

import msgspec

from ..strip.change import Temperature
from ..strip.files import SensorFile
from ..strip.silicone import Silicone

# Keys that later versions of the sensor file added, with their defaults. A key that has its default
# does not affect the id, so a file without the key has the same id as before.
_LATER = {
    ("temperature", None): msgspec.to_builtins(Temperature()),
    ("silicone", None): msgspec.to_builtins(Silicone()),
    ("led", "wired"): "ldr",
    ("led", "fixed_mA"): 20.0,
    ("surroundings", "flicker_phase_deg"): 0.0,
    ("converter", "ratio_noise_ppm"): 0.0,
    ("contact", "gap_percent"): 0.0,
    ("contact", "mode_percent"): 0.0,
    ("contact", "dust"): (),
    ("contact", "sticking_percent"): 0.0,
    ("contact", "sticking_s"): 1.0,
    ("contact", "skin_percent"): 0.0,
    ("led", "spectrum"): (),
    ("dye", "spectrum"): (),
    ("dye", "uneven_percent"): 0.0,
    ("dye", "uneven_mm"): 30.0,
    ("dye", "uneven_phase_deg"): 0.0,
    ("dye", "far_end_percent"): 0.0,
    ("stretch", "bend_path_percent"): 0.0,
    ("stretch", "bend_mm"): 20.0,
    ("stretch", "bend_at_percent"): 50.0,
    ("surroundings", "shaded_percent"): 0.0,
}


def board_id(sensor: SensorFile, number: int = 0) -> str:
    """Return the id of a virtual board: 8 bytes in hexadecimal.

    `number`, such as the seed, distinguishes boards with the same sensor file. The table
    ``[change]`` does not affect the id: a changed strip is on the same board.
    """
    keys = msgspec.to_builtins(sensor)
    del keys["change"]
    for (table, key), default in _LATER.items():
        within, name = (keys, table) if key is None else (keys[table], key)
        if within[name] == default:
            del within[name]
    if number:
        keys["number"] = number
    return hashlib.sha256(msgspec.json.encode(keys)).hexdigest()[:16]
