"""A Zenoh network inside this computer, and boards that this process publishes on it."""

from __future__ import annotations

import contextlib
import json
import socket
import threading
import time

import zenoh
from bench.standin import StandIn

from spots import Board
from spots_net.publish import Publisher
from spots_net.publishing import publish, stream

DEADLINE_S = 60.0
RATE_HZ = 200


class Net:
    """Two Zenoh configuration files: a program with `hub` listens, those with `leaf` connect."""

    def __init__(self, folder):
        with socket.create_server(("127.0.0.1", 0)) as free:
            place = f"tcp/127.0.0.1:{free.getsockname()[1]}"
        retry = {"period_init_ms": 50, "period_max_ms": 200}
        self.hub = self._file(folder / "hub.json5", listen=[place])
        self.leaf = self._file(folder / "leaf.json5", connect=[place], retry=retry)

    @staticmethod
    def _file(path, listen=(), connect=(), retry=None):
        ends = {"listen": {"endpoints": list(listen)}, "connect": {"endpoints": list(connect)}}
        if retry:
            ends["connect"]["retry"] = retry
        path.write_text(json.dumps({"scouting": {"multicast": {"enabled": False}}, **ends}))
        return path


def session(path):
    return zenoh.open(zenoh.Config.from_file(path))


class Restarting(StandIn):
    """A substitute board that restarts when `restarting` is set to True."""

    restarting = False

    def read(self, timeout_s):
        if self.restarting:  # restart here: in the thread that reads, between two frames
            self.restarting = False
            self.__init__(self._id, 1 / self._period_s)
            self.fast = True
        return super().read(timeout_s)


@contextlib.contextmanager
def publishing(path, *links, kind=Publisher):
    """Publish boards from this process in a ``with`` block; yield the publishers.

    Parameters
    ----------
    path : Path
        Zenoh configuration file.
    links : object
        Links of the boards.
    kind : type
        Class of the publishers.
    """
    ended = threading.Event()
    failed = []

    def serve(board, publisher):
        try:
            while not ended.is_set():
                publish(board, [publisher], 0.1)
        except Exception as error:
            failed.append(error)
        publisher.close()

    with session(path) as own:
        boards = [Board(link) for link in links]
        publishers = [kind(board, own) for board in boards]
        for board in boards:
            stream(board)
        threads = [threading.Thread(target=serve, args=pair) for pair in zip(boards, publishers)]
        for thread in threads:
            thread.start()
        try:
            yield publishers
        finally:
            ended.set()
            for thread in threads:
                thread.join(DEADLINE_S)
    assert not failed


def stand_in(board_id="a1", kind=StandIn, rate_Hz=RATE_HZ):
    link = kind(board_id, rate_Hz)
    link.fast = True
    return link


def wait_until(condition):
    end_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.005)
