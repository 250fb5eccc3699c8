"""The functions of sticking.py in machine code, for boards with ``viper = true``.

On an RP2040, a reading of a finger takes 60 us less than in portable code, and up to 580 us less
while light sticks: 5 % and 50 % of a sample.

As in kernel_viper.py, the code is correct with words of 32 bits and of 64 bits: ``(x ^ _SIGN) -
_SIGN`` corrects a number that was just loaded and may be negative.
"""

import micropython

from ..sensor.smux import CHANNELS
from . import decode as d

_SIGN = 1 << 31


@micropython.viper
def unstick(state: ptr32, flags: int, lasted_us: int):
    stuck = state[d.STUCK]
    was_used = 0
    if stuck >= d.STUCK_LEAST:
        was_used = 1
    steps = lasted_us >> 6
    if steps > d.STEPS_MAX:
        steps = d.STEPS_MAX
    if stuck:
        share = (state[d.FADE] * steps) >> 8
        if share > d.SHARE_MAX:
            share = d.SHARE_MAX
        stuck = 0
        for i in range(CHANNELS):
            n = state[d.STICK + i]
            n -= ((n >> 8) * share) >> 8
            state[d.STICK + i] = n
            stuck += n >> 4
        state[d.STUCK] = stuck
    agree = (state[d.AGREE] ^ _SIGN) - _SIGN
    # Each `break` ends the comparison.
    while True:
        if flags & d.TOUCHING:
            light = state[d.LIGHT] // state[d.SAMPLES]
            n = (state[d.BRIGHTNESS] ^ _SIGN) - _SIGN
            if agree or n > (state[d.PEAK] ^ _SIGN) - _SIGN:
                state[d.PEAK] = n
            if agree or light > state[d.PEAK_LIGHT]:
                state[d.PEAK_LIGHT] = light
            state[d.AGREE] = 0
            if agree == 1:
                for i in range(CHANNELS):
                    state[d.STICK + i] = 0
                state[d.STUCK] = 0
            break
        if state[d.PEAK] == 0:
            break
        if steps == 0:
            steps = 1
        total = 0
        for i in range(CHANNELS):
            n = state[d.SUMS + i] * 4
            if state[d.SAMPLES] > 1:
                n = n // state[d.SAMPLES]
            n = (n << 10) - state[d.DARK + i] - state[d.BASELINE + i] - state[d.STICK + i]
            state[d.LOGS + i] = n
            total += n >> 4
        most = d.STUCK_NOISE + (stuck >> 4)
        if total + most < 0:
            agree = 0
        elif agree < 1:
            agree = 0
            if total > (state[d.PEAK_LIGHT] << (8 - d.LEFT_LOG2)) + (stuck >> 2):
                state[d.AGREE] = 0 - 1
                break
            if total <= most:
                agree = 1
        elif total > most:
            break
        if agree < d.AGREE_MAX:
            agree += 1
        state[d.AGREE] = agree
        stuck = 0
        for i in range(CHANNELS):
            n = (state[d.LOGS + i] ^ _SIGN) - _SIGN
            n = state[d.STICK + i] + n // agree
            if n < 0:
                n = 0
            if n > d.STICK_MAX:
                n = d.STICK_MAX
            state[d.STICK + i] = n
            stuck += n >> 4
        state[d.STUCK] = stuck
        if agree > 2 and stuck > 2 * d.STUCK_LEAST:
            n = state[d.FADE] - (((total << 8) // (stuck >> 4)) << 10) // (agree * steps)
            if n < d.FADE_MIN:
                n = d.FADE_MIN
            if n > d.FADE_MAX:
                n = d.FADE_MAX
            state[d.FADE] = n
        break
    if state[d.STUCK] >= d.STUCK_LEAST or was_used:
        shift = state[d.SHIFT]
        half = (1 << shift) >> 1
        for i in range(CHANNELS):
            n = state[d.DARK + i] + state[d.BASELINE + i] + half
            if state[d.STUCK] >= d.STUCK_LEAST:
                n += state[d.STICK + i]
            state[d.FLOOR + i] = n >> shift
