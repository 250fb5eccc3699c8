"""Takes screenshots of the web UI with a virtual board in real time, in the tests' Chromium."""

from __future__ import annotations

import asyncio
import sys
import time
from pathlib import Path
from tempfile import TemporaryDirectory

from playwright.async_api import Browser, async_playwright, expect

from spots.keyboard.layout import load
from spots.link.board import Board
from spots.link.finder import finder
from spots_linkage.panel import driven_sources
from spots_sim.board.lockstep import LockstepLink
from spots_sim.board.paced import PacedLink
from spots_sim.demo.linkage_demo import endless
from spots_sim.strip.files import SensorFile
from spots_sim.strip.files import load as load_file
from spots_sim.strip.scenario import Held, Press
from spots_web.board_feed import BoardReader
from spots_web.calibration import PageCalibration
from spots_web.editors import LayoutEditor, SettingsEditor
from spots_web.panel_feed import readers_of, shower
from spots_web.serve import Server
from spots_web.state import PageState

_FOLDER = Path(__file__).parents[1] / "pictures"
sys.path.append(str(_FOLDER.parents[1] / "tests"))
from support.bring_browser import launch_options  # noqa: E402

# Before a screenshot: wait until the plots of ten seconds are full, and then until a finger presses
# with this force.
_AFTER_S = 12.0
_HARD_N = 5.5
_SIGNAL_S = 6.0  # time in which the plots of the controller settings fill
_LONG_MS = 60_000
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
        await calibration(browser)
        await editor(browser)
        await browser.close()


async def strip(browser: Browser) -> None:
    """Take the screenshots of a strip."""
    state = PageState()
    reader = BoardReader(finder("virtual"), load("digits"), state)
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
            await page.screenshot(path=_FOLDER / name, full_page=True)
            await context.close()
            print(_FOLDER / name)
    reader.stop()


async def linkage(browser: Browser) -> None:
    """Take the screenshot of a simulated linkage that has written its letters."""
    state = PageState()
    readers = readers_of(driven_sources(endless(), shower(state, "twin")), load("digits"), state)
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
        await page.locator("#panel-twin").screenshot(path=_FOLDER / "page-twin.png")
        await context.close()
        print(_FOLDER / "page-twin.png")
    for reader in readers:
        reader.stop()


async def calibration(browser: Browser) -> None:
    """Take the screenshot of a calibration session in which a finger presses beside the mark."""
    state, held = PageState(), Held()
    with TemporaryDirectory() as folder:
        queues = {"calibration": PageCalibration(Path(folder) / "calibration.jsonl", state)}
        sensor = load_file(SensorFile, "default")

        def open_board(board_id: str | None) -> Board:
            return Board(PacedLink(LockstepLink(sensor, held), time.monotonic()))

        reader = BoardReader(open_board, load("digits"), state, queues=queues.values())
        async with Server(state, queues=queues) as server:
            reader.start()
            viewport = {"width": 390, "height": 844}
            context = await browser.new_context(
                color_scheme="dark", viewport=viewport, device_scale_factor=1.5, has_touch=True
            )
            page = await context.new_page()
            await page.goto(server.url)
            await page.locator("#calibration .kind[value=rough]").click()
            asked, mark = page.locator("#calibration .todo"), page.locator("#calibration .aim b")
            confirm = page.locator("#calibration .answer .main")
            for _ in range(5):
                await expect(asked).to_contain_text("press at", timeout=_LONG_MS)
                held.press = Press(float((await mark.inner_text()).split()[0]), 6000, 4.0)
                await expect(asked).to_contain_text("release", timeout=_LONG_MS)
                held.press = None
                await confirm.click(timeout=_LONG_MS)
                await confirm.wait_for(state="hidden", timeout=_LONG_MS)
            await expect(asked).to_contain_text("press at", timeout=_LONG_MS)
            held.press = Press(float((await mark.inner_text()).split()[0]) - 9, 6000, 4.0)
            await page.locator("#calibration .finger.on").wait_for(timeout=_LONG_MS)
            while "\n0\n" in await page.locator("#spectrum").inner_text():
                await asyncio.sleep(0.05)
            await page.screenshot(path=_FOLDER / "page-calibration.png")
            await context.close()
            print(_FOLDER / "page-calibration.png")
        reader.stop()


async def editor(browser: Browser) -> None:
    """Take screenshots of layout editor and controller settings while a finger is on the strip."""
    with TemporaryDirectory() as folder:
        state, layout = PageState(), load("mini")
        queues = {
            "layout": LayoutEditor(Path(folder) / "mine.toml", layout, state),
            "controller": SettingsEditor("controller", Path(folder) / "controller.toml", state),
        }
        open_board = finder("virtual")
        reader = BoardReader(open_board, layout, state, queues=queues.values())
        async with Server(state, queues=queues) as server:
            reader.start()
            context = await browser.new_context(
                viewport={"width": 1180, "height": 860}, device_scale_factor=1.5
            )
            page = await context.new_page()
            await page.goto(server.url)
            await page.locator("#edit").click(timeout=_LONG_MS)
            await page.locator("#editor .zone").nth(3).click()
            await page.get_by_role("combobox", name="double tap").fill("ctrl+z")
            while await page.evaluate(_FORCE_N) < _HARD_N:
                await asyncio.sleep(0.05)
            await page.screenshot(path=_FOLDER / "page-editor.png")
            print(_FOLDER / "page-editor.png")
            await page.locator("#edit-controller").click()
            await asyncio.sleep(_SIGNAL_S)
            await page.locator("#controller").evaluate("panel => panel.scrollIntoView()")
            await page.screenshot(path=_FOLDER / "page-controller.png")
            await context.close()
            print(_FOLDER / "page-controller.png")
        reader.stop()


if __name__ == "__main__":
    asyncio.run(main())
