"""Measures time and memory for a sample, with the firmware's integers and with simple floats.

Both variants run in the same MicroPython, on the same simulated registers (module `canned`). The
times favour the floats: this computer computes them in hardware, a microcontroller often in
software. Numbers of bytes are the same on this computer and on a microcontroller.

The firmware is also measured with its kernel compiled to machine code, if MicroPython can do that
on this processor.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import tempfile
from pathlib import Path
from statistics import median

import spots_device
from spots.deploy.constants import inline
from spots.deploy.staging import use_viper
from spots.errors import SpotsError
from spots.link.decoder import Decoder
from spots_sim.board.vm import micropython_command
from spots_sim.strip.files import SensorFile

from .presses import counts_of_presses

_HERE = Path(__file__).parent
_SCRIPTS = ("canned.py", "floats.py", "onboard.py")
_CANNED_BOARD = "board 00"
# Enough for the garbage of a whole round, which is not collected during the round.
_HEAP = "heapsize=16m"
_SAMPLES_OF_A_PRESS = 4
_REPEATS = 8
_ROUNDS = 9
_TIMEOUT_S = 120
_RATIOS = {
    "vm_us_per_sample": "vm_time_ratio_to_spots",
    "vm_us_per_sample_from_counts": "vm_time_ratio_to_spots_from_counts",
}


def measure(sensor: SensorFile, calibration: list[str]) -> tuple[dict, bytes]:
    """Measure all ways to process a sample, in MicroPython.

    Parameters
    ----------
    sensor : files.SensorFile
        Simulated sensor.
    calibration : list of str
        Lines of its calibration, for the board of `canned`.

    Returns
    -------
    figures : dict
        A dict for each way to process a sample: ``spots`` is the firmware, ``spots_viper`` the
        firmware with machine code, ``float_json`` and ``float_struct`` are the floats of `floats`.
        Each has bytes, times on this computer, and ratios to the firmware. The times are of a whole
        sample, of the part after its counts were read, and for the firmware also of arithmetic and
        framing alone. Another item is the largest difference between the positions that integers
        and floats give.
    stream : bytes
        Some hundred different TOUCH frames from the firmware.

    Raises
    ------
    SpotsError
        If MicroPython is not installed.
    """
    inputs = {
        "calibration": calibration,
        "counts": counts_of_presses(sensor, _SAMPLES_OF_A_PRESS),
        "repeats": _REPEATS,
        "rounds": _ROUNDS,
    }
    found = _in_micropython(inputs)
    figures = {name: _summary(path) for name, path in found["paths"].items()}
    ours = figures["spots"]
    if "spots_viper" in figures:
        figures["spots_viper"]["vm_time_ratio_of_portable_from_sums"] = _ratio(
            found["paths"]["spots"], found["paths"]["spots_viper"], "vm_us_from_sums"
        )
    for name, ratio in _RATIOS.items():
        for peer in ("float_json", "float_struct"):
            figures[peer][ratio] = round(figures[peer][name] / ours[name], 3)
    stream = bytes.fromhex(found["stream"])
    figures["largest_position_difference_um"] = _largest_difference_um(stream, found["lines"])
    return figures, stream


def _largest_difference_um(stream: bytes, lines: list[str]) -> float:
    ours = [touch.position_um for touch in Decoder().feed(stream)]
    theirs = [json.loads(line)["position_mm"] * 1000 for line in lines]
    return round(max(abs(a - b) for a, b in zip(ours, theirs, strict=True)), 1)


def for_canned_board(calibration: tuple[str, ...]) -> list[str]:
    """Return the lines of a calibration, changed to be valid on the board of `canned`."""
    return [_CANNED_BOARD if line.startswith("board ") else line for line in calibration]


def _in_micropython(inputs: dict) -> dict:
    with tempfile.TemporaryDirectory(prefix="spots-") as name:
        folder = Path(name)
        for package in ("spots_device", "spots_device_viper"):
            shutil.copytree(
                Path(spots_device.__file__).parent,
                folder / package,
                ignore=shutil.ignore_patterns("__pycache__"),
            )
        use_viper(folder / "spots_device_viper")
        inline(folder / "spots_device_viper")  # machine code looks up no name
        return run_script(folder, inputs, *_SCRIPTS)


def run_script(folder: Path, inputs: dict, *scripts: str) -> dict:
    """Copy scripts into a folder, run the last one in MicroPython, and return its result (dict).

    Parameters
    ----------
    folder : Path
        Folder with the firmware's package.
    inputs : dict
        Content of the file inputs.json, which the script reads.
    scripts : str
        Names of files in this package. The last script must print one JSON object.

    Raises
    ------
    SpotsError
        If the script fails.
    """
    for script in scripts:
        shutil.copy(_HERE / script, folder)
    (folder / "inputs.json").write_text(json.dumps(inputs), encoding="utf-8")
    done = subprocess.run(
        [*micropython_command(), "-X", _HEAP, scripts[-1]],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=_TIMEOUT_S,
    )
    if done.returncode != 0:
        said = (done.stdout + done.stderr).strip().splitlines() or ["no output"]
        raise SpotsError(f"the benchmark failed in MicroPython: {said[-1]}")
    return json.loads(done.stdout)


def _ratio(slow: dict, fast: dict, name: str) -> float:
    # Compares the fastest rounds, because other load on this computer only lengthens a time.
    return round(min(slow[name]) / min(fast[name]), 2)


def _summary(path: dict) -> dict:
    summary = {
        "heap_bytes_per_sample": round(path["heap_bytes_per_sample"], 1),
        "wire_bytes_per_sample": round(path["wire_bytes_per_sample"], 1),
        "vm_us_per_sample": round(median(path["vm_us"]), 2),
        "vm_us_per_sample_from_counts": round(median(path["vm_us_from_counts"]), 2),
    }
    if path["vm_us_from_sums"]:
        summary["vm_us_per_sample_from_sums"] = round(median(path["vm_us_from_sums"]), 2)
    return summary
