"""A strip as a game controller: axes, buttons, filters, and ``spots controller``."""
