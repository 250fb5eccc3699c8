"""Limits and state of `contact.ContactTracker`; its modules `contact` and `evidence` use them.

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
REST_UM = 250  # largest difference between two readings of a resting position
LIFTS_T = 9  # least time of a lift before its end is predicted
CALM = 40_000  # 1.03: the light of a finger at rest
# Share of an estimate's uncertainty that must be inside a key, in eighths: about two standard
# deviations.
SOON = 5
# Time is in ticks of 1.024 ms: the board's microseconds without their lower ten bits. Both wrap at
# the same moment, after this number of ticks.
TICKS = 1 << 22

# State of a tracker: indices in one array, because MicroPython is slow at objects with many
# attributes. The first three elements are the output of `locate` and `weigh`. Positions are in um,
# brightness (`B` in names) in Q20 of log2, times (`T` in names) in ticks; flags are 0 or 1.
FOUND_UM = 0
FOUND_SLACK_UM = 1
FOUND_B = 2
STATE = 3
X_UM = 4  # position of the first finger
FORCE_MN = 5  # force of the last reading that fits one press
KNOWN = 6  # in TWO: whether the position of the first finger is known
SEEN = 7  # consecutive readings that agree; -1 if the last one does not fit one press
X_BEFORE_UM = 8  # position of the first finger, one reading earlier
X_SEEN_UM = 9  # position and brightness of the last reading
B_SEEN = 10
STEP_UM = 11  # motion between the last two readings; in TWO: away from the first finger
B = 12  # brightness of the first finger in the last three readings of it alone
B_BEFORE = 13
B_OLDEST = 14
SINCE = 15  # time and brightness of the first reading at the present position
B_SINCE = 16
T = 17  # time of the last reading
BEGAN = 18  # start of the present state
IS_EVEN = 19  # the force of the first finger is steady
IS_CALM = 20  # the force of the first finger is steady within a lower limit
RISES = 21  # the force of the first finger rises
FALLS = 22  # whether the first finger lifts, and since when
FELL = 23
SECOND = 24  # whether a second finger is known; position and brightness of it
X_SECOND_UM = 25
B_SECOND = 26
THIRD = 27  # there may be a third finger
PAIR = 28  # whether there was a reading in the state TWO
LOOSE = 29  # the position of the first finger is an estimate
PEAK = 30  # in TWO: largest brightness and its position; least brightness since, and of all
X_PEAK_UM = 31
LOW = 32
LEAST = 33
RESTED = 34  # whether the last reading was at the same position; whether it fits one press
FIT_SEEN = 35
X_BOTH_UM = 36  # last reading of two fingers that rest: position, brightness, fit
B_BOTH = 37
FIT_BOTH = 38
GUESSED = 39  # whether there is an estimate of another finger, and since when
GUESSED_T = 40
X_GUESS_UM = 41  # this estimate: position, brightness and uncertainty of the other finger
B_GUESS = 42
SLACK_GUESS_UM = 43
DRIFTS = 44  # the finger alone did not fit one press: then the fit is no evidence
LEAVING = 45  # whether no finger touches, and since when
LEFT = 46
HAS_DIPPED = 47  # the light was lost for a moment
X_PAIR_UM = 48  # last reading of two known fingers that rest: position, brightness
B_PAIR = 49
HINT_UM = 50  # in TWO: unconfirmed estimate of the second finger nearest to the first one
X_LAST_UM = 51  # in TWO: position and brightness of the reading before the present one
B_LAST = 52
STEP_LAST_UM = 53  # in TWO: element `STEP_UM` before this reading
STILL = 54  # since when a touch rests; limits of position and force in which it rests
LOW_UM = 55
HIGH_UM = 56
LOW_MN = 57
HIGH_MN = 58
# MicroPython encodes an index from -16 to 47 in one byte.
ODD = -16  # a reading did not fit one press
# The present reading: arguments of functions would need larger call frames, see strip.py.
X_NOW_UM = -15
B_NOW = -14
T_NOW = -13
FORCE_NOW_MN = -12
FITS = -11  # its spectrum fits one press
FIRM_MN = -10  # force of a firm press, until the firm press is reported
LENGTH_UM = -9  # length of the strip, see `set_layout` and `_NOISE`
DECAY = -8
NOISE_PRODUCT = -7
RELEASE_MN = -6  # from here on: limits of the layout
PRESS_MN = -5
STUCK_T = -4
DETECT = -3
JUMP_UM = -2
RELEASE_T = -1
SIZE = 75
