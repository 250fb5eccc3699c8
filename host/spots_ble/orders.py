"""Carries out ``spots radio``."""

from argparse import Namespace

from spots.link.connect import open_named


def radio_command(options: Namespace) -> None:
    """Print the bonded hosts of a board, let one bond, or delete a bond."""
    with open_named(options) as board:
        if options.order == "pair":
            reply = board.command("radio pair")
            print(
                f"Pair with {reply['name']} in the Bluetooth settings of the computer or phone in "
                f"the next {reply['seconds']} s. Passkey: {reply['passkey']}"
            )
            return
        words = ["radio", options.order, *([options.address] if options.order == "forget" else [])]
        reply = board.command(" ".join(words))
        print("\n".join(reply["hosts"]) or "no host is bonded: run 'spots radio pair'")
