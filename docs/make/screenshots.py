"""Takes screenshots of the web UI with a virtual board in real time, in the tests' Chromium."""

from __future__ import annotations

import asyncio
import sys
from pathlib import Path

from playwright.async_api import Browser, async_playwright

from spots.keyboard.layout import load
from spots.web.board_feed import BoardReader, finder
from spots.web.serve import Server
from spots.web.state import PageState
from spots.web.twin_feed import driven_readers
from spots_sim.linkage_demo import endless

_HERE = Path(__file__).parents[1]
sys.path.append(str(_HERE.parent / "tests" / "web"))
from bring_browser import launch_options  # noqa: E402

# Wait until the plots of ten seconds are full and a finger presses with this force.
_AFTER_S = 12.0
_HARD_N = 5.5
_FORCE_N = "Number(document.querySelectorAll('.figure b')[1].firstChild.data) || 0"
_PICTURES = {
    "page-dark.png": {"color_scheme": "dark", "viewport": {"width": 1180, "height": 800}},
    "page-light.png": {"color_scheme": "light", "viewport": {"width": 1180, "height": 800}},
    "page-phone.png": {"color_scheme": "dark", "viewport": {"width": 390, "height": 800}},
}


async def main() -> None:
    """Take all screenshots."""
    async with async_playwright() as playwright:
        browser = await playwright.chromium.launch(**launch_options(playwright))
        await strip(browser)
        await linkage(browser)
        await browser.close()


async def strip(browser: Browser) -> None:
    """Take the screenshots of a strip."""
    state = PageState()
    reader = BoardReader(finder("virtual", "default", "demo", seed=0), load("digits"), state)
    async with Server(state) as server:
        reader.start()
        for name, options in _PICTURES.items():  # one at a time, to limit the processor load
            context = await browser.new_context(**options, device_scale_factor=1.5)
            page = await context.new_page()
            await page.goto(server.url)
            await page.wait_for_selector("#board[data-state=connected]")
            await asyncio.sleep(_AFTER_S)
            while await page.evaluate(_FORCE_N) < _HARD_N:
                await asyncio.sleep(0.05)
            await page.screenshot(path=_HERE / name, full_page=True)
            await context.close()
            print(_HERE / name)
    reader.stop()


async def linkage(browser: Browser) -> None:
    """Take the screenshot of a linkage that has written all its letters."""
    state = PageState()
    readers = driven_readers(endless(), load("digits"), state)
    async with Server(state) as server:
        for reader in readers:
            reader.start()
        viewport = {"width": 1180, "height": 800}
        context = await browser.new_context(
            color_scheme="dark", viewport=viewport, device_scale_factor=1.5
        )
        page = await context.new_page()
        await page.goto(server.url)
        await asyncio.sleep(_AFTER_S)
        await page.locator("#twin").screenshot(path=_HERE / "page-twin.png")
        await context.close()
        print(_HERE / "page-twin.png")
    for reader in readers:
        reader.stop()


if __name__ == "__main__":
    asyncio.run(main())
