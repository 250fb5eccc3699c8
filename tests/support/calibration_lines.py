"""Lines of a calibration that a board accepts."""

GOOD = """\
board 00ff
plan F3 F4 F5 F6 F7 F8
made 9 10000 20
touch 300 200
coarse -4096 -4096 0 0 4096 4096
fit 8192 -8192 0 0 0 0
segment -8192 0 0 0 0 8192 0 0 0 0 0 8192
segment 0 -8192 0 0 0 8192 0 0 0 0 8192 0
f 1000 200 900
f 100000 6000 90
strain 0
from 0
x 0 0 5 100
x 100000 8000 5 200
from 90000
x 90000 7000 5 0
x 200000 16000 5 -100
strain 100000
from 0
x 0 0 5 300
x 80000 8800 5 400
from 70000
x 70000 7700 5 0
x 160000 17600 5 100
""".splitlines()
