"""The command line; ``spots --help`` lists the commands."""

from __future__ import annotations

import argparse
import os
import sys

from .. import __version__
from ..errors import SpotsError
from . import boards, calibrations, look, proofs, recordings, remote, uses

# In the order in which `spots --help` lists their commands.
_GROUPS = boards, look, uses, calibrations, recordings, remote, proofs


def main(arguments: list[str] | None = None) -> int:
    """Run a command; a mistake of the user's is one sentence and exit code 2."""
    options = _parser().parse_args(arguments)
    if getattr(options, "zenoh_config", None):
        os.environ["ZENOH_CONFIG"] = options.zenoh_config  # Zenoh's own name for it
    try:
        options.run(options)
    except SpotsError as error:
        print(f"spots: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    except BrokenPipeError:
        # Whoever read our output has seen enough.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="spots", description="SPOTS tactile sensor, host side")
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(metavar="COMMAND", required=True)
    for group in _GROUPS:
        group.add(commands)
    return parser
