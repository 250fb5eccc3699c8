"""Fixtures of tests with a real browser: Chromium, and a page that reports its errors."""

from __future__ import annotations

import asyncio

import pytest
from playwright.sync_api import expect, sync_playwright

from support.bring_browser import launch_options

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


def click_opener(page, opener):
    """Click the button that opens an editor, on a page with all of them.

    The page shows these buttons one by one, and each moves the others: a click meanwhile may begin
    on one button and end on another, which opens nothing.
    """
    page.locator("#edit-gestures").wait_for(timeout=60_000)
    page.locator(opener).click(timeout=60_000)


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

    `scripts` run in the page before its own; `routes` are functions that answer requests, by the
    pattern of their URL. The test fails at its end if a page reported an error.
    """
    contexts, errors = [], []

    def note(kind, text):
        if not any(words in text for words in _ACCEPTED):
            errors.append(f"{kind}: {text}")

    def open_page(url, scripts=(), routes=None, **options):
        contexts.append(browser.new_context(**options))
        for script in (_RECORD, *scripts):
            contexts[-1].add_init_script(script)
        for pattern, answer in (routes or {}).items():
            contexts[-1].route(pattern, answer)
        page = contexts[-1].new_page()
        page.on("console", lambda m: m.type == "error" and note(m.type, m.text))
        page.on("pageerror", lambda error: note("exception", str(error)))
        page.on("requestfailed", lambda r: note("request", f"{r.url} {r.failure}"))
        page.goto(url)
        return page

    yield open_page
    for context in contexts:
        context.close()
    assert errors == [], errors
