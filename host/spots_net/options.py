"""Options of the port ``zenoh:ID``; Zenoh is loaded when a board is opened."""

import argparse
import os


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the option for Zenoh's configuration file."""
    text = "configuration file of Zenoh; if not given, the variable ZENOH_CONFIG names it"
    parser.add_argument("--zenoh-config", metavar="FILE", help=text)


def configure(options: argparse.Namespace | None) -> None:
    """Let the option for Zenoh's configuration file, if it is given, replace the variable."""
    if file := getattr(options, "zenoh_config", None):
        os.environ["ZENOH_CONFIG"] = file  # Zenoh's own name
