"""Limits and state of `tracker.ContactTracker`, for all modules that process its readings.

A build for boards replaces these names by their values.
"""

# Limits for the detection of a second finger beside the first one.
SAME_UM = 450  # largest distance of a reading from the mean position of its finger
LOST = 337_000  # 0.8
MORE = 171_000  # 1.12
EVEN = 74_000  # 1.05
NEAR_UM = 2000
APART_UM = 4500  # least distance between two fingers
RISEN = 30_000  # 1.02: a finger arrives
REST_UM = 250  # largest difference between two readings of a position that stays
LIFTS_T = 9  # least time of a lift before its end is predicted
CALM = 40_000  # 1.03: largest change of the light of a finger that rests
# Share of an estimate's uncertainty that must be inside a key, in eighths: about two standard
# deviations.
SOON = 5
SURE_UM = 4000  # largest uncertainty of an estimate that is used
# Time is in ticks of 1.024 ms: the board's microseconds without their lower ten bits. Both wrap at
# the same moment, after this number of ticks.
TICKS = 1 << 22

# State of a tracker: indices in one array, because MicroPython is slow at objects with many
# attributes. The first three elements are the output of `locate` and `weigh`. Positions are in um,
# brightness (`B` in names) in Q20 of log2, times (`T` in names) in ticks; flags are 0 or 1.
# The machine code for an element up to 31 is the shortest: these are the elements that
# the modules of machine code use most.
FOUND_UM = 0
FOUND_SLACK_UM = 1
FOUND_B = 2
STATE = 3  # `UP`, `DOWN`, `SPENT` or `TWO`
X_UM = 4  # position of the first finger
KNOWN = 5  # in TWO: whether the position of the first finger is known
SEEN = 6  # consecutive readings that agree; -1 if the last one does not fit one press
X_SEEN_UM = 7  # position and brightness of the last reading
B_SEEN = 8
STEP_UM = 9  # motion between the last two readings; in TWO: away from the first finger
B = 10  # brightness of the first finger in the last three readings of it alone
B_BEFORE = 11
GUESSED = 12  # in TWO: whether there is an estimate of another finger
SINCE = 13  # time and brightness of the first reading at the present position
B_SINCE = 14
T = 15  # time of the last reading
IS_EVEN = 16  # the force of the first finger is steady
RISES = 17  # the force of the first finger rises
FALLS = 18  # whether the first finger lifts, and since when
FELL = 19
SECOND = 20  # whether a second finger is known
THIRD = 21  # there may be a third finger
PAIR = 22  # whether there was a reading in the state TWO
LOOSE = 23  # the position of the first finger is an estimate
PEAK = 24  # in TWO: largest brightness; least brightness since, and of all
LOW = 25
LEAST = 26
RESTED = 27  # whether the last reading was at the same position; whether it fits one press
FIT_SEEN = 28
HAS_DIPPED = 29  # the light was lost for a moment
DRIFTS = 30  # the finger alone did not fit one press: then the fit is no evidence
LENGTH_UM = 31  # length of the strip, see `set_layout` and `_NOISE`
B_OLDEST = 32
GUESSED_T = 33  # time of `GUESSED`
FLAGS_NOW = 34  # in TWO: flags of the present reading, and perhaps `CHECKED`
B_BOTH = 35  # last reading of two fingers that rest: brightness, fit, position
FIT_BOTH = 36
X_BOTH_UM = 37
X_PEAK_UM = 38  # position of `PEAK`
X_BEFORE_UM = 39  # position of the first finger, one reading earlier
FORCE_MN = 40  # force of the last reading that fits one press
X_PAIR_UM = 41  # last reading of two known fingers that rest: position, brightness
B_PAIR = 42
X_LAST_UM = 43  # in TWO: position and brightness of the reading before the present one
B_LAST = 44
STEP_LAST_UM = 45  # in TWO: element `STEP_UM` before this reading
X_GUESS_UM = 46  # estimate of another finger: position, brightness; see `SLACK_GUESS_UM`
B_GUESS = 47
STILL = 48  # since when a touch rests; limits of position and force in which it rests
LOW_UM = 49
HIGH_UM = 50
LOW_MN = 51
HIGH_MN = 52
STUCK_T = 53  # limits of the layout
RELEASE_MN = 54
JUMP_UM = 55
NOISE_PRODUCT = 56
ODD = 57  # a reading did not fit one press
IGNORED = 58  # the receiver needs no more positions of the first finger
HINT_UM = 59  # in TWO: unconfirmed estimate of the second finger nearest to the first one
LEAVING = 60  # whether no finger touches
# MicroPython encodes an index from -16 to 47 in one byte. The present reading: arguments of
# functions would need larger call frames, see strip.py.
X_NOW_UM = -16
B_NOW = -15
T_NOW = -14
FORCE_NOW_MN = -13
FITS = -12  # its spectrum fits one press
FIRM_MN = -11  # force of a firm press, until the firm press is reported
SLACK_GUESS_UM = -10  # uncertainty of the estimate of another finger
X_SECOND_UM = -9  # position and brightness of the second finger
B_SECOND = -8
IS_CALM = -7  # the force of the first finger is steady within a narrower limit
DECAY = -6
BEGAN = -5  # start of the present state
LEFT = -4  # since when no finger touches
PRESS_MN = -3  # limits of the layout
RELEASE_T = -2
DETECT = -1
SIZE = 77

NEVER = 1 << 29  # a time or force that is never reached

# States of a tracker.
UP = 0  # no finger
DOWN = 1  # one finger
SPENT = 2  # the finger or object must be lifted before the next touch
TWO = 3  # perhaps several fingers

CHECKED = 256  # in `FLAGS_NOW`: `tracker.ContactTracker.take` has checked the flags

# Results of `pair.watch`: bits, or one of the numbers.
SINGLE = 1  # the light changed, but not the position: one finger remains
ENDS = 2  # the first finger has almost left
REMAINS = 4  # only one finger seems to touch
FOUND = 8  # a second finger is found
MOVED = 16  # number: two fingers rest; new estimate of the second one
NEXT = 17  # number: the first finger had almost left, and a third finger arrives
LIFTED = 18  # number: the first finger has left
# Numbers with the uncertainty of a third finger's position in um, in the bits from 8 on:
SAME = 19  # a third finger touches while two fingers rest
FADED = 20  # the first finger has left, or a third finger touches; the uncertainty may be 0
