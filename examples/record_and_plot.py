"""Record a board and plot its readings; closing the window ends the recording.

This needs matplotlib: pip install -e ".[plots]". Use the recording with
spots info FILE.spots, spots replay FILE.spots or spots export FILE.spots --to npz.
"""

import argparse
import signal
import threading
from collections import deque

import spots

DRAW_EVERY_S = 0.1

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("file", metavar="FILE.spots", help="recording to write; must not exist")
parser.add_argument(
    "port", nargs="?", default="virtual", help="port of the board; default: a simulated board"
)
options = parser.parse_args()

try:
    import matplotlib.pyplot as plt
except ImportError:
    parser.error('matplotlib is not installed: pip install -e ".[plots]"')

figure, (place, force) = plt.subplots(2, sharex=True)
place.set(ylabel="position / mm", ylim=(0, 100))
force.set(ylabel="force / N", ylim=(0, 10), xlabel="time / s")
(place_dots,), (force_dots,) = place.plot([], [], "."), force.plot([], [], ".")

try:
    with spots.open(options.port) as board, spots.Recorder(board, options.file):
        # matplotlib's callbacks can lose a KeyboardInterrupt, so Ctrl-C only sets an event.
        stop = threading.Event()
        signal.signal(signal.SIGINT, lambda number, frame: stop.set())
        start_s, drawn_s = board.now_s(), 0.0
        recent: deque[tuple[float, float, float]] = deque(maxlen=1000)
        for touch in board.touches():
            if touch.trusted and touch.time_s is not None:
                recent.append(
                    (touch.time_s - start_s, touch.position_um / 1e3, touch.force_mN / 1e3)
                )
            if board.now_s() - drawn_s >= DRAW_EVERY_S:
                drawn_s, now_s = board.now_s(), board.now_s() - start_s
                times_s, places_mm, forces_N = zip(*recent) if recent else ((), (), ())
                place_dots.set_data(times_s, places_mm)
                force_dots.set_data(times_s, forces_N)
                force.set_xlim(now_s - 10, now_s)
                plt.pause(0.001)
            if stop.is_set() or not plt.fignum_exists(figure.number):
                break
except KeyboardInterrupt:
    pass  # Ctrl-C before the first reading
except spots.SpotsError as error:
    parser.error(str(error))
