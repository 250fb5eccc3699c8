"""The protocol between a virtual board and the simulator, used by both ends of the pipes.

A request is an operation, three argument bytes, and the data if the operation is in `SENDS`. An
answer is an errno (0 for success; 4 bytes), the simulator's clock in us (4 bytes, modulo
`PERIOD_US`), and the data if the operation is in `READS`. Numbers of several bytes have the low
byte first.

A board with two strips has two buses. In requests for a bus, bit 7 of the argument that is marked
(bus) selects the second bus.
"""

READ = 0x52  # device address (bus), register, size
WRITE = 0x57  # device address (bus), size, 0
SLEEP = 0x53  # time in us, 3 bytes
RESET = 0x58  # 0, 0, 0; ends this run and gets no answer
RECEIVE = 0x47  # device address (bus), 0, size
SPEED = 0x46  # frequency of the bus in kHz, 2 bytes; (bus)
LINES = 0x4C  # SCL (bus), SDA: 1 released, 0 pulled low; size 1; returns the level of SDA
FEED = 0x44  # timeout of the watchdog in ms, 3 bytes
HID = 0x48  # USB interface, size of the report or 0 to check for room, 0
MEMORY = 0x4D  # free heap in bytes, 3 bytes; simulated time only; gets no answer
BUSY = 0x42  # processor time in us, 3 bytes; simulated time only; gets no answer
HOST = 0x55  # 0, 0, 0; fails unless a USB host is connected and awake
LIGHT = 0x4F  # level of the pin that switches the strip's LED (bus), 0, 0
HEAT = 0x54  # (bus), 0, size 2; returns the ADC's reading of the temperature sensor
BLE = 0x4B  # whether the text is complete, size of its part, 0: a call of the Bluetooth stack
BLE_ANSWER = 0x41  # 0, 0, size: a part of the answer, which ends with a newline; spaces fill it

SECOND_BUS = 0x80
SENDS = (WRITE, HID, BLE)  # requests with data; the second argument is its size
READS = (
    READ,
    RECEIVE,
    LINES,
    HEAT,
    BLE_ANSWER,
)  # answers with data; the third argument is its size

PERIOD_US = 1 << 30  # period of the clock
EAGAIN = 11  # answer to HID: the endpoint is full
REFUSED = 121  # answer to READ and WRITE: the chip did not acknowledge the first data byte
