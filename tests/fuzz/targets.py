"""The fuzz targets: functions that take arbitrary bytes, and raise an error only for a defect.

Each target uses the bytes as a file, a message or a command line. It accepts the documented error
for invalid bytes, and checks the result for valid bytes.
"""

from __future__ import annotations

import asyncio
import contextlib
import io
import math
import tempfile
import zlib
from pathlib import Path
from types import SimpleNamespace

from aiohttp import web
from aiohttp.test_utils import make_mocked_request
from rich.console import Console
from support.frames import encoded
from support.same_arrays import check, recording_of
from support.smallint import small

import desk
import spots
from spots.calibrate import calibration_file
from spots.calibrate.fit.decoded import Decoded
from spots.controller import controller_settings
from spots.controller.gamepad_engine import Controller
from spots.errors import SpotsError
from spots.keyboard import keys, layout
from spots.link.decoder import ENCODED_MAX, Decoder
from spots.link.frames import Touch
from spots.recording.export import EXPORTS, export
from spots.recording.info import report, summary
from spots.terminal.view import StripView, plain
from spots.wearable import wearable
from spots_device import PROTOCOL
from spots_device.board import settings
from spots_device.keys.keypad import Keypad
from spots_device.keys.layout import LayoutError, parse
from spots_device.keys.merge import Merger
from spots_device.reading.calibration import Calibration
from spots_device.reading.calibration_lines import CalibrationError
from spots_device.reading.decode import AVERAGE_MAX
from spots_linkage import mounted, twin_points
from spots_net import subscribe
from spots_sim.board.cpython_board import use_folder
from spots_sim.board.faults import BoardFaults, of_scenario
from spots_sim.person import mechanism as linkage
from spots_sim.strip import files
from spots_sim.strip.optics import Optics
from spots_sim.strip.scenario import Scenario
from spots_web.app import _ACK_MAX, _NUMBER, _add_headers
from spots_web.guard import Guard
from spots_web.pace import PagePace
from spots_web.strip_feed import layout_shown

_TEMPORARY = tempfile.TemporaryDirectory(prefix="spots-fuzz-")
FOLDER = Path(_TEMPORARY.name)
_SEALED = b"="
_store = desk.own("board.store")
use_folder(_store, FOLDER)
_SOME_TIMES_S = (0.0, 0.3, 12.5, 1e6)


@contextlib.contextmanager
def _refusing():
    """Ignore a SpotsError in a `with` block if its text is one printable line."""
    try:
        yield
    except SpotsError as error:
        _check_line(str(error))


def _check_line(text: str) -> None:
    assert text, "an error has no text"
    assert text.isprintable(), f"an error is not one printable line: {text!r}"


def _stream(data: bytes) -> bytes:
    """Return a stream of bytes: `data`, or frames if `data` starts with ``=``.

    In the second case each following line, ended by CR LF, is the payload of a frame.
    """
    if not data.startswith(_SEALED):
        return data
    told = data[1:].replace(b"PROTOCOL", b"%d" % PROTOCOL)
    return b"".join(encoded(payload) for payload in told.split(b"\r\n"))


def _text(data: bytes) -> str:
    return data.decode("utf-8", "replace")


def _file(name: str, content: bytes) -> Path:
    path = FOLDER / name
    path.write_bytes(content)
    return path


def decoder(data: bytes) -> None:
    """Decoder: frames do not depend on how a stream is divided; memory is limited."""
    stream = _stream(data)
    at_once, pieces = Decoder(), Decoder()
    frames, size = [], 1 + len(stream) % 7
    for i in range(0, len(stream), size):
        frames += pieces.feed(stream[i : i + size])
        assert len(pieces.pending) <= ENCODED_MAX
    assert repr(frames) == repr(at_once.feed(stream))  # by text, because NaN is not equal to itself
    assert at_once.stats == pieces.stats
    check(recording_of(FOLDER / "stream.spots", stream))


def commands(data: bytes) -> None:
    """Commands of a board: each line gets one reply; a refused command changes nothing."""
    board = desk.Board()
    for line in data.split(b"\n")[: desk.LINES_MAX]:
        before = board.state()
        line = board.summed(line)
        board.hear(line + b"\n")
        texts = [frame.content for frame in board.said() if "re" in getattr(frame, "content", ())]
        refused = texts and "error" in texts[0]
        if refused and "ended" not in texts[0]["error"]:
            assert board.state() == before, (line, texts)
        wanted = sum(1 for part in line.split(b"\r") if part)
        board.settle()
        texts += [frame.content for frame in board.said() if "re" in getattr(frame, "content", ())]
        assert len(texts) == wanted, (line, texts)


def calibration(data: bytes) -> None:
    """Calibration on a board: with a valid one, no computed number exceeds 31 bits."""
    lines = _text(data).split("\n")
    for strain_ppm in (0, 50_000):
        try:
            made = Calibration(lines, strain_ppm)
        except CalibrationError:
            continue
        desk.shrink(made)
        decode = Decoded()
        decode.calibration = made
        for samples in (1, AVERAGE_MAX):
            full = samples * 65_535
            for sums in ([1] * 6, [full] * 6, [1, full] * 3, [full, 1] * 3):
                decode.update(small(sums), samples, small([0] * 6), 0)
                assert 0 <= decode.force_mN <= 65_535
            decode.update(small([full] * 6), samples, small([4 * 9] * 6), 0)


def layout_lines(data: bytes) -> None:
    """Layout on a board: with a valid one, each pressed key is released."""
    try:
        made = parse(_text(data).split("\n"))
    except LayoutError:
        return
    fingers = desk.Fingers()
    pad = Keypad(fingers, Merger())
    pad.set_layout(made, 85_000, 289)
    fingers.play(pad, zlib.crc32(data))
    assert not fingers.down


def settings_file(data: bytes) -> None:
    """Files of a save on a board: read completely, or refused with an error."""
    lines = data.split(b"\n")
    if data.startswith(_SEALED):
        lines[0] = lines[0][1:]
        with contextlib.suppress(UnicodeDecodeError):
            texts = [line for line in data[1:].decode().split("\n") if line]
            lines = [*data[1:].split(b"\n"), b"crc " + settings.checksum(texts).encode(), b""]
    index = _file("saved-a.txt", b"\n".join(lines))
    _load_settings()
    part = _file("settings-a.txt", data)
    texts = ["generation 1", "settings a %08x" % zlib.crc32(data)]
    index.write_text("\n".join([*texts, "crc " + settings.checksum(texts), ""]))
    _load_settings()
    index.unlink()
    part.unlink()


def _load_settings() -> None:
    fresh = settings.BoardSettings(SimpleNamespace(LED_MAX_MA=100))
    before = dict(fresh.values)
    try:
        fresh.change(_store.Store().load("settings"))
    except ValueError:
        assert fresh.values == before
        return
    after = dict(fresh.values)
    fresh.change(fresh.lines())
    assert fresh.values == after


def calibration_toml(data: bytes) -> None:
    """Calibration file: a valid one can be saved and read again; ``=`` at its start adds a CRC."""
    if data.startswith(_SEALED):
        body = data[1:].replace(b"\r", b"")
        data = body + b'[end]\ncrc32 = "%08x"\n' % zlib.crc32(body)
    with _refusing():
        found = calibration_file.load(_file("calibration.toml", data))
        path = FOLDER / "again.toml"
        path.unlink(missing_ok=True)
        calibration_file.save(found, path, None)
        assert calibration_file.load(path).lines == found.lines


def layout_toml(data: bytes) -> None:
    """Layout file: board, terminal and web UI accept a valid one."""
    with _refusing():
        found = layout.load(_file("layout.toml", data))
        parse(found.lines)
        _draw(keys.picture(found))
        assert layout_shown(found)["layers"]
        for placed in found.layers.values():
            for key in placed:
                assert 0 <= key.low < key.high <= 1.000001


def sensor_toml(data: bytes) -> None:
    """Sensor file: a valid one gives finite count rates."""
    with _refusing():
        file = files.load(files.SensorFile, _file("sensor.toml", data))
        with _quiet():
            rates = Optics(file).press(10.0, 4.0, 0.1, 90.0)
        assert all(map(math.isfinite, rates)), rates


def scenario_toml(data: bytes) -> None:
    """Scenario file: a valid one can be played at any time."""
    with _refusing():
        file = files.load(files.ScenarioFile, _file("scenario.toml", data))
        scenario = Scenario(file)
        faults = of_scenario(file, 1)
        for time_s in _SOME_TIMES_S:
            pose = scenario.pose(time_s)
            assert 0 <= pose.strain <= 0.5
            for press in scenario.presses(time_s):
                assert press.force_mN > 0
            assert math.isfinite(scenario.ambient_uW_cm2(time_s, time_s + 0.01))
        if faults is not None:
            BoardFaults(faults)
            for kind in file.faults.moments():
                spells = faults.spells(kind)
                for _ in range(9):
                    spells.begun(math.inf)


def linkage_toml(data: bytes) -> None:
    """File of a simulated linkage: a valid one gives joint angles."""
    sensor = files.load(files.SensorFile, "default")
    with _refusing():
        made = linkage.Mechanism(files.load(files.LinkageFile, _file("l.toml", data)), sensor)
        made.angles_deg(10.0, 100.0)


def mounted_toml(data: bytes) -> None:
    """File of a real linkage: a valid one can be saved and read again."""
    path = _file("mounted.toml", data)
    mounted.is_mounted(str(path))
    with _refusing():
        found = mounted.load(path)
        again = FOLDER / "again.toml"
        again.unlink(missing_ok=True)
        mounted.save(found, again, None)
        assert mounted.load(again) == found
        assert found.offset_rad[0] == math.radians(found.joint[0].offset_deg)
        found.strips(path)


def points_csv(data: bytes) -> None:
    """Table of the positions at which a linkage was measured: a valid one has finite numbers."""
    with _refusing():
        rows, _ = twin_points._read(_file("points.csv", data))
        assert all(map(math.isfinite, rows.ravel()))


def path_toml(data: bytes) -> None:
    """Path file of a linkage; the duration of its motion is not tested."""
    with _refusing():
        files.load(files.PathFile, _file("path.toml", data))


def controller_toml(data: bytes) -> None:
    """Settings file of the controller: a valid one can be saved, read again and used."""
    with _refusing():
        found = controller_settings.load(_file("controller.toml", data))
        path = FOLDER / "again.toml"
        path.unlink(missing_ok=True)
        controller_settings.save(found, path, None)
        assert controller_settings.load(path) == found
        desk.play_controller(Controller, found)


def wearable_toml(data: bytes) -> None:
    """File that assigns keys to gestures: a valid one is read."""
    with _refusing():
        wearable.Mapping(_file("wearable.toml", data))


def recording(data: bytes) -> None:
    """Recording: it is read, summarised, played and exported."""
    path = _file("a.spots", _stream(data))
    with _refusing():
        assert report(summary(path)).replace("\n", "").isprintable()
        check(path)
        _use(path)


def _use(path: Path) -> None:
    with _refusing(), spots.open_recording(path, math.inf) as board:
        view = StripView(board.info, board.port)
        for frame in board.frames():
            view.take(frame)
            if isinstance(frame, Touch):
                assert plain(frame, board.now_s())
        _draw(view.picture(board.stats))
    for kind in EXPORTS:
        with _refusing():
            for out in export(path, kind, FOLDER / f"out.{kind}"):
                out.unlink()


def _draw(picture) -> None:
    Console(file=io.StringIO(), force_terminal=True).print(picture)


def published(data: bytes) -> None:
    """Message on Zenoh, with its topic in the first line: printed as one line, or ignored."""
    name, _, content = data.partition(b"\n")
    for written in (subscribe._Lines().written, subscribe._as_json):
        for ending in subscribe._kinds():
            text = subscribe._text(written, f"0/{_text(name)}/{ending}", content)
            assert text is None or text.isprintable()


def page_message(data: bytes) -> None:
    """Message of the web UI: the number of the last picture that the browser has drawn."""
    if number := _NUMBER.fullmatch(_text(data[:_ACK_MAX])):
        PagePace(lambda: 0.0).acknowledge(int(number[0]))


_TOKEN = "kRx9-_token"
_GUARDS = {
    b"l": Guard("127.0.0.1", None),
    b"6": Guard("::1", None),
    b"t": Guard("0.0.0.0", _TOKEN),
}


def guard(data: bytes) -> None:
    """HTTP request (lines: guard, Host, Origin, Cookie, query): only allowed ones are accepted."""
    lines = [line.replace(b"\r", b"").replace(b"\0", b"") for line in data.split(b"\n")]
    kind, host, origin, cookie, query = (lines + [b""] * 5)[:5]
    named = {b"Host": host, b"Origin": origin, b"Cookie": cookie}
    # Decoded as in aiohttp.
    headers = [
        (name.decode(), value.decode("utf-8", "surrogateescape"))
        for name, value in named.items()
        if value
    ]
    path = "/?" + query.decode("latin-1")
    try:
        request = make_mocked_request("GET", path, headers=headers)
    except ValueError:
        return  # path and query are not a valid address
    chosen = _GUARDS.get(kind, _GUARDS[b"t"])

    async def handler(request):
        return web.Response(text="in")

    async def ask():
        response = await chosen.check(request, handler)
        await _add_headers(request, response)
        return response

    try:
        response = asyncio.run(ask())
    except web.HTTPException as error:
        response = error
    for value in response.headers.values():
        assert not {"\r", "\n"} & set(value)
    if response.status != 200:
        return
    text = host.decode("utf-8", "surrogateescape")
    assert not origin or origin.decode("utf-8", "surrogateescape") == f"http://{text}"
    if chosen is _GUARDS[b"t"]:
        assert _TOKEN.encode() in cookie
    else:
        assert "localhost" in text.lower() or "127." in text or ":" in text


@contextlib.contextmanager
def _quiet():
    import numpy as np

    with np.errstate(all="ignore"):
        yield


TARGETS = {
    function.__name__: function
    for function in (
        decoder,
        commands,
        calibration,
        layout_lines,
        settings_file,
        calibration_toml,
        layout_toml,
        sensor_toml,
        scenario_toml,
        linkage_toml,
        mounted_toml,
        points_csv,
        path_toml,
        controller_toml,
        wearable_toml,
        recording,
        published,
        page_message,
        guard,
    )
}


def run(name: str, data: bytes) -> None:
    """Run the target `name` with bytes, and discard its output."""
    with contextlib.redirect_stdout(io.StringIO()):
        TARGETS[name](data)
