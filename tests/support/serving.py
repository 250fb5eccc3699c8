"""A simulated board that runs in real time, and a web server in a thread."""

from __future__ import annotations

import asyncio
import math
import threading
import time
from argparse import Namespace
from concurrent.futures import Future
from contextlib import contextmanager

import aiohttp

from spots.errors import PortLostError, SpotsError
from spots.keyboard.layout import load
from spots.link.board import Board
from spots.link.connect import prepare
from spots_sim.board.lockstep import LockstepLink
from spots_sim.board.paced import PacedLink
from spots_sim.person.stage import strip_lines
from spots_web.app import NOTHING
from spots_web.board_feed import BoardReader
from spots_web.calibration import PageCalibration
from spots_web.editors import LayoutEditor, SettingsEditor
from spots_web.practice import PagePractice
from spots_web.recordings import Recordings
from spots_web.serve import Server
from spots_web.state import PageState
from spots_web.strip_choice import StripChoice


class Cable(PacedLink):
    """A link in simulated time that never runs ahead of real time, and can be unplugged.

    With a speed, simulated time passes faster than real time by this factor.

    Attributes
    ----------
    pause_s : float
        Simulated time in s at which the link stops and waits, until this attribute is increased.
    """

    def __init__(self, link, speed=1.0):
        super().__init__(link, 0.0)
        self._speed, self.pause_s = speed, math.inf
        self.pace()
        self.plugged = True
        self.loss = SpotsError  # PortLostError if the same port can be opened again
        self.written = []

    def pace(self, speed=None):
        """Follow real time, multiplied by `speed`, from now on; None keeps the present speed."""
        self._speed = speed or self._speed
        self._begun_s, self._epoch_s = self.now_s(), time.monotonic()

    def _wait(self):
        ahead_s = (self.now_s() - self._begun_s) / self._speed
        time.sleep(max(ahead_s - (time.monotonic() - self._epoch_s), 0.0))
        while self.now_s() > self.pause_s:
            time.sleep(0.005)

    def read(self, timeout_s):
        self._check()
        return super().read(timeout_s)

    def write(self, data):
        self._check()
        self.written.append(bytes(data))
        self._link.write(data)

    def reopen(self):
        self._check()

    def _check(self):
        if not self.plugged:
            raise self.loss("the board on virtual was disconnected")


class Bench:
    """A simulated board that can be unplugged and plugged in again, and its reader for the web UI.

    Parameters
    ----------
    sensor : SensorFile
        The simulated strip.
    calibration : sequence of str or None
        Lines of the board's calibration; None for no calibration.
    scenario : object
        The simulated fingers, such as `Held`.
    layout : str
        Name of the key layout.
    record_to, session, edit : Path, optional
        Folder for recordings, session file of calibrations, layout file to edit. Each of them
        switches on the function of the web UI that needs it.
    speed : float
        Simulated time that passes in 1 s of real time, in s.
    settings : dict, optional
        Path of each settings file to edit, by name.
    second : object, optional
        The fingers on a second strip; without it, the board has one strip.
    practice : str, optional
        Name of the sensor file of practice sessions.

    Attributes
    ----------
    link : Cable or None
        Link of the board that is plugged in.
    """

    def __init__(
        self,
        sensor,
        calibration,
        scenario,
        layout="digits",
        record_to=None,
        session=None,
        speed=1.0,
        edit=None,
        settings=None,
        second=None,
        practice=None,
    ):
        self._speed = speed
        self._sensor, self._calibration, self._scenario = sensor, calibration, scenario
        self._second = second and (second, 2)
        self.state = PageState()
        self.recordings = Recordings(record_to, self.state) if record_to else None
        self.queues = {"recording": self.recordings} if record_to else {}
        if session:
            self.queues["calibration"] = PageCalibration(session, self.state)
        if practice:
            self.queues["calibration"] = PagePractice(Namespace(sensor=practice), self.state)
        if edit:
            self.queues["layout"] = LayoutEditor(edit, load(layout), self.state)
        for name, path in (settings or {}).items():
            self.queues[name] = SettingsEditor(name, path, self.state)
        if self.queues and second:
            self.queues["strip"] = StripChoice()
        self.link = None
        self.there = True
        self.asked_for = []
        queues = self.queues.values()
        self.reader = BoardReader(self._open, load(layout), self.state, 0.05, queues=queues)
        self.reader.start()

    def _open(self, board_id):
        self.asked_for.append(board_id)
        if not self.there:
            raise SpotsError("no board found, plug one in")
        link = LockstepLink(self._sensor, self._scenario, second=self._second)
        self.wires = link
        link = Cable(link, math.inf)  # without waits until the board is prepared
        board = Board(link)
        if self._calibration:
            for i in board.sensors:
                prepare(board, strip_lines(self._calibration, i), i)
        link.pace(self._speed)
        self.link, self.board = link, board
        return board

    def unplug(self):
        """Unplug the board; it loses its power and its state."""
        self.there = self.link.plugged = False

    def replug(self):
        self.there = True

    @contextmanager
    def loose(self):
        """Interrupt the connection inside a `with` block; the board keeps its power and state."""
        self.link.loss = PortLostError
        self.link.plugged = False
        yield
        self.link.plugged = True

    def close(self):
        self.reader.stop(timeout_s=30)


class Serving:
    """A web server for a `PageState`, in a thread with its own event loop."""

    def __init__(self, state, address="127.0.0.1", port=0, queues=NOTHING, hosts=()):
        self._server = Server(state, address, port, queues, hosts)
        self._up = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._main()), daemon=True)
        self._thread.start()
        assert self._up.wait(30)

    async def _main(self):
        self._loop, self._down = asyncio.get_running_loop(), asyncio.Event()
        async with self._server as server:
            self.url = server.url
            self._up.set()
            await self._down.wait()

    @property
    def port(self):
        return int(self.url.split("/")[2].rpartition(":")[2])

    def stop(self):
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._down.set)
            self._thread.join(30)


def until(page, expression, timeout_s=60.0):
    """Wait until a JavaScript expression is true on a page.

    The page itself evaluates it repeatedly, because each request of Playwright takes milliseconds
    of processor time. Playwright's `wait_for_function` cannot be used, because the page's security
    policy forbids it.
    """
    came = page.evaluate(
        f"""async (end_ms) => {{
          while (!({expression})) {{
            if (Date.now() > end_ms) return false;
            await new Promise((done) => setTimeout(done, 20));
          }}
          return true;
        }}""",
        1000 * (time.time() + timeout_s),
    )
    assert came, "it never came"


def eventually(condition, timeout_s=60.0, every_s=0.02):
    """Wait until ``condition()`` is true; pages continue to run, but no event handler is called."""
    end_s = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < end_s, "it never came"
        time.sleep(every_s)


def apart(function, *arguments, timeout_s=120.0):
    """Call a function in another thread, because Playwright's event loop runs in this thread."""
    result = Future()

    def call():
        try:
            result.set_result(function(*arguments))
        except BaseException as error:
            result.set_exception(error)

    threading.Thread(target=call, daemon=True).start()
    return result.result(timeout_s)


def send_from_other_site(browser, server, other_port, path, *messages):
    """Let a page of another site send messages to a server, in a browser with the server's token.

    Parameters
    ----------
    browser : playwright.sync_api.Browser
        The browser.
    server : Serving
        Server to attack.
    other_port : int
        TCP port of the other site.
    path : str
        Path of the URL to which the messages are sent.
    messages : str
        Bodies of POST requests.
    """
    context = browser.new_context()
    try:
        context.new_page().goto(server.url)  # now this browser has the token
        page = context.new_page()
        for host in ("localhost", "127.0.0.1"):
            page.goto(f"http://{host}:{other_port}/")
            for message in messages:
                page.evaluate(
                    """([url, body]) => fetch(url, {
                      method: "POST", mode: "no-cors", credentials: "include", body,
                    }).then(() => 0, () => 0)""",
                    [f"http://127.0.0.1:{server.port}/{path}", message],
                )
    finally:
        context.close()


def run(coroutine):
    """Run a coroutine in another thread and return its result."""
    return apart(asyncio.run, coroutine)


def post(server, word, path="recording", token=None, **headers):
    """Send a POST request with the body `word`; return HTTP status and text of the answer."""

    async def ask():
        cookies = {f"spots-token-{server.port}": token} if token else {}
        url = f"http://127.0.0.1:{server.port}/{path}"
        async with (
            aiohttp.ClientSession(cookies=cookies) as session,
            session.post(url, data=word, headers=headers) as answer,
        ):
            return answer.status, await answer.text()

    return run(ask())


def token_of(server):
    return server.url.split("?token=")[1]
