"""Fixtures: a real Chromium, and boards and web servers that end with their test."""

from __future__ import annotations

import asyncio
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
from playwright.sync_api import expect, sync_playwright
from support.bring_browser import launch_options
from support.serving import Bench, Serving

from spots.keyboard.layout import load
from spots_linkage.panel import driven_sources
from spots_sim.demo.linkage_demo import endless
from spots_web.panel_feed import readers_of, shower
from spots_web.state import PageState

# Playwright's default timeout of 5 s is too short for a machine under load.
expect.set_options(timeout=60_000)

# The browser itself logs these errors while there is no server, when the server refuses a request,
# or when a page closes or reloads during a request; a page cannot prevent this.
_ACCEPTED = "net::ERR_CONNECTION_REFUSED", "status of 409", "net::ERR_ABORTED"

# Records in `window.drawn` the readings that a page has drawn, with their times, and in
# `window.underway` the largest number of messages that the page had not acknowledged.
_RECORD = """
window.drawn = [];
document.addEventListener("drawn", ({ detail }) => {
  const record = { ...detail };
  // The frame is on the screen when this task is over and the next one begins.
  const channel = new MessageChannel();
  channel.port1.onmessage = () => {
    record.shown_s = (performance.timeOrigin + performance.now()) / 1000;
    window.drawn.push(record);
    if (window.drawn.length > 5000) window.drawn.shift();
  };
  channel.port2.postMessage(null);
});
window.underway = 0;
window.WebSocket = class extends WebSocket {
  #drawn = 0;
  constructor(url) {
    super(url);
    this.addEventListener("message", ({ data }) => {
      const number = Number(/"n":(\\d+)/.exec(data)[1]);
      window.underway = Math.max(window.underway, number - this.#drawn);
    });
  }
  send(number) {
    super.send(number);
    this.#drawn = Number(number);
  }
};
"""


@pytest.fixture(scope="session")
def playing():
    """Chromium, which each process of the tests starts one time, and Playwright's event loop."""
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(**launch_options(playwright))
        loop = asyncio.get_running_loop()
        asyncio.events._set_running_loop(None)
        yield chromium, loop
        asyncio.events._set_running_loop(loop)
        chromium.close()


@pytest.fixture(scope="module")
def browser(playing):
    """Chromium, for one module of tests.

    After the module, asyncio no longer reports Playwright's event loop as running in this thread,
    because other tests run their own event loops.
    """
    chromium, loop = playing
    asyncio.events._set_running_loop(loop)
    yield chromium
    asyncio.events._set_running_loop(None)


@pytest.fixture
def open_page(browser):
    """Return a function that opens a URL and returns the page.

    The test fails at its end if a page reported an error.
    """
    contexts, errors = [], []

    def note(kind, text):
        if not any(words in text for words in _ACCEPTED):
            errors.append(f"{kind}: {text}")

    def open_page(url, **options):
        contexts.append(browser.new_context(**options))
        contexts[-1].add_init_script(_RECORD)
        page = contexts[-1].new_page()
        page.on("console", lambda m: m.type == "error" and note(m.type, m.text))
        page.on("pageerror", lambda error: note("exception", str(error)))
        page.on("requestfailed", lambda r: note("request", f"{r.url} {r.failure}"))
        page.goto(url)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert not errors


@pytest.fixture
def bench(sensor, calibration):
    """Return a function that creates a `serving.Bench`; each is closed after the test."""
    made = []

    def make(scenario, **options):
        made.append(Bench(sensor, calibration, scenario, **options))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.fixture
def serve():
    """Return a function that starts a `serving.Serving`; each is stopped after the test."""
    made = []

    def make(state, **options):
        made.append(Serving(state, **options))
        return made[-1]

    yield make
    for one in made:
        one.stop()


@pytest.fixture
def running():
    """Return a function that starts board readers (a list), which are stopped after the test."""
    started = []

    def start(readers):
        for one in readers:
            started.append(one)
            one.start()

    yield start
    for one in started:
        one.stop(timeout_s=30)


@pytest.fixture
def linkage_page(running, serve, open_page):
    """Return a function that opens the web UI of a simulated linkage; it takes browser options."""

    def make(**options):
        state = PageState()
        running(
            readers_of(
                driven_sources(endless("default"), shower(state, "twin")), load("digits"), state
            )
        )
        page = open_page(serve(state).url, **options)
        expect(page.locator("#panel-twin .figures")).to_contain_text(" mm")
        return page

    return make


@pytest.fixture
def other_site():
    """TCP port of a web server that is another site than the web UI."""

    class Other(BaseHTTPRequestHandler):
        def do_GET(self):
            self.send_response(200)
            self.end_headers()
            self.wfile.write(b"<!doctype html><title>other</title>")

        def log_message(self, *arguments):
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Other) as other:
        threading.Thread(target=other.serve_forever, daemon=True).start()
        yield other.server_port
        other.shutdown()
