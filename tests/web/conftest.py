"""Fixtures: a real Chromium, and boards and web servers that end with their test."""

from __future__ import annotations

import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest
from playwright.sync_api import expect
from support.browsing import browser, open_page, playing  # noqa: F401
from support.serving import Bench, Serving

from spots.keyboard.layout import load
from spots_linkage.panel import driven_sources
from spots_sim.demo.linkage_demo import endless
from spots_web.panel_feed import readers_of, shower
from spots_web.state import PageState


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
