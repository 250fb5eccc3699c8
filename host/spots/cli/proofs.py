"""Commands that measure the project itself."""

from __future__ import annotations

import argparse
import json

from . import arguments


def add(commands) -> None:
    """Add the commands to a parser's subparsers."""
    bench = commands.add_parser("bench", help="driver, firmware and host against their peers")
    bench.add_argument("--json", action="store_true", help="one JSON object")
    bench.set_defaults(run=_bench)

    soak = commands.add_parser("soak", help="hours of faults in simulated time, and a ledger")
    soak.add_argument("--hours", type=arguments.hours, default=1.0, help="of simulated time (1)")
    soak.add_argument(
        *("--faults", "--scenario"), default="fire", metavar="FILE", help="scenario file or name"
    )
    soak.add_argument("--sensor", default="default", metavar="FILE", help="sensor file or name")
    soak.add_argument("--seed", type=arguments.seed, default=0, help="of noise and faults")
    soak.add_argument("--json", action="store_true", help="one JSON object")
    soak.set_defaults(run=_soak)


def _bench(options: argparse.Namespace) -> None:
    from bench import report, run

    results = run()
    print(json.dumps(results) if options.json else report(results))


def _soak(options: argparse.Namespace) -> None:
    from soak.soak import run

    run(options.hours, options.faults, options.seed, options.sensor, options.json)
