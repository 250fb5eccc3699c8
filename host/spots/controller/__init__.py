"""A strip as a game controller: axes, buttons, filters, `spots controller`."""
