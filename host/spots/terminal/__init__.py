"""What a board feels, as a picture or as lines in a terminal."""
