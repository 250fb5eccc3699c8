"""A browser with the access token can start and stop a recording, and nothing beyond that."""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import threading
import time
from types import SimpleNamespace

import pytest
from playwright.sync_api import expect
from support.refusals import refusal
from support.serving import apart, eventually, post, token_of, until

from spots.cli import main
from spots.errors import SpotsError, StateError
from spots.link.board import Board
from spots.link.connect import prepare
from spots.link.frames import Touch
from spots.recording.recorder import Recorder
from spots.recording.recording import Recording
from spots_sim.board.lockstep import LockstepLink
from spots_sim.strip.scenario import Held, Press
from spots_web.recordings import Recordings
from spots_web.state import PageState

LONG_MS = 60_000


def ready(one):
    """Wait until the reader of a `Bench` has opened its board."""
    while True:
        with pytest.raises(SpotsError) as refused:
            one.recordings.submit("stop").result(60)
        if "no recording to stop" in str(refused.value):
            return
        time.sleep(0.02)


@pytest.fixture
def recorded(bench, serve, tmp_path):
    """A `Bench` with a finger that touches, and its web server, which allows recordings."""
    held = Held()
    held.press = Press(40.0, 4000, 4.0)
    one = bench(held, record_to=tmp_path)
    ready(one)
    return one, serve(one.state, queues=one.queues)


def test_a_recording_of_the_page_is_one_like_any_other(recorded, open_page, tmp_path):
    one, server = recorded
    page = open_page(server.url)
    button, told = page.locator("#recording"), page.locator("#recorded")
    expect(button).to_have_text("record", timeout=LONG_MS)
    button.click()
    expect(button).to_have_text("stop", timeout=LONG_MS)
    (path,) = tmp_path.iterdir()
    expect(told).to_contain_text(f"records{path.name}", timeout=LONG_MS)
    begun = path.stat().st_size
    eventually(lambda: path.stat().st_size > begun + 2000)
    button.click()
    expect(button).to_have_text("record", timeout=LONG_MS)
    expect(told).to_contain_text("lost0")
    recording = Recording(path)
    touches = [frame for _, frame in recording if isinstance(frame, Touch)]
    assert abs(touches[-1].position_um - 40_000) < 500
    assert recording.complete
    assert recording.stats.lost == recording.stats.bad_crc == 0
    assert recording.header.info["id"] == one.board.info["id"]
    assert recording.header.info["id"] in path.name


def test_who_has_no_token_sees_the_recording_but_no_button(recorded, open_page, tmp_path):
    _, server = recorded
    page = open_page(f"http://127.0.0.1:{server.port}/")
    expect(page.locator(".press.on")).to_have_count(1, timeout=LONG_MS)
    expect(page.locator("#recording")).to_be_hidden()
    assert post(server, "start", token=token_of(server))[0] == 204
    expect(page.locator("#recorded")).to_contain_text("records", timeout=LONG_MS)
    expect(page.locator("#recording")).to_be_hidden()
    assert post(server, "stop", token=token_of(server))[0] == 204


def test_nobody_else_records(recorded, tmp_path, caplog):
    _, server = recorded
    token = token_of(server)
    for other in (None, "wrong", token + "a", ""):
        assert post(server, "start", token=other)[0] == 403
    assert post(server, "start", token=token, Origin="http://evil.example")[0] == 403
    assert post(server, "start", token=token, Origin="null")[0] == 403
    assert post(server, "start", token=token, Host="evil.example")[0] == 403
    assert post(server, "start", path=f"recording?token={token}x")[0] == 403
    for word in ("", "starts", "start\nstop", "../start", b"\xff\xfe", b"start\0"):
        assert post(server, word, token=token)[0] == 400
    for header in (
        {"Content-Type": "text/plain; charset=nonsense"},
        {"Content-Encoding": "deflate"},
        {"Content-Encoding": "gzip"},
    ):
        assert post(server, b"\xff\xfe", token=token, **header)[0] == 400
    assert caplog.records == []
    assert post(server, "s" * 5000, token=token)[0] == 413
    assert post(server, "start", path="live", token=token)[0] == 405
    assert list(tmp_path.iterdir()) == []


def test_without_a_folder_there_is_nothing_to_command(serve):
    server = serve(PageState())
    assert "token" not in server.url
    assert post(server, "start")[0] == 403
    other = serve(PageState(), address="0.0.0.0")
    assert post(other, "start")[0] == 401
    assert post(other, "start", token=token_of(other))[0] == 404


def test_what_cannot_be_is_told(recorded, tmp_path, serve):
    _, server = recorded
    token = token_of(server)
    assert post(server, "stop", token=token) == (
        409,
        "there is no recording to stop: start one first",
    )
    assert post(server, "start", token=token)[0] == 204
    status, text = post(server, "start", token=token)
    assert (status, "recorded already" in text) == (409, True)
    assert post(server, "stop", token=token)[0] == 204
    state = PageState()
    nobody = Recordings(tmp_path, state)
    lonely = serve(state, queues={"recording": nobody})
    assert post(lonely, "start", token=token_of(lonely)) == (
        409,
        "there is no board to record: plug one in",
    )


def test_a_recording_ends_with_its_board(recorded, open_page, tmp_path):
    one, server = recorded
    page = open_page(server.url)
    button, told = page.locator("#recording"), page.locator("#recorded")
    expect(page.locator(".press.on")).to_have_count(1, timeout=LONG_MS)
    button.click()
    expect(button).to_have_text("stop", timeout=LONG_MS)
    one.unplug()
    expect(button).to_have_text("record", timeout=LONG_MS)
    expect(told).to_contain_text("recorded")
    button.click()
    expect(told).to_contain_text("there is no board to record", timeout=LONG_MS)
    (path,) = tmp_path.iterdir()
    assert list(Recording(path))


def test_a_full_disk_ends_the_recording_but_not_the_view(recorded, open_page, tmp_path):
    one, server = recorded
    page = open_page(server.url)
    button, told = page.locator("#recording"), page.locator("#recorded")
    expect(page.locator(".press.on")).to_have_count(1, timeout=LONG_MS)
    page.evaluate(STATES)
    button.click()
    expect(button).to_have_text("stop", timeout=LONG_MS)
    full = SimpleNamespace(write=fault_of(errno.ENOSPC), fileno=lambda: 1, close=lambda: None)
    one.recordings._recorder._disk._file = full
    expect(told).to_contain_text("nothing more can be written (No space left", timeout=LONG_MS)
    expect(told).to_contain_text("the file has everything before: make room and record again")
    expect(button).to_have_text("record")
    until(page, "drawn.length > 5")
    assert page.evaluate("window.states") == []  # the connection was never lost
    (path,) = tmp_path.iterdir()
    assert list(Recording(path))
    path.rename(tmp_path / "full.spots")  # a name has seconds: the next one can be the same
    button.click()  # the next recording works, and the error disappears
    expect(button).to_have_text("stop", timeout=LONG_MS)
    expect(told).not_to_contain_text("nothing more can be written")


def test_an_end_that_cannot_be_written_is_shown_and_the_recording_is_over(recorded):
    one, server = recorded
    token = token_of(server)
    assert post(server, "start", token=token)[0] == 204
    recorder = one.recordings._recorder

    def stop():
        type(recorder).stop(recorder)
        raise SpotsError("the end cannot be written")

    recorder.stop = stop
    assert post(server, "stop", token=token) == (409, "the end cannot be written")
    shown = one.state.since(one.state.begin())[1]["recording"]
    assert (shown["on"], shown["error"]) == (False, "the end cannot be written")


def fault_of(number):
    def write(data):
        raise OSError(number, os.strerror(number))

    return write


def recorded_at(sensor, calibration, path, place_mm, lasting_s):
    """Record a board for `lasting_s` seconds, while a finger presses at `place_mm`."""
    held = Held()
    held.press = Press(place_mm, 4000, 4.0)
    with Board(LockstepLink(sensor, held)) as board:
        prepare(board, calibration)
        board.command("stream touch")
        with Recorder(board, path):
            end_s = board.now_s() + lasting_s
            while board.now_s() < end_s:
                list(board.frames(0.02))


@pytest.fixture(scope="session")
def recordings(sensor, calibration, once):
    """Folder of recordings `a`, `b` and `outside`, long enough to be seen on a slow machine."""

    def make(root):
        root.mkdir()
        for name, place_mm, lasting_s in (("a", 20.0, 4.0), ("b", 60.0, 30.0), ("outside", 30, 1)):
            recorded_at(sensor, calibration, root / f"{name}.spots", place_mm, lasting_s)

    return once("recordings", make)


@pytest.fixture
def folder(recordings, bench, serve, tmp_path):
    """A `Bench`, its web server, and a folder with two recordings and with other files."""
    inside = tmp_path / "inside"
    inside.mkdir()
    for name, path in (("a", inside), ("b", inside), ("outside", tmp_path)):
        shutil.copy(recordings / f"{name}.spots", path)
    (inside / "link.spots").symlink_to(tmp_path / "outside.spots")
    (inside / "damaged.spots").write_bytes(b"no recording")
    held = Held()
    held.press = Press(40.0, 4000, 4.0)
    one = bench(held, record_to=inside)
    ready(one)
    return one, serve(one.state, queues=one.queues), inside


PLACE = "Number(document.querySelector('.figure b').firstChild.data)"


STATES = """window.states = [];
new MutationObserver(() => {
  const { state } = document.querySelector("#board").dataset;
  if (state !== "connected") window.states.push(state);
}).observe(document.querySelector("#board"), { attributes: true });"""


def test_recordings_are_listed_played_and_compared(folder, open_page):
    _, server, _ = folder
    page = open_page(server.url)
    until(page, f"Math.abs({PLACE} - 40) < 1")
    page.locator("#open-recordings").click(timeout=LONG_MS)
    names = page.locator("#recordings li b")
    expect(names).to_have_count(3, timeout=LONG_MS)
    assert set(names.all_inner_texts()) == {"a.spots", "b.spots", "damaged.spots"}
    page.get_by_label("Compare a.spots").check()
    page.get_by_label("Compare b.spots").check()
    page.get_by_role("button", name="Compare", exact=True).click()
    name = re.compile(r"^Position, mm of a.spots and b.spots over time$")
    expect(page.get_by_role("img", name=name)).to_be_visible(timeout=LONG_MS)
    # The page shows the played recording in place of the board, and then the board again.
    page.get_by_role("button", name="Play b.spots").click()
    until(page, f"Math.abs({PLACE} - 60) < 1")
    expect(page.locator("#next")).to_contain_text("the recording b.spots is played; next: ")
    expect(page.locator("#board")).to_contain_text("on b.spots")
    page.get_by_role("button", name="record", exact=True).click()
    expect(page.locator("#recorded")).to_contain_text("is already a recording", timeout=LONG_MS)
    page.get_by_role("button", name="Show the board").click()
    until(page, f"Math.abs({PLACE} - 40) < 1")
    expect(page.locator("#next")).to_be_hidden()
    # The page also shows the board after the end of a recording; the connection was never lost.
    page.evaluate(STATES)
    page.get_by_role("button", name="Play a.spots").click()
    until(page, f"Math.abs({PLACE} - 20) < 1")
    until(page, f"Math.abs({PLACE} - 40) < 1")
    assert page.evaluate("window.states") == []
    # For a damaged recording the page shows an error sentence, and still the board.
    page.get_by_role("button", name="Play damaged.spots").click()
    expect(page.locator("#recordings .state")).to_contain_text("damaged.spots", timeout=LONG_MS)
    expect(page.locator("#next")).to_be_hidden()


def test_a_name_that_is_not_utf_8_closes_no_browser(folder, open_page):
    _, server, inside = folder
    (inside / "a.spots").rename(inside / os.fsdecode(b"\xff\n.spots"))
    page = open_page(server.url)
    page.locator("#open-recordings").click(timeout=LONG_MS)
    names = page.locator("#recordings li b")
    expect(names.filter(has_text=r"\udcff\n.spots")).to_have_count(1, timeout=LONG_MS)
    page.evaluate("window.messages = drawn.length")
    page.get_by_role("button", name=r"Play \udcff\n.spots").click()
    until(page, f"Math.abs({PLACE} - 20) < 1")
    expect(page.locator("#next")).to_contain_text(r"the recording \udcff\n.spots is played")
    expect(page.locator("body")).to_have_attribute("data-link", "live")


def test_the_next_step_names_only_buttons_with_these_words(folder, open_page):
    _, server, _ = folder
    page = open_page(server.url)
    page.locator("#open-recordings").click(timeout=LONG_MS)
    page.get_by_role("button", name="Play b.spots").click(timeout=LONG_MS)
    step = page.locator("#next")
    expect(step).to_have_text(
        re.compile("again, press \u2018Show the board\u2019$"), timeout=LONG_MS
    )
    page.get_by_role("button", name="close").click()
    words = "press \u2018recordings\u2019, then press \u2018Show the board\u2019"
    expect(step).to_have_text(re.compile(words))
    expect(page.get_by_role("button", name="recordings", exact=True)).to_be_visible()


@pytest.mark.board
def test_curves_of_recordings_are_those_of_the_finger(folder):
    _, server, _ = folder
    status, text = post(server, "compare\na.spots\nb.spots", token=token_of(server))
    assert status == 200
    for curve, place_mm in zip(json.loads(text)["curves"], (20, 60)):
        places_um = [place for _, place, _ in curve["points"] if place is not None]
        assert 50 < len(places_um) <= len(curve["points"]) <= 1500
        assert max(abs(one - 1000 * place_mm) for one in places_um) < 500
        assert not curve["cut"]
    status, text = post(server, "compare\na.spots\ndamaged.spots", token=token_of(server))
    assert (status, "damaged.spots" in text) == (409, True)


@pytest.mark.board
def test_only_recordings_of_the_folder_are_read(folder, tmp_path):
    one, server, inside = folder
    token = token_of(server)
    for name in ("../outside.spots", str(tmp_path / "outside.spots"), "link.spots", "", "a"):
        for words in ("play", "compare\na.spots"):
            status, text = post(server, f"{words}\n{name}", token=token)
            assert (status, "no such recording" in text) == (409, True)
    for body in ("play", "play\na.spots\nb.spots", "compare\na.spots", "list\n", "live\nx"):
        assert post(server, body, token=token)[0] == 400
    for body in ("list", "live", "play\na.spots", "compare\na.spots\nb.spots"):
        assert post(server, body)[0] == 403
        assert post(server, body, token=token, Origin="http://evil.example")[0] == 403
    shown = one.state.since(one.state.begin())[1]["recording"]
    assert shown["playing"] is None
    before = {path.name: path.lstat().st_size for path in inside.iterdir()}
    assert set(before) == {"a.spots", "b.spots", "damaged.spots", "link.spots"}


@pytest.mark.parametrize(
    ("port", "folder", "says"),
    [
        ("virtual", "nowhere", "there is no folder"),
        ("recording:run.spots", ".", "works with one board"),
    ],
)
def test_a_mistake_is_one_sentence(capsys, tmp_path, port, folder, says):
    arguments = ["serve", "--http-port", "0", "--port", port, "--record-to", str(tmp_path / folder)]
    assert apart(main, arguments) == 2
    error = capsys.readouterr().err
    assert says in error
    assert error.count("\n") == 1


def test_the_name_of_a_file_stays_in_its_folder(recorded, tmp_path):
    one, _ = recorded
    one.board.info["id"] = "../../e/v\\il\0"
    one.recordings.submit("start").result(60)
    one.recordings.submit("stop").result(60)
    (path,) = tmp_path.iterdir()
    assert path.name.endswith("-evil.spots")


def test_many_recordings_leave_nothing_in_the_way(sensor, tmp_path):
    with Board(LockstepLink(sensor, Held())) as board:
        for i in range(3):
            with Recorder(board, tmp_path / f"{i}.spots"):
                assert len(board.channel.taps) == len(board._on_close) == 1


def test_a_request_may_follow_an_answer_at_once(tmp_path, monkeypatch):
    recordings, attached, second = Recordings(tmp_path, PageState()), threading.Event(), []
    read = recordings._list

    def listed():
        assert attached.wait(60)
        return read()

    monkeypatch.setattr(recordings, "_list", listed)
    first = recordings.submit("list")
    with refusal(StateError):
        recordings.submit("list").result(60)
    first.add_done_callback(lambda _: second.append(recordings.submit("list")))
    attached.set()
    assert first.result(60) == {"files": []}
    while not second:
        time.sleep(0.01)
    assert second[0].result(60) == {"files": []}


def test_the_key_m_marks_the_recording(recorded, open_page, tmp_path):
    _, server = recorded
    page = open_page(server.url)
    button, told = page.locator("#recording"), page.locator("#recorded")
    expect(button).to_have_text("record", timeout=LONG_MS)
    page.keyboard.press("m")  # nothing is recorded yet
    button.click()
    expect(button).to_have_text("stop", timeout=LONG_MS)
    for number in (1, 2):
        page.keyboard.press("m")
        expect(told).to_contain_text(f"marks (key m){number}", timeout=LONG_MS)
    page.keyboard.press("Control+m")
    button.click()
    expect(button).to_have_text("record", timeout=LONG_MS)
    (path,) = tmp_path.iterdir()
    recording = Recording(path)
    assert len(list(recording)) > 0
    assert [one.text for one in recording.marks] == ["mark 1", "mark 2"]
