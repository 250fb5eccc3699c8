"""Estimates the light that lifted fingers leave, because contact of soft guides sticks for a while.

After a lift, a small share of the contact may remain and decay. Its light would move the position
of the next press, and could look like a finger that rests. So a touch ends when the light is far
below its own peak (`kernel.estimate`), and the remaining light is subtracted from the next readings
as part of `decode.FLOOR`. It is measured while nothing touches; during a touch it decays with the
rate that was learned while nothing touched.

Boards with ``viper = true`` in board.toml get sticking_viper.py instead of this file, with
identical results, in machine code. All integers fit 31 bits; allocates nothing.
"""

from ..sensor.smux import CHANNELS
from . import decode as d


def unstick(state, flags, lasted_us):
    """Update the light that sticks (`decode.STICK`), and the floor, after a reading.

    The reading lasted `lasted_us`. In its flags neither `LED_OFF` nor `NOT_CALIBRATED` is set.
    Changes `LOGS`, too.
    """
    was_used = state[d.STUCK] >= d.STUCK_LEAST
    steps = min(lasted_us >> 6, d.STEPS_MAX)
    if state[d.STUCK]:
        _fade(state, min(state[d.FADE] * steps >> 8, d.SHARE_MAX))
    if flags & d.TOUCHING:
        if state[d.AGREE] == 1:
            _forget(state)
        _peak(state)
    elif state[d.PEAK]:
        _measure(state, steps or 1)
    if was_used or state[d.STUCK] >= d.STUCK_LEAST:
        _set_floor(state)


def _fade(state, share):
    # Let the light that sticks decay by a share in Q16.
    stuck = 0
    for i in range(d.STICK, d.STICK + CHANNELS):
        state[i] -= (state[i] >> 8) * share >> 8
        stuck += state[i] >> 4
    state[d.STUCK] = stuck


def _forget(state):
    # The only reading between two touches may have been of the arriving or of the leaving finger.
    for i in range(d.STICK, d.STICK + CHANNELS):
        state[i] = 0
    state[d.STUCK] = 0


def _set_floor(state):
    half = 1 << state[d.SHIFT] >> 1
    for i in range(CHANNELS):
        floor = state[d.DARK + i] + state[d.BASELINE + i] + half
        if state[d.STUCK] >= d.STUCK_LEAST:
            floor += state[d.STICK + i]
        state[d.FLOOR + i] = floor >> state[d.SHIFT]


def _peak(state):
    # Record the largest light of the present touch.
    light = state[d.LIGHT] // state[d.SAMPLES]
    if state[d.AGREE]:  # a new touch
        state[d.AGREE] = 0
        state[d.PEAK] = state[d.BRIGHTNESS]
        state[d.PEAK_LIGHT] = light
    if state[d.BRIGHTNESS] > state[d.PEAK]:
        state[d.PEAK] = state[d.BRIGHTNESS]
    if light > state[d.PEAK_LIGHT]:
        state[d.PEAK_LIGHT] = light


def _measure(state, steps):
    # Compare the light without a touch with the estimate, and correct the estimate.
    total = _net(state)
    most = d.STUCK_NOISE + (state[d.STUCK] >> 4)
    agree = state[d.AGREE]
    if total < -most:
        agree = 0  # the finger was still leaving
    elif agree < 1:  # no reading since the touch was used
        agree = 0
        if total > (state[d.PEAK_LIGHT] << 8 - d.LEFT_LOG2) + (state[d.STUCK] >> 2):
            state[d.AGREE] = -1
            return  # too much: a lamp, or a finger that rests
        if total <= most:
            agree = 1  # this reading confirms the estimate
    elif total > most:
        return  # a finger arrives
    state[d.AGREE] = agree = min(agree + 1, d.AGREE_MAX)
    _correct(state, agree)
    if agree > 2 and state[d.STUCK] > 2 * d.STUCK_LEAST:
        # With a wrong rate of the decay, the light differs more and more from the estimate.
        fade = ((total << 8) // (state[d.STUCK] >> 4) << 10) // (agree * steps)
        state[d.FADE] = min(max(state[d.FADE] - fade, d.FADE_MIN), d.FADE_MAX)


def _net(state):
    # Store the light that is not in the floor in `LOGS`, counts in Q12; return its sum in Q8.
    total = 0
    for i in range(CHANNELS):
        net = state[d.SUMS + i] * 4 // state[d.SAMPLES] << 10
        net -= state[d.DARK + i] + state[d.BASELINE + i] + state[d.STICK + i]
        state[d.LOGS + i] = net
        total += net >> 4
    return total


def _correct(state, agree):
    # Add to the light that sticks its mean difference from the last readings.
    stuck = 0
    for i in range(d.STICK, d.STICK + CHANNELS):
        light = state[i] + state[i + d.LOGS - d.STICK] // agree
        if light < 0:
            light = 0
        elif light > d.STICK_MAX:
            light = d.STICK_MAX
        state[i] = light
        stuck += light >> 4
    state[d.STUCK] = stuck
