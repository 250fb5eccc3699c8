"""A scenario with taps twice a second."""

# Taps twice a second, so that the start of the host does not matter. All taps are at one position,
# because on a busy machine the time of a reading is uncertain.
TAPS = """
seconds = 0.5
[[touch]]
points = [[0.10, 42.5, 0], [0.15, 42.5, 3000], [0.30, 42.5, 3000], [0.35, 42.5, 0]]
"""
