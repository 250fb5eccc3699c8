"""A person calibrates a strip in the web UI; a browser without the access token can only watch."""

from __future__ import annotations

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
from playwright.sync_api import expect
from support.person import Person, look
from support.refusals import refusal
from support.serving import (
    Bench,
    Serving,
    apart,
    eventually,
    post,
    send_from_other_site,
    token_of,
    until,
)

from spots.calibrate import calibration_file
from spots.calibrate.session.session_file import Session
from spots.cli import main
from spots.errors import StateError
from spots_device.board.settings import checksum
from spots_device.reading.calibration import Calibration
from spots_sim.strip.change import Change
from spots_sim.strip.optics import Optics
from spots_sim.strip.scenario import Held, Press
from spots_web import calibration as page_calibration
from spots_web.calibration import PageCalibration
from spots_web.state import PageState

LONG_MS = 60_000
SPEED = 4.0  # of the board's time, relative to real time
SLOWLY = 0.2  # speed while a test must see a state that ends soon
PHONE = {"viewport": {"width": 390, "height": 844}, "has_touch": True, "is_mobile": True}
START = {"do": "start", "kind": "rough", "length_mm": 85.0}
FIGURE = "Number(document.querySelector('.figure b').firstChild.data)"


@pytest.fixture
def table(sensor, serve, tmp_path):
    """A board without a calibration, its web server, and the simulated finger."""

    class Table:
        held = Held()
        path = tmp_path / "calibration.jsonl"
        bench = Bench(sensor, None, held, session=path, speed=SPEED)
        server = serve(bench.state, queues=bench.queues)
        length_mm = sensor.length_mm

        def shown(self):
            return self.bench.state.since(self.bench.state.begin())[1]["calibration"]

        def send(self, message, **options):
            options = {"token": token_of(self.server)} | options
            body = message if isinstance(message, (bytes, str)) else json.dumps(message)
            return post(self.server, body, path="calibration", **options)

        def person(self, page, **options):
            return Person(page, self.held, self.length_mm, **options)

    made = Table()
    yield made
    made.bench.close()


def pressing(seen):
    return seen["todo"].startswith("Press") and seen["share"] is not None


def at_press(number):
    """Return a condition for `Person.wait`: the page asks for a press after `number` presses."""
    return lambda seen: pressing(seen) and seen["count"].startswith(f"{number} of 1")


def press_and_read(page, held, places_mm):
    """Press at each position until the page shows it to within 1 mm, then lift."""
    for place_mm in places_mm:
        held.press = Press(place_mm, 4000.0, 4.0)
        until(page, f"Math.abs({FIGURE} - {place_mm}) < 1.0")
        held.press = None
        until(page, f"Number.isNaN({FIGURE})")


def test_a_clumsy_person_calibrates_roughly(table, open_page):
    page = open_page(table.server.url, **PHONE)
    person = table.person(page, place_mm=0.5)
    person.go_on(lambda seen: seen["starts"])
    person.start("rough")
    seen = person.wait(pressing)
    assert seen["todo"] == "Press at 2.0 mm with your hardest press and hold"
    assert "touch nothing" not in seen["note"] + seen["said"]  # the step without a touch is over
    expect(page.locator("#next")).to_be_hidden()  # advice about the readings before the session
    # The person lifts before the press is steady, and presses again.
    person.go_on(at_press(2))
    person.press(look(page))
    page.wait_for_timeout(100)
    person.lift()
    person.wait(lambda seen: seen["trouble"] == "no press is seen" or not pressing(seen))
    # The person undoes a press.
    person._last = None
    person.go_on(at_press(4))
    places = [p.place_um for p in Session(table.path).of("hand")]
    page.get_by_role("button", name="Undo the last press").click()
    person.go_on(at_press(3))
    assert [p.place_um for p in Session(table.path).of("hand")] == places[:-1]
    # The page shows the approximate position of the finger.
    person.go_on(at_press(5))
    table.bench.link.pace(SLOWLY)
    person.press(look(page))
    seen = person.wait(lambda seen: seen["finger"] is not None and seen["steady"] > 0)
    table.bench.link.pace(SPEED)
    assert abs(seen["finger"] - seen["share"]) < 0.06
    # A wrong unit, and a press that the person wants to repeat.
    person.go_on(lambda seen: seen["asks"])
    page.get_by_label("Position in mm").fill("42 furlongs")
    page.locator("#calibration .main").click()
    person.wait(lambda seen: "is not valid" in seen["note"])
    page.get_by_role("button", name="Press again").click()
    person._last = None
    seen = person.go_on()
    assert seen["todo"] == "The board is calibrated"
    assert "has stored it" in seen["said"]
    assert len(Session(table.path).points) <= 12
    expect(page.get_by_role("img", name="largest error")).to_be_visible()
    expect(page.locator(".figure").nth(1)).to_contain_text("relative")
    press_and_read(page, table.held, (8.0, 42.0, 77.0))


def test_the_keyboard_alone_is_enough(table, open_page):
    page = open_page(table.server.url, viewport={"width": 844, "height": 390})
    person = table.person(page)
    person.go_on(lambda seen: seen["starts"])
    person.answer = lambda seen: page.keyboard.press("Enter")

    def focus(name):
        for _ in range(30):
            page.keyboard.press("Tab")
            if name in page.evaluate("document.activeElement.textContent"):
                return
        raise AssertionError(name)

    focus("Rough")
    page.keyboard.press("Enter")
    person.go_on(at_press(2))
    focus("Undo")
    page.keyboard.press("Enter")
    person.go_on(at_press(1))
    focus("Stop")
    page.keyboard.press("Enter")
    assert person.go_on()["todo"] == "The session is stopped"


def test_a_reload_continues_and_another_page_watches(table, open_page):
    page = open_page(table.server.url)
    person = table.person(page)
    person.go_on(lambda seen: seen["starts"])
    person.start("rough")
    person.go_on(at_press(2))
    expect(page.locator("#next")).to_be_hidden()  # no advice while the session shows the next step
    watcher = open_page(f"http://127.0.0.1:{table.server.port}/")
    watching = Person(watcher, table.held, table.length_mm).wait(pressing)
    seen = look(page)
    assert watching["todo"] == seen["todo"]
    assert watching["share"] == pytest.approx(seen["share"], abs=0.01)
    assert not watching["may_stop"]
    expect(watcher.get_by_text("This browser only watches")).to_be_visible()
    page.reload()
    person.wait(pressing)
    assert look(page)["count"] == seen["count"]
    assert person.go_on(at_press(3))["may_stop"]
    assert not look(watcher)["asks"]
    page.get_by_role("button", name="Stop").click()
    person.wait(lambda seen: seen["starts"])
    assert not look(watcher)["starts"]
    # The session continues at the same step, and the page shows readings again.
    table.held.press = Press(40.0, 4000, 4.0)
    expect(page.locator(".words")).to_contain_text("not calibrated", timeout=LONG_MS)
    table.held.press = None
    page.wait_for_timeout(300)
    person.start("rough")
    person.wait(at_press(3))


def test_a_board_that_is_unplugged_ends_the_session_in_a_sentence(table, open_page):
    page = open_page(table.server.url)
    person = table.person(page)
    person.go_on(lambda seen: seen["starts"])
    person.start("rough")
    person.go_on(at_press(2))
    table.bench.unplug()
    seen = person.go_on()
    assert seen["todo"] == "The session has ended early"
    assert "disconnected" in seen["note"]
    person.lift()  # the finger may have followed the last request
    table.bench.replug()
    expect(page.locator("#board")).to_have_attribute("data-state", "connected", timeout=LONG_MS)
    person.start("rough")
    person.wait(at_press(2))


def test_only_the_token_calibrates(table, tmp_path):
    before = table.shown()
    old = Serving(PageState(), queues={"calibration": PageCalibration(tmp_path / "b", PageState())})
    stale = token_of(old)
    old.stop()
    for message in (
        START,
        {"do": "answer", "step": 1, "text": ""},
        {"do": "undo", "step": 1},
        {"do": "cancel"},
    ):
        for token in (None, "", "wrong", stale, token_of(table.server)[:-1]):
            assert table.send(message, token=token)[0] == 403
        for origin in ("http://evil.example", "null", f"https://127.0.0.1:{table.server.port}"):
            assert table.send(message, Origin=origin)[0] == 403
        assert table.send(message, Host="evil.example")[0] == 403
    assert table.shown() == before
    assert not table.path.exists()


BAD = (
    b"",
    b"start",
    b"\xff\xfe",
    b"null",
    b"[]",
    b"{}",
    b'{"do":"start"}',
    b'{"do":"stop"}',
    b'{"do":["start"]}',
    b'{"do":"cancel","path":"/etc/passwd"}',
    b'{"do":"start","kind":"rough","length_mm":0}',
    b'{"do":"start","kind":"rough","length_mm":1e999}',
    b'{"do":"start","kind":"rough","length_mm":NaN}',
    b'{"do":"start","kind":"rough","length_mm":"85"}',
    b'{"do":"start","kind":"../rough","length_mm":85}',
    b'{"do":"start","kind":"joint","length_mm":85}',
    b'{"do":"answer","step":1}',
    b'{"do":"answer","step":1.5,"text":""}',
    b'{"do":"answer","step":1,"text":"' + b"x" * 41 + b'"}',
    b'{"do":"answer","step":1,"text":"\\ud800"}',
    b"[" * 1000,
)


def test_invalid_messages_are_refused(table, caplog):
    before = table.shown()
    for body in BAD:
        assert table.send(body)[0] == 400, body
    assert table.shown() == before
    assert caplog.records == []


def test_long_messages_and_other_methods_are_refused(table):
    assert table.send(b" " * 5000)[0] == 413
    assert post(table.server, "{}", path="calibrations", token=token_of(table.server))[0] == 404


def test_a_message_of_an_earlier_step_does_nothing(table, open_page):
    page = open_page(table.server.url)
    expect(page.locator("#board")).to_have_attribute("data-state", "connected", timeout=LONG_MS)
    for message in ({"do": "undo", "step": 10**300}, {"do": "cancel"}):
        assert table.send(message) == (409, "no session runs: start one")
    person = table.person(page)
    person.go_on(lambda seen: seen["starts"])
    person.start("rough")
    person.go_on(at_press(2))
    step, taken = table.shown()["step"], Session(table.path).points
    assert table.send(START) == (409, page_calibration._RUNNING)
    for message in (
        {"do": "undo", "step": step - 1},
        {"do": "undo", "step": -1},
        {"do": "answer", "step": step, "text": "42mm"},
        {"do": "answer", "step": step - 1, "text": "42mm"},
    ):
        status, text = table.send(message)
        assert (status, "earlier step" in text) == (409, True)
    assert Session(table.path).points == taken
    assert table.send({"do": "undo", "step": step})[0] == 204
    assert table.send({"do": "undo", "step": step})[0] == 409  # a double click
    person.go_on(at_press(1))
    assert len(Session(table.path).of("hand")) == 1


@pytest.mark.parametrize(
    ("kind", "kept"), [("rough", "the stored presses are kept"), ("rezero", "nothing was saved")]
)
def test_a_restart_of_the_board_ends_a_session(kind, kept, tmp_path):
    queue = PageCalibration(tmp_path / "a.jsonl", PageState())
    queue._show(kind=kind)
    queue._plan, queue._restarts = (), 0
    queue._board = SimpleNamespace(stats=SimpleNamespace(restarts=1))
    with refusal(StateError) as ended:
        queue.watch(SimpleNamespace(counts=np.zeros(6)), None, 0.0)
    assert str(ended.value).endswith(kept)


def test_a_flood_of_messages_is_bounded(tmp_path):
    queue = PageCalibration(tmp_path / "a.jsonl", PageState())
    queue._attended = True  # a board is connected, but does not process the requests
    waiting = [queue.submit(queue.decode(b'{"do":"cancel"}')) for _ in range(1000)]
    refused = [one for one in waiting if one.done()]
    assert len(refused) > 980
    assert all("busy" in str(one.exception()) for one in refused)


def test_a_page_of_another_site_starts_no_session(table, browser, other_site):
    send_from_other_site(browser, table.server, other_site, "calibration", json.dumps(START))
    assert not table.shown()["running"]
    assert not table.path.exists()


def test_a_server_that_ends_stops_the_session(table, open_page):
    page = open_page(table.server.url)
    person = table.person(page)
    person.go_on(lambda seen: seen["starts"])
    person.start("rough")
    person.go_on(lambda seen: seen["asks"])
    table.bench.close()
    assert not table.bench.reader._thread.is_alive()
    eventually(lambda: not table.shown()["running"])


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--port", "recording:run.spots"], "--session works with one board"),
        (["--record-to", "."], "--record-to and --session exclude each other"),
        ([], "nobody can press a virtual board: use 'spots serve --practice' or"),
    ],
)
def test_a_mistake_is_one_sentence(capsys, tmp_path, options, says):
    arguments = ["serve", "--http-port", "0", "--session", str(tmp_path / "a.jsonl")]
    assert apart(main, [*arguments, "--port", "virtual", *options]) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


MARKS_MM = 8.5, 42.5, 76.5
DRIFT = Change(die_nm=-1.0, phosphor_nm=1.0, dye_percent=-2.0)


@pytest.fixture
def drifted(sensor, calibration, serve, tmp_path):
    """A calibrated board whose strip has drifted, its web server, and the simulated finger."""
    optics, made = Optics(sensor), Calibration(calibration).conditions
    at = [optics.names.index(name) for name in made.plan]
    logs = [tuple(np.log2(optics.press(mm, 4.0)[at]).round(6).tolist()) for mm in MARKS_MM]
    marks = calibration_file.Marks(
        place_um=tuple(1000 * mm for mm in MARKS_MM), force_mN=3000.0, logs=tuple(logs)
    )
    file = calibration_file.CalibrationFile(
        date=calibration_file.now(), **made._asdict(), lines=tuple(calibration), marks=marks
    )

    class Drifted:
        held, out = Held(), tmp_path / "calibration.toml"

    calibration_file.save(file, Drifted.out, None)
    Drifted.held.changed = DRIFT
    Drifted.file = calibration_file.load(Drifted.out)
    session = tmp_path / "calibration.jsonl"
    Drifted.bench = Bench(sensor, calibration, Drifted.held, session=session, speed=SPEED)
    Drifted.server = serve(Drifted.bench.state, queues=Drifted.bench.queues)
    yield Drifted
    Drifted.bench.close()


def test_a_re_zero_corrects_a_drift_or_changes_nothing(drifted, open_page):
    page = open_page(drifted.server.url, **PHONE)
    page.locator("#calibrate").click(timeout=LONG_MS)
    person = Person(page, drifted.held, 85.0)
    person.start("rezero")
    person.go_on(lambda seen: seen["count"] == "1 of 3")
    expect(page.locator("#calibration h2")).to_have_text("Calibration: re-zero")
    expect(page.get_by_role("button", name="Undo the last press")).to_be_hidden()
    message = {"do": "undo", "step": drifted.bench.queues["calibration"]._step}
    token = token_of(drifted.server)
    status, why = post(drifted.server, json.dumps(message), path="calibration", token=token)
    assert (status, "a re-zero" in why or "earlier step" in why) == (409, True)
    page.get_by_role("button", name="Stop", exact=True).click()
    seen = person.wait(lambda seen: seen["starts"])
    assert (seen["todo"], seen["note"]) == (
        "The re-zero is stopped",
        "stopped: nothing was saved",
    )
    assert calibration_file.load(drifted.out) == drifted.file
    drifted.held.press = person._last = None
    person.start("rezero")
    seen = person.go_on()
    assert seen["todo"] == "The board is re-zeroed"
    assert "% paler" in seen["said"] + seen["note"]
    new = calibration_file.load(drifted.out)
    assert new.rezeros[0].place_um == tuple(1000 * mm for mm in MARKS_MM)
    stored = apart(lambda: drifted.bench.board.command("hello")["calibration"])
    assert stored == checksum(new.lines) != checksum(drifted.file.lines)
    press_and_read(page, drifted.held, (20.0, 60.0))


def test_without_a_calibration_there_is_no_re_zero(table, open_page):
    page = open_page(table.server.url)
    expect(page.locator("#calibration .kind[value=rough]")).to_be_visible(timeout=LONG_MS)
    expect(page.locator("#calibration .kind[value=rezero]")).to_be_hidden()
    assert table.send({"do": "start", "kind": "rezero", "length_mm": 85.0})[0] == 204
    note = page.locator("#calibration .note.warn").first
    expect(note).to_contain_text("or make it with 'spots calibrate'", timeout=LONG_MS)


@pytest.mark.parametrize(
    ("command", "buttons"),
    [("spots rezero", ["Re-zero"]), ("spots calibrate", ["Rough", "Fine"])],
)
def test_the_next_step_names_buttons_of_this_window(serve, open_page, tmp_path, command, buttons):
    state = PageState()
    (tmp_path / "mine.toml").touch()
    queues = {"calibration": PageCalibration(tmp_path / "mine.jsonl", state)}
    board = {"state": "connected", "id": "a", "board": "a", "port": "x", "message": "", "next": ""}
    state.put("board", {**board, "calibration": "12345678"})
    server = serve(state, queues=queues)
    watching, acting = open_page(f"http://127.0.0.1:{server.port}/"), open_page(server.url)
    state.put("untrusted", f"a reason; next: {command}")
    expect(watching.locator("#next")).to_have_text(f"a reason; next: {command}")
    for _ in range(2):  # the panel is closed, then open
        expect(acting.locator("#next")).to_have_text(re.compile("next: (press|choose) \u2018"))
        named = re.findall("\u2018(.*?)\u2019", acting.locator("#next").inner_text())
        assert set(buttons) <= set(named)
        for words in named:
            button = acting.get_by_role("button", name=re.compile(f"^{words}"))
            expect(button).to_be_visible(timeout=LONG_MS)
            if words == "calibrate":
                button.click()
                expect(acting.locator("#next")).not_to_contain_text("\u2018calibrate\u2019")
    # A board without a calibration opens the panel.
    state.put("board", {**board, "calibration": None})
    expect(acting.locator("#next")).not_to_contain_text("\u2018calibrate\u2019")


def test_without_a_calibration_file_the_next_step_of_a_drift_is_no_button(
    serve, open_page, tmp_path
):
    state = PageState()
    queues = {"calibration": PageCalibration(tmp_path / "mine.jsonl", state)}
    state.put("untrusted", "a reason; next: spots rezero")
    page = open_page(serve(state, queues=queues).url)
    expect(page.locator("#next")).to_have_text("a reason; next: spots rezero", timeout=LONG_MS)
