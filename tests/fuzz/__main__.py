"""Fuzzes a function of `targets`: searches for bytes that make it fail or reach new code.

Bytes that reach new code are stored as inputs of the tests.
"""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).parent
sys.path.insert(0, str(HERE.parent))

import kept  # noqa: E402
from targets import TARGETS  # noqa: E402

FOUND = HERE.parents[1] / "build" / "fuzz"
FILES_MAX = 90
BYTES_MAX = 16_000
LENGTH_MAX = 4096
# Long enough on a computer under load; still detects a target that hangs.
_STUCK_S = 60
_OPTIONS = (f"-max_len={LENGTH_MAX}", f"-timeout={_STUCK_S}", "-print_final_stats=1")
_FOUND = 1


def main() -> int:
    """Fuzz one target, or list all targets if no name is given; return the exit code."""
    parser = argparse.ArgumentParser(prog="fuzz", description=__doc__)
    parser.add_argument("target", nargs="?", choices=TARGETS, metavar="TARGET")
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    if options.target is None:
        print("\n".join(f"{name:18} {made.__doc__}" for name, made in TARGETS.items()))
        return 0
    return _fuzz(options.target, options.seconds, options.seed)


def _fuzz(target: str, seconds: int, seed: int) -> int:
    FOUND.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as folder:
        new, least, corpus = (Path(folder, name) for name in ("new", "least", "corpus"))
        for path in (new, least, corpus):
            path.mkdir()
        for name, data in kept.kept(target).items():
            (corpus / name).write_bytes(data)
        told = _engine(
            target,
            *(f"-max_total_time={seconds}", f"-seed={seed}", f"-artifact_prefix={FOUND}/{target}-"),
            *(new, corpus),
        )
        tried = re.search(r"number_of_executed_units: (\d+)", told)
        found = re.findall(r"Test unit written to (\S+)", told)
        count = tried[1] if tried else "?"
        print(f"{target}: {count} inputs tried in {seconds} s, {len(found)} failed")
        if found or tried is None:
            print(told[-4000:])
            print(f"run it again: {sys.executable} {HERE}/engine.py {target} {' '.join(found)}")
            return _FOUND
        _engine(target, "-merge=1", least, corpus, new)
        _keep(target, least)
    return 0


def _engine(target: str, *arguments) -> str:
    command = [sys.executable, str(HERE / "engine.py"), target, *_OPTIONS, *map(str, arguments)]
    return subprocess.run(command, stderr=subprocess.STDOUT, stdout=-1, text=True).stdout


def _keep(target: str, least: Path) -> None:
    """Replace the stored inputs of a target that fuzzing found.

    The new ones are the shortest inputs in the folder `least`, up to the limits of number and size.
    """
    known = kept.named(target).values()
    room_files, room_bytes = FILES_MAX - len(known), BYTES_MAX - sum(map(len, known))
    chosen = []
    for data in sorted((path.read_bytes() for path in least.iterdir()), key=lambda d: (len(d), d)):
        room_files -= 1
        room_bytes -= len(data)
        if room_files < 0 or room_bytes < 0:
            break
        if data not in known:
            chosen.append(data)
    kept.keep(target, chosen)


if __name__ == "__main__":
    sys.exit(main())
