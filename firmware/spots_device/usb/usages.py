"""Numbers of HID that keys, layouts and reports share (HID usage tables 1.5)."""

# Kinds of actions that press something, see layout.py. Those without comment are usage pages.
KEYBOARD = 7
SYSTEM = 8  # usages 0x81 to 0x83 of the page 1
MOUSE = 9  # buttons, and the wheels from `WHEEL` on
CONSUMER = 12

MODIFIERS_FROM = 0xE0  # usage of the first modifier key; bit i of the modifiers is usage 0xE0 + i
KEYS_MAX = 6  # usages that are pressed at the same time, as in a boot keyboard report
WHEEL = 9  # turns a mouse's wheel up; the numbers after it down, left and right
NOTCH = 120  # parts of a notch of a wheel
CAPS_LOCK = 2  # bit of caps lock in a keyboard's output report, LED page

# Bits of an action, see layout.py.
PLAIN = 0x1F00FFF  # those without its modifiers
CAPS_LOCK_KEY = KEYBOARD << 20 | 0x39
