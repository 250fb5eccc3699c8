"""The firmware's USB modules for MicroPython and CircuitPython, on substitutes for USB stacks."""

import errno
import importlib
import random
import struct
import sys
import time
from types import ModuleType, SimpleNamespace
from unittest.mock import Mock

import pytest
from support.refusals import refusal

from spots.link.decoder import Decoder
from spots_device.board.outputs import INTERFACES
from spots_device.reading.decode import KIND, TOUCH_SIZE
from spots_device.reading.frame import Framer, Time32
from spots_device.usb.descriptors import GAMEPAD_DESCRIPTOR, KEYBOARD_DESCRIPTOR, with_report_id
from spots_device.usb.reports import Outbox

REPORT = bytes((0, 0, 30, 0, 0, 0, 0, 0))
OTHER = bytes((0, 0, 31, 0, 0, 0, 0, 0))
UP = bytes(8)
INTERFACE, ENDPOINT, HID = 4, 5, 0x21  # types of descriptors
SETUP, ACK = 1, 3  # stages of a control transfer
GET_DESCRIPTOR, GET_REPORT, SET_REPORT = b"\x81\x06", b"\xa1\x01", b"\x21\x09"
GET_IDLE, SET_IDLE = b"\xa1\x02", b"\x21\x0a"
GET_PROTOCOL, SET_PROTOCOL = b"\xa1\x03", b"\x21\x0b"
NAMES = [name for name, _, _ in INTERFACES]


def fresh(monkeypatch, name, **modules):
    """Import a new copy of the module `name` of `spots_device`.

    `modules` are substitutes for modules of the runtime: name to dict of attributes; ``__`` in a
    name stands for a dot.
    """
    for module, content in modules.items():
        stand_in = ModuleType(module)
        vars(stand_in).update(content)
        monkeypatch.setitem(sys.modules, module.replace("__", "."), stand_in)
    name = "spots_device." + name
    monkeypatch.delitem(sys.modules, name, raising=False)
    return importlib.import_module(name)


class Ticks:
    """Functions of MicroPython's `time`; a sleep calls `on_sleep`."""

    def __init__(self):
        self.us = 0
        self.on_sleep = lambda: None

    def sleep(self, us):
        self.us += us
        self.on_sleep()


@pytest.fixture(autouse=True)
def ticks(monkeypatch):
    """Add functions of MicroPython's `time` to CPython's module."""
    made = Ticks()
    for name, function in (
        ("ticks_us", lambda: made.us),
        ("ticks_ms", lambda: made.us // 1000),
        ("ticks_add", lambda ticks, delta: ticks + delta),
        ("ticks_diff", lambda end, start: end - start),
        ("sleep_us", made.sleep),
    ):
        monkeypatch.setattr(time, name, function, raising=False)
    return made


class Host:
    """A USB host, below a model of MicroPython's `machine.USBDevice`.

    As in extmod/machine_usb_device.c, an endpoint takes a second report only after the host has
    fetched the first, the configuration changes only while the device is inactive, and the stack
    reads a report when the host fetches it.
    """

    def __init__(self, monkeypatch):
        host = self
        self.error = None
        self.wakes = 0

        class USBDevice:
            BUILTIN_DEFAULT = SimpleNamespace(
                itf_max=2,
                ep_max=3,
                desc_dev=struct.pack(
                    "<BBHBBBBHHHBBBB", 18, 1, 2, 239, 2, 1, 64, 0, 5, 1, 1, 2, 3, 1
                ),
                desc_cfg=bytes((9, 2, 9, 0, 2, 1, 0, 0x80, 125)),
            )
            is_active = True
            builtin_driver = None

            def __new__(cls):
                return vars(host).setdefault("device", object.__new__(cls))

            def active(self, value):
                self.is_active = value

            def config(self, device, configuration, strings, *callbacks):
                assert not self.is_active
                assert device is USBDevice.BUILTIN_DEFAULT.desc_dev
                assert strings is None
                self.whole, self.pending = configuration, {}
                self.opened, self.reset, self.control, self.transferred = callbacks

            def submit_xfer(self, endpoint, data):
                if host.error:
                    raise host.error
                if endpoint in self.pending:
                    raise OSError(errno.EBUSY)
                self.pending[endpoint] = data  # like the USB stack, this makes no copy
                return True

            def remote_wakeup(self):
                host.wakes += 1

        self.kind = USBDevice
        self.module = fresh(monkeypatch, "usb.micropython", machine={"USBDevice": USBDevice})

    @property
    def serial(self):
        return self.device.builtin_driver is self.kind.BUILTIN_DEFAULT

    @property
    def configuration(self):
        return bytes(self.device.whole)[9:]

    def plug(self):
        for descriptors in self.configuration.split(b"\x09\x04")[1:]:
            self.device.opened(b"\x09\x04" + descriptors)

    def poll(self):
        """Poll the first endpoint with a report: return and remove the report, or None."""
        if not self.device.pending:
            return None
        endpoint, report = next(iter(self.device.pending.items()))
        report = bytes(report)
        del self.device.pending[endpoint]
        self.device.transferred(endpoint, 0, len(report))
        return report

    def control(self, stage, index, request, value=0):
        """Begin or complete a control transfer of an interface; return the board's answer."""
        packet = request + struct.pack("<HHH", value, 2 + index, 1)
        return self.device.control(stage, packet)


def of_type(kind, configuration):
    """Return the descriptors of a type (``bDescriptorType``) in a USB configuration."""
    found = []
    while configuration:
        if configuration[1] == kind:
            found.append(configuration[: configuration[0]])
        configuration = configuration[configuration[0] :]
    return found


@pytest.fixture
def host(monkeypatch):
    return Host(monkeypatch)


def test_micropython_describes_each_interface_as_what_it_is(host):
    sends = host.module.open_interfaces(["keyboard", "gamepad"], None)
    assert list(sends) == ["keyboard", "gamepad"]
    assert host.serial
    interfaces = of_type(INTERFACE, host.configuration)
    assert [interface[7] for interface in interfaces] == [1, 0]
    header = host.device.whole[:9]
    assert struct.unpack_from("<HB", header, 2) == (len(host.device.whole), 4)
    host.plug()
    reports = [host.control(SETUP, index, GET_DESCRIPTOR, value=0x2200) for index in (0, 1)]
    assert reports == [KEYBOARD_DESCRIPTOR, GAMEPAD_DESCRIPTOR]
    (described, _) = of_type(HID, host.configuration)
    assert host.control(SETUP, 0, GET_DESCRIPTOR, value=0x2100) == described
    assert struct.unpack("<BBHBBBH", described)[6] == len(KEYBOARD_DESCRIPTOR)


def test_micropython_answers_every_request_of_the_hid_class(host):
    host.module.open_interfaces(["keyboard", "gamepad"], None)
    host.plug()
    assert bytes(host.control(SETUP, 1, GET_PROTOCOL)) == b"\x01"
    assert host.control(SETUP, 1, SET_PROTOCOL, value=0) is True
    assert host.control(ACK, 1, SET_PROTOCOL, value=0) is True
    assert bytes(host.control(SETUP, 1, GET_PROTOCOL)) == b"\x00"
    assert bytes(host.control(SETUP, 0, GET_PROTOCOL)) == b"\x01"  # that of its own
    host.plug()
    assert bytes(host.control(SETUP, 1, GET_PROTOCOL)) == b"\x01"  # HID 1.11, section 7.2.6
    assert host.control(SETUP, 0, SET_IDLE, value=0x1900) is True
    assert host.control(ACK, 0, SET_IDLE, value=0x1900) is True
    assert bytes(host.control(SETUP, 0, GET_IDLE)) == b"\x19"
    for unknown in (b"\x81\x0a", b"\x21\x01", b"\x41\x09"):
        assert host.control(SETUP, 0, unknown) is False
    assert host.control(SETUP, 0, GET_DESCRIPTOR, value=0x2300) is False
    assert host.control(SETUP, 7, GET_DESCRIPTOR, value=0x2200) is False


def test_micropython_forgets_its_report_when_the_bus_is_reset(awake):
    send = awake.module.open_interfaces(["keyboard"], None)["keyboard"]
    awake.plug()
    awake.sleeps = True
    assert send(UP)
    assert not send(UP)
    awake.device.reset()
    awake.device.pending.clear()
    assert not send(UP)  # until the host has chosen the configuration again
    awake.plug()
    assert send(UP)


def test_micropython_survives_a_stack_that_refuses(awake):
    send = awake.module.open_interfaces(["keyboard"], None)["keyboard"]
    awake.plug()
    awake.error = OSError(errno.EINVAL)
    assert not send(UP)
    awake.error = None
    assert send(UP)


def test_micropython_lets_the_host_poll_every_millisecond(host):
    host.module.open_interfaces(NAMES, None)
    endpoints = of_type(ENDPOINT, host.configuration)
    assert [endpoint[3:] for endpoint in endpoints] == [bytes((3, 8, 0, 1))] * len(NAMES)


def test_micropython_gives_a_host_of_the_boot_protocol_boot_reports(host, awake):
    sends = host.module.open_interfaces(NAMES, None)
    assert [one[5:8] for one in of_type(INTERFACE, host.configuration)] == [
        bytes((3, 1, 1)),  # HID, with a boot interface, of a keyboard
        *[bytes((3, 0, 0))] * (len(NAMES) - 1),
    ]
    host.plug()
    for protocol in (0, 1):
        assert host.control(SETUP, 0, SET_PROTOCOL, value=protocol) is True
        host.control(ACK, 0, SET_PROTOCOL, value=protocol)
        assert bytes(host.control(SETUP, 0, GET_PROTOCOL)) == bytes((protocol,))
        # HID 1.11, appendix B.1: modifiers, a byte that is 0, six usages
        outbox = Outbox(sends["keyboard"], lambda: 0)
        outbox.put(bytes((2, 0, 4, 5, 0, 0, 0, 0)))
        while not outbox.pump():
            awake.wake()
        awake.wake()
        assert awake.got[-1] == bytes((2, 0, 4, 5, 0, 0, 0, 0))


def test_micropython_asks_a_sleeping_host_to_wake_up_for_a_press_only(awake, ticks):
    send = awake.module.open_interfaces(["keyboard"], None)["keyboard"]
    assert awake.device.whole[7] & 0x20  # the host may allow it
    awake.plug()
    awake.sleeps = True
    assert send(UP)
    assert awake.wakes == 0
    for _ in range(100):
        assert not send(REPORT)
        ticks.us += 1_000
    assert 1 <= awake.wakes <= 6
    awake.sleeps = False
    awake.wake()
    ticks.us += 30_000
    asked = awake.wakes
    assert send(REPORT)
    awake.wake()
    assert (awake.got[-1], awake.wakes) == (REPORT, asked)


def test_micropython_that_cannot_wake_a_host_does_not_say_so(awake):
    del awake.kind.remote_wakeup
    send = awake.module.open_interfaces(["keyboard"], None)["keyboard"]
    assert not awake.device.whole[7] & 0x20
    awake.plug()
    awake.sleeps = True
    assert not send(REPORT)


def test_micropython_sends_each_movement_once(awake, ticks):
    mouse = importlib.import_module("spots_device.usb.mouse")
    send = awake.module.open_interfaces(["mouse"], None)["mouse"]
    reports = mouse.MouseReports(send, lambda: 0)
    awake.plug()
    for _ in range(3):
        reports.scroll(9, 120)
        reports.flush()
        while not reports.outbox.pump():
            awake.wake()
        awake.wake()
        ticks.us += 1_000_000  # the last report is repeated before the next one
    assert sum(report[3] for report in awake.got) == 3
    assert bytes(awake.control(SETUP, 0, GET_REPORT, value=0x100)) == bytes(7)


def test_micropython_takes_and_returns_the_multipliers_of_a_mouse(host):
    mouse = importlib.import_module("spots_device.usb.mouse")
    send = host.module.open_interfaces(["mouse"], None)["mouse"]
    host.plug()
    for bits in (0b0101, 0):
        host.control(SETUP, 0, SET_REPORT, value=0x300)[:] = bytes((bits,))
        host.control(ACK, 0, SET_REPORT, value=0x300)
        assert bytes(host.control(SETUP, 0, GET_REPORT, value=0x300)) == bytes((bits,))
        reports = mouse.MouseReports(send, lambda: 0)
        reports.scroll(9, 240)
        reports.flush()
        assert reports.outbox.newest()[3] == (240 if bits else 2)
    host.control(SETUP, 0, SET_REPORT, value=0x300)[:] = b"\x05"
    host.control(ACK, 0, SET_REPORT, value=0x300)
    host.plug()  # another host
    assert bytes(host.control(SETUP, 0, GET_REPORT, value=0x300)) == b"\0"


@pytest.fixture
def awake(host, ticks):
    """The host; it polls each time the board sleeps, and stores the reports in the list `got`."""
    host.got = []
    host.sleeps = False

    def poll():
        report = None if host.sleeps else host.poll()
        if report is not None:
            host.got.append(report)

    host.wake = ticks.on_sleep = poll
    return host


def test_micropython_takes_one_report_at_a_time_and_copies_it_once_it_may(awake):
    send = awake.module.open_interfaces(["keyboard"], None)["keyboard"]
    assert not send(REPORT)  # no USB host is connected
    awake.plug()
    assert send(REPORT)
    assert awake.got == [UP]  # this report has shown that the host is awake
    assert not send(OTHER)
    assert awake.poll() == REPORT
    assert send(OTHER)
    assert awake.poll() == OTHER


def test_micropython_sends_each_report_once(awake, ticks):
    send = awake.module.open_interfaces(["keyboard"], None)["keyboard"]
    outbox = Outbox(send, lambda: 0)
    awake.plug()
    for pause_us in (0, 10_000, 1_000_000):
        ticks.us += pause_us
        for report in (REPORT, OTHER, UP):
            outbox.put(report)
        while not outbox.pump():
            awake.wake()
    awake.wake()
    assert awake.got == [UP, REPORT, OTHER, UP, REPORT, OTHER, UP, REPORT, OTHER, UP]


def test_micropython_gives_a_sleeping_host_no_press(awake, ticks):
    send = awake.module.open_interfaces(["keyboard"], None)["keyboard"]
    outbox = Outbox(send, lambda: 0)
    awake.plug()
    awake.sleeps = True
    began_us = ticks.us
    for _ in range(100):
        outbox.put(REPORT)
        outbox.pump()
        outbox.release()
        ticks.us += 100_000
    assert ticks.us - began_us <= 100 * 100_000 + 3_100  # waits only for the first report
    awake.sleeps = False
    while not outbox.pump():
        awake.wake()
    awake.wake()
    assert set(awake.got) == {UP}


def test_micropython_gives_a_host_that_falls_asleep_with_a_key_down_its_release(awake, ticks):
    send = awake.module.open_interfaces(["keyboard"], None)["keyboard"]
    awake.plug()
    assert send(REPORT)
    awake.wake()
    awake.sleeps = True
    assert send(UP)  # without a wait
    ticks.us += 3_600_000_000
    assert not send(OTHER)
    awake.sleeps = False
    awake.wake()
    assert awake.got == [UP, REPORT, UP]


def test_micropython_answers_a_host_that_asks_for_the_report(host, awake):
    send = host.module.open_interfaces(["keyboard"], None)["keyboard"]
    host.plug()
    send(REPORT)
    assert bytes(host.control(SETUP, 0, GET_REPORT, value=0x100)) == REPORT
    assert host.control(ACK, 0, GET_REPORT) is True


def test_micropython_shows_the_hosts_leds(host):
    shown = []
    host.module.open_interfaces(["keyboard"], shown.append)
    host.plug()
    for leds in (2, 0):
        host.control(SETUP, 0, SET_REPORT)[:] = bytes((leds,))
        host.control(ACK, 0, SET_REPORT)
    assert shown == [2, 0]


class Port:
    """stdin and stdout of a board: MicroPython's USB serial port (shared/tinyusb/mp_usbd_cdc.c).

    The board's buffer has 256 bytes. A packet of 64 bytes, or of all bytes in the buffer, leaves it
    for the USB controller, and the host fetches a packet each ms while it reads. A write without
    room blocks until there was no room for 500 ms.

    Attributes
    ----------
    reads : bool
        Whether the host reads.
    asleep : bool
        Whether the host sleeps: the poll shows room that is not there, and no packet leaves the
        buffer. After that, only a write sends the next packet.
    always_writable : bool
        Whether the poll shows room that is not there, as on an ESP32.
    claims_all : bool
        Whether a write returns the size of dropped bytes, too, as before MicroPython 1.25.
    lasts_us : int
        Duration of a write that is slow for another reason.
    waits, longest_us : int
        Number of blocked writes, and the longest duration of a write or poll.
    sent : bytearray
        Bytes that the host has read.
    """

    def __init__(self):
        self.us = (1 << 30) - 1000  # the ticks wrap after 1 ms
        self.reads, self.always_writable, self.claims_all = True, False, False
        self.asleep = False
        self.heard, self.sent, self._held, self._packet = b"", bytearray(), bytearray(), b""
        self.lasts_us = self.waits = self.longest_us = 0
        self._took_us = self.us
        self.stdin = self.stdout = SimpleNamespace(buffer=self)
        self.poll = lambda: self
        self.register = lambda stream, event: None

    def ipoll(self, timeout_ms):
        self._run()
        room = len(self._held) < 256
        return [(None, 4 * (room or self.always_writable or self.asleep) | bool(self.heard))]

    def readinto(self, buffer):
        buffer[:], self.heard = self.heard[:1], self.heard[1:]
        return 1

    def write(self, buffer, *span):
        *begin, size = span  # as in MicroPython: write(buffer, size), or write(buffer, begin, size)
        if begin:
            buffer = memoryview(buffer)[begin[0] :]
        began_us = self.us
        self.us += self.lasts_us
        written = 0
        since_us = self.us
        while written < size:
            self._run()
            part = bytes(memoryview(buffer)[written : min(size, written + 256 - len(self._held))])
            self._held += part
            self._fill()
            written += len(part)
            if part:
                since_us = self.us
            elif self.us - since_us >= 500_000:
                self.waits += 1
                break
            else:
                self.us += 1000
        self.longest_us = max(self.longest_us, self.us - began_us)
        return size if self.claims_all else written

    def sleep(self, us):
        self.us += us

    def _run(self):
        while self.us - self._took_us >= 1000:
            self._took_us += 1000
            if self.reads and not self.asleep and self._packet:
                self.sent += self._packet
                self._packet = b""
                self._fill()

    def _fill(self):
        if not self._packet and not self.asleep:
            self._packet = bytes(self._held[:64])
            del self._held[:64]


@pytest.fixture
def serial(monkeypatch):
    """The firmware's `StdioSerial`, and the substitute `Port` that it uses."""
    module = fresh(monkeypatch, "runtime.micropython", micropython={}, machine={})
    port, turn = Port(), 1 << 30
    module.sys, module.select = port, port
    port.POLLIN, port.POLLOUT = 1, 4
    module.time = SimpleNamespace(
        ticks_us=lambda: port.us % turn,
        ticks_add=lambda ticks, us: (ticks + us) % turn,
        ticks_diff=lambda end, start: (end - start + turn // 2) % turn - turn // 2,
        sleep_us=port.sleep,
    )
    module.ticks_us, module.ticks_diff = module.time.ticks_us, module.time.ticks_diff
    return module.StdioSerial(), port


CLOCK = SimpleNamespace(ticks_us=lambda: 0, ticks_diff=lambda *_: 0)


def short(ours):
    """Write a frame of one byte; return whether it was sent."""
    return ours.write(bytearray(64), 1)


def a_frame(framer, rng):
    """Send a frame of a random kind and size, as the firmware does; return its kind."""
    kind = rng.choice(["touch"] * 8 + ["spectrum", "key", "contact", "text"])
    if kind == "touch":
        framer._head[KIND] = 1
        framer._send_body(1, TOUCH_SIZE)
    elif kind == "spectrum":
        framer.spectrum(0, 0, 9, [rng.randrange(4000) for _ in range(6)], [rng.randrange(99)] * 8)
    elif kind == "key":
        framer.key(0, 7, 4, 0, True)
    elif kind == "contact":
        framer.contact(0, 1, 1, rng.randrange(85_000), 20, 3000)
    else:
        framer.text(b'{"re": "get", "text": "%s"}' % (b"x" * rng.randrange(500)))


@pytest.mark.board
@pytest.mark.parametrize("seed", range(5))
def test_micropython_never_blocks_for_a_host_that_stops_reading(serial, seed):
    ours, port = serial
    framer, rng = Framer(ours, Time32(CLOCK)), random.Random(seed)
    port.write(b"MPY: soft reboot\r\n", 18)  # output of another program
    port.us += 10_000
    sent = 0
    for _ in range(60):
        port.reads = not port.reads
        for _ in range(rng.randrange(300)):
            began_us, before = port.us, framer.dropped
            a_frame(framer, rng)
            sent += framer.dropped == before
            assert port.us - began_us < 22_000  # for a TEXT frame; else 0
            port.us += rng.choice([300, 1_000, 10_000])
    port.reads = True
    port.us += 100_000
    port.ipoll(0)
    assert (port.waits, port.longest_us) == (0, 0)
    decoder = Decoder()
    assert len(list(decoder.feed(bytes(port.sent)[18:]))) == sent
    assert framer.dropped > 500


def test_micropython_gives_a_reading_host_every_frame(serial):
    ours, port = serial
    framer, rng = Framer(ours, Time32(CLOCK)), random.Random(0)
    for _ in range(3000):
        a_frame(framer, rng)
        port.us += 1_000
    assert framer.dropped == 0
    port.us += 100_000
    port.ipoll(0)
    decoder = Decoder()
    assert len(list(decoder.feed(bytes(port.sent)))) == 3000
    assert decoder.stats.bad_crc == 0


def test_micropython_drops_a_reply_at_once_if_there_is_no_room(serial):
    ours, port = serial
    framer = Framer(ours, Time32(CLOCK))
    port.reads = False
    while short(ours):
        pass
    began_us = port.us
    framer.text(b"x" * 600)
    assert (framer.dropped, port.us) == (1, began_us)


def test_micropython_waits_ever_more_rarely_for_a_host_that_does_not_read(serial):
    ours, port = serial
    port.always_writable = True
    assert short(ours)
    port.reads = False
    while short(ours):
        pass
    for _ in range(60_000):  # ten minutes, plus the time of blocked writes
        port.us += 10_000
        assert not short(ours)
    assert 8 <= port.waits <= 18
    port.reads = True
    port.us += 64_000_000
    for _ in range(10):
        port.us += 10_000
        assert short(ours)


def test_micropython_counts_what_a_port_took_but_never_sent(serial):
    ours, port = serial
    port.claims_all = port.always_writable = True
    framer = Framer(ours, Time32(CLOCK))
    for _ in range(9):  # fills the port's buffer
        framer.text(b"{}")
        port.reads = False
    assert framer.dropped == 0
    for lost in (1, 2):  # the second frame is sent within the pause
        framer.text(b"{}")
        assert framer.dropped == lost
    port.reads, port.heard = True, b"?"
    ours.read()
    framer.text(b"{}")
    assert framer.dropped == 2


@pytest.mark.parametrize("taken", [None, 0, OSError()])
def test_micropython_reports_a_frame_that_the_port_does_not_take(serial, taken):
    ours, _ = serial
    ours._out = Mock(side_effect=[taken, 32])  # None: the port would block
    assert not short(ours)
    assert short(ours)


def test_micropython_answers_a_host_that_says_something_at_once(serial):
    ours, port = serial
    port.reads, port.always_writable = False, True
    for _ in range(1000):
        port.us += 10_000
        short(ours)
    assert not short(ours)
    port.reads, port.heard = True, b"?"
    assert ours.read() == ord("?")
    assert short(ours)


@pytest.mark.parametrize("asks", [True, False])
def test_micropython_sends_again_to_a_host_that_wakes_up(serial, asks):
    ours, port = serial
    assert short(ours)
    port.us += 10_000
    port.ipoll(0)
    port.asleep = True
    for _ in range(1_000):
        port.us += 10_000
        short(ours)
    assert 2 <= port.waits <= 6
    port.asleep = False
    if asks:
        port.heard = b"?"
        assert ours.read() == ord("?")
        assert short(ours)
    for _ in range(7_000):  # without a question, a pause of up to 64 s
        port.us += 10_000
        sent = short(ours)
    assert sent
    assert port.waits <= 6


def test_micropython_sends_no_reply_within_a_pause(serial):
    ours, port = serial
    port.reads, port.always_writable = False, True
    for _ in range(1000):
        port.us += 10_000
        short(ours)
    began_us = port.us
    Framer(ours, Time32(CLOCK)).text(b"x" * 600)
    assert port.us == began_us


def test_micropython_sends_every_reply_however_slow_its_writes_are(serial):
    ours, port = serial
    port.lasts_us = 300_000  # writes are slow for another reason; the host reads all the time
    framer = Framer(ours, Time32(CLOCK))
    decoder = Decoder()
    for i in range(20):
        port.heard = b"?"
        ours.read()
        framer.text(b'{"lines":%d}' % i)
    port.us += 100_000
    port.ipoll(0)
    texts = [frame.content for frame in decoder.feed(bytes(port.sent))]
    assert texts == [{"lines": i} for i in range(20)]
    assert decoder.stats.bad_crc == decoder.stats.lost == 0


def test_micropython_drops_no_frame_after_a_single_slow_write(serial):
    ours, port = serial
    port.lasts_us = 300_000
    short(ours)
    port.lasts_us = 0
    for _ in range(10):
        port.us += 2_780
        assert short(ours)


@pytest.mark.parametrize("minutes", [5, 9, 12, 17, 40])
def test_micropython_sends_after_minutes_without_a_frame(serial, minutes):
    ours, port = serial
    port.reads, port.always_writable = False, True
    for _ in range(10_000):
        port.us += 10_000
        short(ours)
    port.reads = True
    port.us += minutes * 60_000_000
    assert short(ours)


def test_micropython_is_no_usb_device_where_its_reports_would_be_empty(monkeypatch):
    machine = {"USBDevice": None}
    module = fresh(monkeypatch, "board.micropython", micropython={}, machine=machine)
    implementation = SimpleNamespace(version=(1, 26, 1))
    module.sys = SimpleNamespace(platform="esp32", implementation=implementation)
    with refusal(OSError):
        module.MachineUsb(SimpleNamespace()).open(["keyboard"])


@pytest.mark.parametrize(("platform", "version"), [("esp32", (1, 27, 0)), ("rp2", (1, 26, 1))])
def test_micropython_is_a_usb_device_elsewhere(monkeypatch, host, platform, version):
    module = fresh(monkeypatch, "board.micropython", micropython={}, machine={"USBDevice": None})
    implementation = SimpleNamespace(version=version)
    module.sys = SimpleNamespace(platform=platform, implementation=implementation)
    assert list(module.MachineUsb(SimpleNamespace()).open(["keyboard"])) == ["keyboard"]


class Pin:
    OUT = 1

    def __init__(self, number, mode, value):
        self.number, self.level = number, value
        Pin.made = self

    def value(self, level):
        self.level = level


@pytest.mark.parametrize("level", [0, 1])
def test_micropython_lights_the_boards_led_at_caps_lock(monkeypatch, level):
    module = fresh(monkeypatch, "board.micropython", micropython={}, machine={"Pin": Pin})
    usb = module.MachineUsb(SimpleNamespace(LED_PIN="LED", LED_ON=level))
    assert (Pin.made.number, Pin.made.level) == ("LED", 1 - level)
    for leds, lit in ((2, True), (3, True), (1, False), (0, False)):
        usb.show_leds(leds)
        assert (Pin.made.level == level) == lit
    module.MachineUsb(SimpleNamespace()).show_leds(2)  # a board without an LED


class Device:
    KEYBOARD = CONSUMER_CONTROL = None

    def __init__(self, *, usage_page, usage, **rest):
        self.usage_page = usage_page
        self.usage = usage
        self.rest = rest
        self.world = None
        self.received = None

    def get_last_received_report(self):
        report, self.received = self.received, None
        return report

    def send_report(self, report):
        self.world.send(self, bytes(report))


class CircuitPython:
    """Substitute for clock, USB connection and USB endpoint of a board with CircuitPython."""

    def __init__(self):
        self.ticks = (1 << 29) - 30  # the ticks wrap after 30 ms
        self.got = []
        self.leds = []
        self.full = False
        self.usb_connected = True
        self.sleeps_at_once = False
        self.waits = self.asked = 0

    def ticks_ms(self):
        self.ticks &= (1 << 29) - 1
        return self.ticks

    def send(self, device, report):
        if not self.usb_connected:
            self.asked += 1
            self.ticks += 2000
            assert not any(report)
        elif self.full:
            self.waits += 1
            self.ticks += 2000
            raise OSError("USB busy")
        elif self.sleeps_at_once:
            self.usb_connected = False
        else:
            self.got.append((device.usage, report))


@pytest.fixture
def circuitpython(monkeypatch):
    world = CircuitPython()
    monkeypatch.setattr(Device, "KEYBOARD", Device(usage_page=1, usage=6))
    monkeypatch.setattr(Device, "CONSUMER_CONTROL", Device(usage_page=12, usage=1))
    hid = {"Device": Device, "devices": ()}
    module = fresh(
        monkeypatch,
        "usb.circuitpython",
        supervisor={"ticks_ms": world.ticks_ms, "runtime": world},
        usb_hid=hid,
    )

    def enable(devices):
        sys.modules["usb_hid"].devices = devices
        for device in devices:
            device.world = world

    sys.modules["usb_hid"].enable = enable
    return module, world


@pytest.fixture
def sends(circuitpython):
    module, world = circuitpython
    module.enable(["keyboard", "consumer", "gamepad"])
    return module.open_interfaces(["keyboard", "gamepad"], world.leds.append), world


def test_circuitpython_is_what_the_settings_say(circuitpython):
    module, _ = circuitpython
    for names in ([], ["keyboard"], ["gamepad"], ["keyboard", "system", "mouse", "gamepad"]):
        module.enable(names)
        assert list(module.open_interfaces(NAMES, None)) == names
    pad = sys.modules["usb_hid"].devices[3].rest
    assert pad["report_descriptor"] == with_report_id(GAMEPAD_DESCRIPTOR, 4)
    assert (pad["report_ids"], pad["in_report_lengths"]) == ((4,), (8,))


def test_circuitpython_gives_the_shared_endpoint_time_between_two_reports(sends):
    by_name, world = sends
    assert by_name["keyboard"](REPORT)
    assert not by_name["gamepad"](OTHER)
    world.ticks += 9
    assert not by_name["gamepad"](OTHER)
    world.ticks += 1
    assert by_name["gamepad"](OTHER)
    assert world.got == [(6, REPORT), (5, OTHER)]


def test_circuitpython_does_not_wait_for_a_host_that_is_asleep_or_gone(sends):
    by_name, world = sends
    world.usb_connected = False
    world.full = True
    for _ in range(1000):
        world.ticks += 100
        assert not by_name["keyboard"](REPORT)
    assert world.waits == 0
    world.usb_connected, world.full = True, False
    assert by_name["keyboard"](REPORT)


def test_circuitpython_waits_once_a_minute_for_a_host_that_does_not_ask(sends):
    by_name, world = sends
    world.full = True
    for second in range(600):  # ten minutes, plus the time of blocked reports
        world.ticks += 1000
        assert not by_name["keyboard"](REPORT)
        assert world.waits <= 1 + second // 60
    assert world.waits == 10
    world.full = False
    world.ticks += 64_000
    assert by_name["keyboard"](REPORT)


def test_circuitpython_tries_a_host_again_that_sets_the_keyboards_leds(sends):
    by_name, world = sends
    keyboard = next(device for device in sys.modules["usb_hid"].devices if device.usage == 6)
    world.full = True
    assert not by_name["keyboard"](REPORT)
    world.full = False
    assert not by_name["keyboard"](REPORT)
    keyboard.received = b"\2"
    assert by_name["keyboard"](REPORT)
    keyboard.received = b"\0"
    assert not by_name["gamepad"](OTHER)  # too early after the last report of the shared endpoint
    assert not by_name["keyboard"](OTHER)
    world.ticks += 10
    assert by_name["gamepad"](OTHER)


def test_circuitpython_asks_a_sleeping_host_to_wake_up_once_a_minute(sends):
    by_name, world = sends
    world.usb_connected = False
    assert not by_name["keyboard"](REPORT)
    assert world.asked == 0  # no host yet, which could sleep
    world.usb_connected = True
    assert by_name["keyboard"](UP)
    world.ticks += 10
    world.usb_connected = False
    for seconds in range(120):
        assert not by_name["keyboard"](UP)
        assert world.asked == 0 if not seconds else world.asked <= 1 + seconds // 60
        assert not by_name["keyboard"](REPORT)
        world.ticks += 1000
    assert world.asked == 2
    assert not any(any(report) for _, report in world.got)
    world.usb_connected = True
    assert by_name["keyboard"](REPORT)


def test_circuitpython_takes_the_multipliers_of_a_mouse(circuitpython):
    module, _ = circuitpython
    mouse = importlib.import_module("spots_device.usb.mouse")
    module.enable(["mouse"])
    send = module.open_interfaces(["mouse"], None)["mouse"]
    (device,) = sys.modules["usb_hid"].devices
    for bits in (5, 0):
        device.received = bytes((bits,))
        send(bytes(7))
        reports = mouse.MouseReports(send, lambda: 0)
        reports.scroll(9, 240)
        reports.flush()
        assert reports.outbox.newest()[3] == (240 if bits else 2)


def test_circuitpython_sends_after_days_without_a_report(sends):
    by_name, world = sends
    for days in (3.2, 5.0, 6.0, 20.0):
        assert by_name["keyboard"](REPORT)
        world.ticks += int(days * 86_400_000)
    assert by_name["keyboard"](REPORT)


def test_circuitpython_sends_at_once_when_its_ticks_have_wrapped(sends):
    by_name, world = sends
    assert by_name["keyboard"](REPORT)
    world.ticks += (1 << 29) - 30_000
    assert by_name["keyboard"](REPORT)


def test_circuitpython_whose_host_fell_asleep_meanwhile_has_not_sent(sends):
    by_name, world = sends
    world.sleeps_at_once = True
    assert not by_name["keyboard"](REPORT)
    world.sleeps_at_once, world.usb_connected = False, True
    world.ticks += 10
    assert by_name["keyboard"](REPORT)
    assert world.got == [(6, REPORT)]


def test_circuitpython_shows_the_hosts_leds_at_the_next_report(sends):
    by_name, world = sends
    keyboard = next(device for device in sys.modules["usb_hid"].devices if device.usage == 6)
    for leds in (b"\x02", None, b"\0"):
        keyboard.received = leds
        world.ticks += 10
        assert by_name["keyboard"](REPORT)
        world.ticks += 10
        assert by_name["gamepad"](OTHER)
    assert world.leds == [2, 0]


class Wire:
    def __init__(self, pin):
        self.pin, self.value = pin, None
        Wire.made = self

    def switch_to_output(self, value):
        self.value = value


@pytest.mark.parametrize("level", [0, 1])
def test_circuitpython_lights_the_boards_led_at_caps_lock(monkeypatch, level):
    modules = ("adafruit_as7341", "busio", "microcontroller", "storage", "supervisor", "usb_cdc")
    module = fresh(
        monkeypatch,
        "board.circuitpython",
        **{name: {} for name in modules},
        adafruit_bus_device__i2c_device={"I2CDevice": None},
        board={"LED": "the red one"},
        digitalio={"DigitalInOut": Wire},
        micropython={},
    )
    usb = module.CircuitUsb(SimpleNamespace(LED_PIN="LED", LED_ON=level))
    assert (Wire.made.pin, Wire.made.value) == ("the red one", level == 0)
    for leds, lit in ((2, True), (3, True), (1, False), (0, False)):
        usb.show_leds(leds)
        assert (Wire.made.value == bool(level)) == lit
    module.CircuitUsb(SimpleNamespace()).show_leds(2)  # a board without an LED
