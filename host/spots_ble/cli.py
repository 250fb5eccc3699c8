"""The command ``spots radio``: the hosts that are bonded with a board."""

from spots.cli import arguments
from spots.cli.parser import Parser, calls

PURPOSE = "set up a board"


def radio(parser: Parser):
    """Pair a board that has Bluetooth LE with computers and phones.

    examples:
      spots radio pair
      spots radio forget c0:c1:c2:c3:c4:c5
    """
    orders = parser.add_subparsers(dest="order", required=True, metavar="ORDER")
    for name, text in (
        ("list", "print the bonded hosts"),
        ("pair", "let a host bond in the next 60 s, and print the passkey that it asks for"),
        ("forget", "delete the bond with a host"),
    ):
        one = orders.add_parser(name, help=text, description=text)
        arguments.add_port(one)
        if name == "forget":
            one.add_argument("address", metavar="ADDRESS", help="address in 'spots radio list'")
    return calls("spots_ble.orders:radio_command")
