"""The page ``live``: the firmware in a browser tab, on a simulated strip or with a board on USB."""
