"""Record a board and plot it meanwhile: python examples/record_and_plot.py FILE.spots [PORT].

Needs matplotlib (pip install 'spots-tactile[plots]'). Closing the window ends the recording; then
try spots info FILE.spots, spots replay FILE.spots, spots export FILE.spots --to npz.
"""

import sys
from collections import deque

import matplotlib.pyplot as plt

import spots

DRAW_EVERY_S = 0.1
path, port = sys.argv[1], sys.argv[2] if len(sys.argv) > 2 else "virtual"
figure, (place, force) = plt.subplots(2, sharex=True)
place.set(ylabel="position / mm", ylim=(0, 100))
force.set(ylabel="force / N", ylim=(0, 10), xlabel="time / s")
(place_dots,), (force_dots,) = place.plot([], [], "."), force.plot([], [], ".")

with spots.open(port) as board, board.record(path):
    start_s, drawn_s = board.now_s(), 0.0
    recent: deque[tuple[float, float, float]] = deque(maxlen=1000)
    for touch in board.touches():
        if touch.trusted and touch.time_s is not None:
            recent.append((touch.time_s - start_s, touch.position_um / 1e3, touch.force_mN / 1e3))
        if board.now_s() - drawn_s >= DRAW_EVERY_S:
            drawn_s, now_s = board.now_s(), board.now_s() - start_s
            times_s, places_mm, forces_N = zip(*recent) if recent else ((), (), ())
            place_dots.set_data(times_s, places_mm)
            force_dots.set_data(times_s, forces_N)
            force.set_xlim(now_s - 10, now_s)
            plt.pause(0.001)
        if not plt.fignum_exists(figure.number):
            break
