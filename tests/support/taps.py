"""A scenario with taps twice a second."""

# Taps twice a second, so that the start of the host does not matter. All taps are at one position,
# because on a busy machine the time of a reading is uncertain. They begin and end with their full
# force: a reading that is compared with the finger then has at least half of its light. The error
# of a fainter reading can exceed 2 mm, and it depends on chance how many there are.
TAPS = """
seconds = 0.5
[[touch]]
points = [[0.10, 42.5, 3000], [0.35, 42.5, 3000]]
"""
