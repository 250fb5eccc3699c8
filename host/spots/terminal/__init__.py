"""Shows the readings of a board in a terminal, as a picture or as lines."""
