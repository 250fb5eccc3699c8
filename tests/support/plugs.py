"""Substitutes for boards on PTYs, which can be unplugged and reconnect with other port names."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import select
import struct
import threading
import time
import tty

from serial.tools.list_ports_common import ListPortInfo

from spots_device import PROTOCOL
from support.fault_streams import encoded

_READING_S = 0.004
_FINGER = 6  # number of readings with a finger, and then of readings without a finger


class Plug:
    """A substitute for a board that answers five commands, and sends touches and pauses in turn."""

    def __init__(self, board_id):
        self.board_id = board_id
        self.usb_number, self.socket = board_id, None  # as the operating system lists them
        self.name = None
        self.names = []
        self._end = None
        self._reserved = []
        self._pending = b""

    def plug(self):
        """Switch the board on; the name of its port differs from the previous name."""
        self._end, port = pty.openpty()
        tty.setraw(port)
        self.name = os.ttyname(port)
        os.close(port)
        os.set_blocking(self._end, False)
        self.names.append(self.name)
        self._booted_s = self._next_s = time.monotonic()
        self._sequence, self._streams, self._pending = 0, [], b""

    def unplug(self):
        """Switch the board off, and reserve the name of its port.

        A program under test opens this name again. If a PTY of another process had it, the program
        would read the bytes of that process.
        """
        self._reserved.append(os.open(self.name, os.O_RDWR | os.O_NOCTTY))
        os.close(self._end)
        self._end = None

    def free_names(self):
        """Let other PTYs have the names of this board's earlier ports."""
        while self._reserved:
            os.close(self._reserved.pop())

    @property
    def fd(self):
        return self._end

    def read(self):
        with contextlib.suppress(OSError):  # no program has opened the port
            *lines, self._pending = (self._pending + os.read(self._end, 4096)).split(b"\n")
            for line in lines:
                if line.strip():
                    self._answer(*line.decode().split())

    def tick(self):
        if not self._streams:
            self._next_s = time.monotonic()
        while self._streams and time.monotonic() >= self._next_s:
            self._next_s += _READING_S
            flags = 9 if self._sequence // _FINGER % 2 else 8
            self._send(1, struct.pack("<BiiiH", flags, 0, 0, 42_000 * (flags & 1), 900))

    def _answer(self, name, *words):
        reply = {"re": name}
        if name == "hello":
            reply |= {"protocol": PROTOCOL, "id": self.board_id, "board": "b", "runtime": "r"}
            reply |= {"keys": 0, "length_um": 85_000, "exposure_us": 5000, "average": 1}
            reply |= {"channels": ["F3", "F4", "F5", "F6", "F7", "F8"]}
        elif name == "get":
            reply["full_scale"] = 65_535
        elif name == "sync":
            reply |= {"t_us": self._t_us(), "stream": self._streams}
        elif name == "stream":
            self._streams = [word for word in words if word != "off"]
            reply["stream"] = list(words)
        self._send(3, json.dumps(reply).encode())

    def _send(self, kind, body):
        header = struct.pack("<BHI", kind, self._sequence % 65_536, self._t_us())
        self._sequence += 1
        with contextlib.suppress(OSError):
            os.write(self._end, encoded(header + body))

    def _t_us(self):
        return int(1e6 * (time.monotonic() - self._booted_s)) % (1 << 32)


class Hub:
    """Runs substitutes `Plug` in a thread, and lists their ports as pyserial does."""

    def __init__(self, count):
        self._lock = threading.Lock()
        self.plugs = [Plug(f"board{i}") for i in range(count)]
        for plug in self.plugs:
            plug.plug()
        self._stopping = False
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def ports(self):
        found = []
        with self._lock:
            for plug in self.plugs:
                if plug.fd is not None:
                    found.append(port := ListPortInfo(plug.name))
                    port.vid, port.serial_number = 1, plug.usb_number
                    port.location = plug.socket
        return found

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self._stopping = True
        self._thread.join()
        for plug in self.plugs:
            if plug.fd is not None:
                plug.unplug()
        self.free_names()

    def free_names(self):
        for plug in self.plugs:
            plug.free_names()

    def unplug(self):
        with self._lock:
            for plug in self.plugs:
                plug.unplug()

    def replug(self):
        with self._lock:
            for plug in self.plugs:
                plug.plug()

    def _serve(self):
        while not self._stopping:
            with self._lock:
                there = {plug.fd: plug for plug in self.plugs if plug.fd is not None}
                ready, _, _ = select.select(list(there), [], [], 0)
                for fd in ready:
                    there[fd].read()
                for plug in there.values():
                    plug.tick()
            time.sleep(0.001)
