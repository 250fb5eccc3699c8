"""Panels that other packages add to the web UI: an installed package, and packages with faults."""

from __future__ import annotations

import re
import subprocess
import sys
from argparse import Namespace
from pathlib import Path

import aiohttp
import pytest
from playwright.sync_api import expect
from support.serving import apart, run, until
from yarl import URL

from spots import cli
from spots.common import plugins
from spots.keyboard.layout import load
from spots_sim.strip.scenario import Held, Press
from spots_web import panels
from spots_web.board_feed import BoardReader
from spots_web.panel_feed import OpenPanels
from spots_web.state import PageState

LONG_MS = 60_000
KNOB = Path(__file__).parents[2] / "examples" / "volume_knob"
PROGRAM = [sys.executable, "-m", "spots"]


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """Folder in which pip has installed the example; a program finds it through PYTHONPATH."""
    folder = tmp_path_factory.mktemp("installed")
    subprocess.run(
        [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-build-isolation"]
        + ["--disable-pip-version-check", "--target", str(folder), str(KNOB)],
        check=True,
    )
    return folder


@pytest.fixture
def plugged(monkeypatch):
    """Return a function that adds packages with panels: a folder for `sys.path`."""

    def forget():
        plugins._installed.cache_clear()
        panels.installed.cache_clear()

    def plug(folder):
        monkeypatch.syspath_prepend(str(folder))
        forget()

    yield plug
    monkeypatch.undo()
    forget()


def package(folder, name, python, entry=None, **files):
    """Write an installed package with a panel, as pip does."""
    (folder / f"{name}.py").write_text(python)
    for file, text in files.items():
        (folder / f"{name}_static").mkdir(exist_ok=True)
        (folder / f"{name}_static" / f"{file}.js").write_text(text)
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    group = f"[{panels.GROUP}]\n{entry or name.replace('_', '-')} = {name}:Panel\n"
    (info / "entry_points.txt").write_text(group)


PANEL = """
from pathlib import Path
class Panel:
    title = "Mine"
    static = Path(__file__).with_name("{name}_static")
    def __init__(self, show, options):
        show({{"value": 5}})
"""
DRAWS = "export const panel = (root) => ({ value }) => root.append(`value ${value}`);"


def options(**more):
    return Namespace(linkage=None, port=[], **more)


def post(server, path, body):
    """Send a POST request with the token; return status and text of the answer."""

    async def ask():
        jar = aiohttp.CookieJar(unsafe=True)
        async with aiohttp.ClientSession(cookie_jar=jar) as session:
            async with session.get(server.url):
                pass
            url = URL(server.url).with_path(path).with_query(None)
            async with session.post(url, data=body) as answer:
                return answer.status, await answer.text()

    return run(ask())


def test_the_example_is_small():
    for name, lines in {"__init__.py": 60, "static/panel.js": 40}.items():
        text = (KNOB / "volume_knob" / name).read_text(encoding="utf-8")
        assert 20 < sum(map(bool, map(str.strip, text.splitlines()))) <= lines


@pytest.mark.board
def test_the_example_adds_a_command(installed, monkeypatch, tmp_path):
    monkeypatch.setenv("PYTHONPATH", str(installed))
    line = ["volume", "--dry-run", "--port", "virtual", "--seconds", "5"]
    done = subprocess.run([*PROGRAM, *line], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 0, done.stderr
    pressed = re.findall(r"^down +(\w+)", done.stdout, re.MULTILINE)
    # The simulated finger slides 70 mm away from the sensor, and back.
    assert 20 < pressed.count("VOLUME_INCREMENT") < 40
    assert 20 < pressed.count("VOLUME_DECREMENT") < 40


def test_the_example_adds_a_panel(installed, monkeypatch, tmp_path, open_page):
    monkeypatch.setenv("PYTHONPATH", str(installed))
    line = ["serve", "--port", "virtual", "--http-port", "0"]
    with subprocess.Popen(
        [*PROGRAM, *line], stdout=subprocess.PIPE, text=True, cwd=tmp_path
    ) as server:
        try:
            address = apart(server.stdout.readline)
            page = open_page(re.search(r"http://\S+", address)[0])
            panel = page.get_by_role("region", name="Volume")
            volume = panel.locator(".volume")
            expect(volume).to_be_visible(timeout=LONG_MS)
            percent = "parseInt(document.querySelector('#panel-volume .volume').textContent)"
            until(page, f"{percent} > 80")  # the simulated finger slides 70 mm and back
            until(page, f"{percent} < 45")
            panel.get_by_role("button", name="mute").click()
            until(page, f"{percent} < 5")
        finally:
            server.terminate()


@pytest.mark.board
def test_a_panel_is_guarded_as_the_page_is(installed, plugged, serve):
    plugged(installed)
    state = PageState()
    opened = OpenPanels(state, options())
    server = serve(state, queues=opened.requests)

    async def ask(method, path, **headers):
        async with (
            aiohttp.ClientSession() as session,
            session.request(
                method, URL(server.url).with_path(path).with_query(None), headers=headers
            ) as answer,
        ):
            return answer.status, answer.headers

    code, headers = run(ask("GET", "/panels/volume/panel.js"))
    assert code == 200
    assert headers["Content-Security-Policy"].startswith("default-src 'none'; script-src 'self'")
    assert headers["Content-Type"].startswith("text/javascript")
    for path in ("/panels/volume/__init__.py", "/panels/none/panel.js", "/panels/volume/"):
        assert run(ask("GET", path))[0] == 404
    assert run(ask("GET", "/panels/volume/panel.js", Host="evil.example"))[0] == 403
    assert run(ask("POST", "/panels/volume"))[0] == 403  # without the token
    assert post(server, "/panels/volume", b"50") == (409, "there is no board: plug one in")
    assert post(server, "/panels/volume", b"{")[0] == 400


@pytest.mark.board
def test_requests_reach_the_panel_in_the_thread_that_reads_the_board(
    installed, plugged, bench, serve
):
    plugged(installed)
    one = bench(Held())
    opened = OpenPanels(one.state, options())
    one.reader.stop(timeout_s=30)
    reader = BoardReader(
        one._open, load("digits"), one.state, 0.05, opened.on_touch, opened.requests.values()
    )
    server = serve(one.state, queues=opened.requests)
    reader.start()
    try:
        while (answer := post(server, "/panels/volume", b"30"))[0] == 409:
            assert answer[1] == "there is no board: plug one in"
        assert answer == (204, "")
        refusal = "a volume is a number of percent from 0 to 100"
        assert post(server, "/panels/volume", b"300") == (409, refusal)
    finally:
        reader.stop(timeout_s=30)
    assert one.state.since(one.state.begin()._replace(version=0))[1]["panel-volume"] == {
        "percent": 30.0
    }


FAULTS = {
    "import": ("import nothing_of_this_name\n", None, "ModuleNotFoundError: No module named"),
    "class": ("Panel = 5\n", None, "AttributeError"),
    "script": (PANEL, None, "there is no file panel.js"),
    "name": (PANEL, "../touch", "its name has other characters"),
    "start": (PANEL + "        raise KeyError(1)\n", None, "KeyError: 1"),
    "option": (
        PANEL + "    def add_options(parser):\n        parser.flag('--host', '')\n",
        None,
        "ArgumentError",
    ),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_panel_that_cannot_be_loaded_is_one_sentence(
    fault, plugged, tmp_path, monkeypatch, capsys, serve, open_page
):
    python, entry, words = FAULTS[fault]
    files = {} if fault == "script" else {"panel": DRAWS}
    package(tmp_path, f"bad_{fault}", python.format(name=f"bad_{fault}"), entry, **files)
    plugged(tmp_path)
    served = []
    monkeypatch.setattr("spots_web.serve.serve", lambda state, *_, **__: served.append(state))
    assert cli.main(["serve", "--port", "nowhere"]) == 0
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"spots: the panel '{entry or f'bad-{fault}'}' of bad_{fault} cannot be")
    assert words in line
    assert line.endswith(": update or remove this package")
    page = open_page(serve(served[0]).url)
    expect(page.locator(".plugin > .remark")).to_have_text(line.removeprefix("spots: "))
    expect(page.locator("#board")).to_be_visible()


SCRIPTS = {
    "syntax": "export const panel = (root) => {",
    "export": "export const other = 5;",
    "start": "export const panel = () => { throw new Error('no start'); };",
    "draw": "export const panel = () => () => { throw new Error('no picture'); };",
}


@pytest.mark.parametrize("fault", SCRIPTS)
def test_the_page_works_without_a_panel_whose_script_fails(
    fault, plugged, tmp_path, bench, serve, open_page
):
    for name, script in {"good": DRAWS, "bad": SCRIPTS[fault]}.items():
        package(tmp_path, f"a_{name}", PANEL.format(name=f"a_{name}"), name, panel=script)
    plugged(tmp_path)
    held = Held()
    held.press = Press(40.0, 3000, 4.0)
    one = bench(held)
    OpenPanels(one.state, options())
    page = open_page(serve(one.state).url)
    sentence = re.compile(r"^the panel .Mine. cannot be shown \(.+\): update or remove its package")
    expect(page.locator("#panel-bad .remark")).to_have_text(sentence)
    expect(page.locator("#panel-good")).to_contain_text("value 5")
    expect(page.locator(".press.on")).to_have_count(1, timeout=LONG_MS)


def test_a_panel_that_fails_at_a_reading_stops_nothing(plugged, tmp_path, capsys):
    bad = PANEL + "    def on_touch(self, touch):\n        raise KeyError(touch)\n"
    package(tmp_path, "fails", bad.format(name="fails"), panel=DRAWS)
    good = PANEL + "    def on_touch(self, touch):\n        self.show(touch)\n"
    good = good.replace("        show(", "        self.show = show\n        show(")
    package(tmp_path, "works", good.format(name="works"), panel=DRAWS)
    plugged(tmp_path)
    state = PageState()
    opened = OpenPanels(state, options())
    opened.on_touch(7)
    news = state.since(state.begin()._replace(version=0))[1]
    assert (news["panel-fails"], news["panel-works"]) == ({"value": 5}, 7)
    opened.on_touch(object())  # is not of JSON types, so browsers get the value of before
    assert state.since(state.begin()._replace(version=0))[1]["panel-works"] == 7
    said = capsys.readouterr().err
    assert "the panel 'fails' failed: please report this fault" in said
    assert "the panel 'works' failed: please report this fault" in said
