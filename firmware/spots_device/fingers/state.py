"""Limits and state of `tracker.ContactTracker`, for all modules that process its readings.

A build for boards replaces these names by their values.
"""

# Time is in ticks of 1.024 ms: the board's microseconds without their lower ten bits. Both wrap at
# the same moment, after this number of ticks.
TICKS = 1 << 22
NEVER = 1 << 29  # a time or force that is never reached

# Ratios of light as differences of brightness, Q20 of log2.
RISEN = 30_000  # 1.02: a finger arrives
CALM = 40_000  # 1.03: largest change of the light of a finger that rests
EVEN = 74_000  # 1.05
CHANGED = 150_000  # 1.1: with two fingers, this change of light moves the position
MORE = 171_000  # 1.12
LOST = 337_000  # 0.8
# The misfit grows with the loss of brightness that two fingers cause, in Q20 of log2. The loss is
# below `LOSS_FIT` if the reading fits one press, and above `LOSS_MISFIT` if it does not.
LOSS_FIT = 45_000
LOSS_MISFIT = 2_000

# Distances in um.
REST_UM = 250  # largest difference between two readings of a position that stays
SAME_UM = 450  # largest distance of a reading from the mean position of its finger
NEAR_UM = 2000
SURE_UM = 4000  # largest uncertainty of an estimate that is used
APART_UM = 4500  # least distance between two fingers
FAST_UM = 20_000  # least step of a position that does not yet approach the second finger
NOISE_MAX_UM = 20_000  # largest result of `locate.noise`
FAR_LOG2 = 18  # distances are below 2**18 um
# Share of an estimate's uncertainty that must be inside a key, in eighths: about two standard
# deviations.
SOON = 5

# Times in ticks.
LIFTS_T = 9  # least time of a lift before its end is predicted
REST_T = 12  # least time for which the position must stay
FALL_T = 34  # longest time in which a finger lifts

SEEN_MAX = 99  # largest stored number of readings that agree

# State of a tracker: indices in one array, because MicroPython is slow at objects with many
# attributes. The first three elements are the output of `locate` and `weigh`. Units: um; Q20 of
# log2 for brightness (`B` in names); ticks for times (`T` in names); bool is 0 or 1.
FOUND_UM = 0  # um: estimated position
FOUND_SLACK_UM = 1  # um: its uncertainty
FOUND_B = 2  # Q20: brightness of this finger
STATE = 3  # `UP`, `DOWN`, `SPENT` or `TWO`
X_UM = 4  # um: position of the first finger
KNOWN = 5  # bool, in TWO: the position of the first finger is known
SEEN = 6  # readings: how many in a row agree; -1 if the last one does not fit one press
X_SEEN_UM = 7  # um: position of the last reading
B_SEEN = 8  # Q20: brightness of the last reading
STEP_UM = 9  # um: motion between the last two readings; in TWO: away from the first finger
B = 10  # Q20: brightness of the first finger in its last reading alone
B_BEFORE = 11  # Q20: brightness one reading earlier
GUESSED = 12  # bool, in TWO: there is an estimate of another finger
SINCE = 13  # ticks: time of the first reading at the present position
B_SINCE = 14  # Q20: brightness of this reading
T = 15  # ticks: time of the last reading
IS_EVEN = 16  # bool: the force of the first finger is steady
RISES = 17  # bool: the force of the first finger rises
FALLS = 18  # bool: the first finger lifts
FELL = 19  # ticks: since when it lifts
SECOND = 20  # bool: a second finger is known
BEGAN = 21  # ticks: start of the present state
PAIR = 22  # bool: there was a reading in the state TWO
LOOSE = 23  # bool: the position of the first finger is an estimate
PEAK = 24  # Q20, in TWO: largest brightness
GUESSED_T = 25  # ticks: time of `GUESSED`
LEAST = 26  # Q20, in TWO: least brightness
WAS_STILL = 27  # bool: the last reading was at the same position
FIT_SEEN = 28  # bool: the last reading fits one press
LEFT = 29  # ticks: since when no finger touches
DRIFTS = 30  # bool: the finger alone did not fit one press, so the fit is no evidence
LENGTH_UM = 31  # um: length of the strip, see `set_layout` and `_NOISE`
# Machine code uses the elements from `LATE` on by a second pointer, because it is shorter for the
# first 32 elements after a pointer. `locate_viper.light` needs the next four in this order. In
# portable code, an element up to 47 is one byte shorter.
LATE = 32
X_LAST_UM = 32  # um, in TWO: position of the reading before the present one
B_LAST = 33  # Q20, in TWO: brightness of the reading before the present one
X_NOW_UM = 34  # um: position of the present reading
B_NOW = 35  # Q20: brightness of the present reading
T_NOW = 36  # ticks: time of the present reading
FORCE_NOW_MN = 37  # mN: force of the present reading
FITS = 38  # bool: the spectrum of the present reading fits one press
X_GUESS_UM = 39  # um: estimated position of another finger
B_GUESS = 40  # Q20: estimated brightness of this finger
SLACK_GUESS_UM = 41  # um: uncertainty of `X_GUESS_UM`
X_SECOND_UM = 42  # um: position of the second finger
B_SECOND = 43  # Q20: brightness of the second finger
HINT_UM = 44  # um, in TWO: unconfirmed estimate of the second finger nearest to the first one
FIRM_MN = 45  # mN: force of a firm press, until the firm press is reported
LEAVING = 46  # bool: no finger touches
NOISE_PRODUCT = 47  # counts times um, see `locate.noise`
STEP_LAST_UM = 48  # um, in TWO: element `STEP_UM` before the present reading
X_PEAK_UM = 49  # um: position of `PEAK`
B_BOTH = 50  # Q20: brightness of the last reading of two fingers that rest
X_PAIR_UM = 51  # um: position of the last reading of two known fingers that rest
B_PAIR = 52  # Q20: brightness of this reading
X_BEFORE_UM = 53  # um: position of the first finger, one reading earlier
FORCE_MN = 54  # mN: force of the last reading that fits one press
STILL = 55  # ticks: since when a touch rests
LOW_UM = 56  # um: least position in which it rests
HIGH_UM = 57  # um: largest position in which it rests
LOW_MN = 58  # mN: least force in which it rests
HIGH_MN = 59  # mN: largest force in which it rests
STUCK_T = 60  # ticks: limit of the layout
RELEASE_MN = 61  # mN: limit of the layout
ODD = 62  # bool: a reading did not fit one press
DECAY = 63  # log2 units per um times 2**24: decay of the light by the dye
# Elements that machine code uses seldom or not at all.
FLAGS_NOW = 64  # bits, in TWO: flags of the present reading, and perhaps `CHECKED`
FIT_BOTH = 65  # bool: the reading of `B_BOTH` fits one press
X_BOTH_UM = 66  # um: position of the reading of `B_BOTH`
B_OLDEST = 67  # Q20: brightness of the first finger, two readings earlier
IGNORED = 68  # bool: the receiver needs no more positions of the first finger
DETECT = 69  # readings: limit of the layout
PRESS_MN = 70  # mN: limit of the layout
RELEASE_T = 71  # ticks: limit of the layout
JUMP_UM = 72  # um: limit of the layout
# Cross-sensitivity of the strip, see `pair._separate`.
CROSS_NEAR_UM = 73  # um: change of its correction from the weakest to the strongest light, at 0
CROSS_FAR_UM = 74  # um: at the far end of the strip
CROSS_B = 75  # Q20: the strongest light, as brightness
CROSS_UM = 76  # um, in TWO: what was added to the position of the present reading
SIZE = 77

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
PASSED = 17  # number: the first finger has left, and another one touches beside the second one
LIFTED = 18  # number: the first finger has left
# Numbers with the uncertainty of a third finger's position in um, in the bits from 8 on:
SAME = 19  # a third finger touches while two fingers rest
FADED = 20  # the first finger has left, or a third finger touches; the uncertainty may be 0
