"""Records a clip of the live page under a finger: docs/pictures/live.webp, from build/live."""

from __future__ import annotations

import functools
import io
import sys
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

_ROOT = Path(__file__).parents[2]
_CLIP = _ROOT / "docs" / "pictures" / "live.webp"
sys.path.append(str(_ROOT / "tests"))
from support.bring_browser import launch_options  # noqa: E402

_SIZE = {"width": 960, "height": 760}  # with the keys, and the text that they type
_FRAME_MS = 120
# Frames with a finger at a place in mm, or without one: three taps, a slide, then another tap.
_PATH = [12.0] * 3 + [None] * 2 + [46.0] * 3 + [None] * 2 + [80.0] * 3 + [None] * 3
_PATH += [20.0 + 2.5 * i for i in range(20)] + [None] * 3 + [38.0] * 3 + [None] * 4
# Whether the page shows a press at a place, or none.
_SHOWN = """(mm) => {
  const mark = document.querySelector("#strip .press");
  const off_mm = Math.abs(parseFloat(document.querySelector("#figures b").textContent) - mm);
  return mm === null ? !mark.classList.contains("on") : off_mm < 0.5;
}"""


class _Quiet(SimpleHTTPRequestHandler):
    def log_message(self, *arguments) -> None:
        pass


def main() -> None:
    """Serve the page, press it, and write the clip."""
    handler = functools.partial(_Quiet, directory=str(_ROOT / "build" / "live"))
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server, sync_playwright() as playwright:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        browser = playwright.chromium.launch(**launch_options(playwright))
        page = browser.new_page(viewport=_SIZE, color_scheme="light")
        page.goto(f"http://127.0.0.1:{server.server_port}/")
        page.wait_for_selector("#board[data-state=connected]")
        frames = list(_frames(page))
        browser.close()
        server.shutdown()
    frames[0].save(
        _CLIP, save_all=True, append_images=frames[1:], duration=_FRAME_MS, loop=0, quality=55
    )
    print(_CLIP)


def _frames(page: Page):
    box = page.locator("#strip .track").bounding_box()
    down = False
    for mm in _PATH:
        if mm is not None:
            page.mouse.move(box["x"] + mm / 85 * box["width"], box["y"] + box["height"] / 2)
        if (mm is not None) != down:
            down = not down
            page.mouse.down() if down else page.mouse.up()
        page.wait_for_function(_SHOWN, arg=mm)  # a busy computer is late
        page.wait_for_timeout(_FRAME_MS)
        yield Image.open(io.BytesIO(page.screenshot())).convert("RGB")


if __name__ == "__main__":
    main()
