"""Commands for boards on other machines."""

from __future__ import annotations

import argparse

from . import arguments


def add(commands) -> None:
    """Add the commands to a parser's subparsers."""
    publish = commands.add_parser("publish", help="a board for other machines, over Zenoh")
    arguments.add_port(publish)
    publish.add_argument("--seconds", type=arguments.seconds, help="end after so long")
    publish.set_defaults(run=_publish)

    subscribe = commands.add_parser("subscribe", help="print what boards elsewhere feel, by Zenoh")
    subscribe.add_argument(
        "expression",
        nargs="?",
        default="spots/*/*/touch",
        metavar="EXPR",
        help="of keys, such as spots/**; the touches of all boards if not given",
    )
    subscribe.add_argument("--json", action="store_true", help="every sample, a JSON object a line")
    subscribe.add_argument("--seconds", type=arguments.seconds, help="end after so long")
    arguments.add_zenoh_config(subscribe)
    subscribe.set_defaults(run=_subscribe)


def _publish(options: argparse.Namespace) -> None:
    from ..remote.publish import publish_command

    publish_command(options)


def _subscribe(options: argparse.Namespace) -> None:
    from ..remote.subscribe import subscribe_command

    subscribe_command(options)
