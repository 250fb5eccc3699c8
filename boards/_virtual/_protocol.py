"""What a virtual board asks of the simulator, for both ends of the pipes.

Request: operation, three argument bytes, then what one of `SENDS` carries. Answer: errno (0 if all
is well), the simulator's clock in us (4 bytes, low first, modulo `PERIOD_US`), then what one of
`READS` returns. Numbers of several bytes are low first.
"""

READ = 0x52  # device address, register, size
WRITE = 0x57  # device address, size, 0
SLEEP = 0x53  # time in us, 3 bytes
RESET = 0x58  # 0, 0, 0; ends this run and has no answer
RECEIVE = 0x47  # device address, 0, size
SPEED = 0x46  # of the bus in kHz, 2 bytes, 0
LINES = 0x4C  # SCL and SDA released (1) or pulled (0), 1; returns the level of SDA
FEED = 0x44  # how long a watchdog waits from now on, in ms, 3 bytes
HID = 0x48  # USB interface, size of the report or 0 to ask for room, 0
MEMORY = 0x4D  # free heap in bytes, 3 bytes; simulated time only, and has no answer
HOST = 0x55  # 0, 0, 0; fails unless a USB host is there and awake
LIGHT = 0x4F  # level of the pin that switches the strip's LED, 0, 0

SENDS = (WRITE, HID)  # as many bytes as the second argument counts
READS = (READ, RECEIVE, LINES)  # as many bytes as the third argument counts

PERIOD_US = 1 << 30  # of the clock
EAGAIN = 11  # as an answer to HID: the endpoint is full
