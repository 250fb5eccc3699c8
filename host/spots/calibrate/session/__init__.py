"""Sessions with a board and a person: they ask for presses, wait, and show the result."""
