"""What a strip is good for: built on the readings of a board, and nothing else."""
