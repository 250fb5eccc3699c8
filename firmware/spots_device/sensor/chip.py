"""Registers of the AS7341 that more than one module uses, and the buffer of its samples."""

ASTATUS = 0x94  # reading it latches the counts in the registers after it
STATUS = 0x93
CONTROL = 0xFA
FIFO_LVL = 0xFD  # entries in the FIFO
FDATA = 0xFE  # entries of the FIFO

AINT = 0x08  # in STATUS: a sample is complete
FIFO_CLR = 0x02  # in CONTROL: empties the FIFO

# Indices of `AS7341.burst`.
STATUS_AT = 0
ASTATUS_AT = 1
COUNTS = 2  # six counts
LEVEL = 14  # level of the FIFO
OLDEST = 15  # a sample that is read together with the level
FIFO_DATA = 27  # the samples of a second transfer

SAMPLE_SIZE = 12  # bytes of a sample
ENTRIES = 6  # entries of the FIFO for a sample
# Largest usable number of entries in the FIFO; with more, the chip may drop a part of the sample
# that it stores next.
FULL = 120
BURST_SIZE = FIFO_DATA + 2 * FULL  # bytes of the buffer

# If the chip acknowledges its address but not the number of the register, MicroPython on an RP2040
# reads nothing and raises no OSError, so that the buffer keeps its old bytes. So before each read,
# the driver sets a byte of the buffer to this value, which the chip returns neither as level of the
# FIFO nor in STATUS, ASTATUS, STATUS2 or ID.
UNREAD = 0xFF
