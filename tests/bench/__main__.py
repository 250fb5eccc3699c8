"""``make bench``: prints the benchmarks as a report, or as one JSON object with ``--json``."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from bench import report, run
from spots.errors import SpotsError


def main(arguments: list[str] | None = None) -> int:
    """Run every benchmark and print the results; return the exit code: 0, or 2 after an error."""
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__)
    parser.add_argument("--json", action="store_true", help="one JSON object")
    options = parser.parse_args(arguments)
    try:
        results = run()
    except SpotsError as error:
        print(f"bench: {error}", file=sys.stderr)
        return 2
    print(json.dumps(results) if options.json else report(results))
    return 0


if __name__ == "__main__":
    sys.exit(main())
