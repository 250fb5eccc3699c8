"""Outlets for other programs, read by clients that are not ours."""

import asyncio
import json
import math
import socket
import struct
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import aiohttp
import pytest
from pythonosc.dispatcher import Dispatcher
from pythonosc.osc_server import BlockingOSCUDPServer
from support.net import stand_in, wait_until
from support.refusals import refusal

import spots
from spots import Board
from spots.errors import RequirementError
from spots.link.frames import Contact, Key, Spectrum, Touch
from spots.recording.foxglove import schema
from spots.recording.table import tables
from spots_net import outlet, sending
from spots_net.publishing import publish, stream

TOUCH = Touch(0, 7, 5000, 9, 1 << 20, 3 << 20, 42_000, 1500, 1.25)
UNTOUCHED = Touch(0, 8, 15_000, 0, 0, 0, math.nan, math.nan, 1.26)


@pytest.fixture
def board():
    with Board(stand_in()) as made:
        stream(made)
        yield made


def _heard(board, made, seconds, until=lambda: True):
    """Publish until `until` returns True, and return the touches that were published."""
    seen = []
    tap = SimpleNamespace(
        put=lambda frame, utc_s: seen.append((frame, utc_s)), turn=lambda: None, close=lambda: None
    )
    while not seen or not until():
        publish(board, [made, tap], seconds)
    return [(frame, utc_s) for frame, utc_s in seen if isinstance(frame, Touch)]


def test_osc_arrives_as_it_was_sent():
    got = []
    hears = Dispatcher()
    hears.set_default_handler(lambda name, *values: got.append((name, *values)))
    server = BlockingOSCUDPServer(("127.0.0.1", 0), hears)
    port = server.server_address[1]
    opens = outlet.maker(f"osc=127.0.0.1:{port}")
    made = opens(Board(stand_in()))
    for frame in (TOUCH, UNTOUCHED, Key(0, 1, 2, 7, 4, 2, True), Spectrum(0, 1, 2, 0, 9, (1,) * 6)):
        made.put(frame, 1e9)
        if not isinstance(frame, Spectrum):
            server.handle_request()
    made.put(Contact(0, 9, 5, 3, 2, 41_000, 30, math.nan), 1e9)
    server.handle_request()
    made.close()
    server.server_close()
    assert got == [
        ("/spots/0/touching", 1),
        ("/spots/0/position_um", 42_000.0),
        ("/spots/0/force_mN", 1500.0),
        ("/spots/0/touching", 0),
        ("/spots/0/key", 7, 4, 2, 1),
        ("/spots/0/contact", 3, 2, 41_000.0, 0.0),
    ]


def test_lsl_has_every_sample_with_its_time(board, tmp_path, monkeypatch):
    settings = tmp_path / "lsl.cfg"
    settings.write_text("[multicast]\nResolveScope = machine\n[log]\nlevel = -2\n")
    monkeypatch.setenv("LSLAPICFG", str(settings))
    import pylsl

    made = outlet.maker("lsl")(board)
    (info,) = pylsl.resolve_byprop("source_id", "a1/0/touch", timeout=30.0)
    inlet = pylsl.StreamInlet(info)
    inlet.open_stream(timeout=30.0)
    offset_s = pylsl.local_clock() - board.now_s()
    sent = _heard(board, made, 0.5)
    samples, stamps = inlet.pull_chunk(timeout=5.0, max_samples=len(sent))
    made.close()
    channels = inlet.info(timeout=30.0).desc().child("channels")
    labels, channel = [], channels.child("channel")
    while not channel.empty():
        labels.append((channel.child_value("label"), channel.child_value("unit")))
        channel = channel.next_sibling("channel")
    assert labels[2:4] == [("position_um", "um"), ("force_mN", "mN")]
    assert len(samples) == len(sent) > 20
    for (touch, _), sample, stamp in zip(sent, samples, stamps):
        assert sample[0] == touch.touching
        assert sample[2] == touch.position_um or math.isnan(touch.position_um)
        if touch.time_s is not None:
            assert abs(stamp - offset_s - touch.time_s) < 1e-3


class Viewer(threading.Thread):
    """A client of Foxglove's WebSocket: subscribes to all channels, and keeps the messages."""

    def __init__(self, port):
        super().__init__(daemon=True)
        self._url = f"ws://127.0.0.1:{port}"
        self.channels, self.messages = {}, []
        self.start()

    def run(self):
        asyncio.run(self._read())

    async def _read(self):
        async with (
            aiohttp.ClientSession() as client,
            client.ws_connect(self._url, protocols=["foxglove.sdk.v1"]) as connection,
        ):
            async for message in connection:
                if message.type is aiohttp.WSMsgType.TEXT:
                    await self._take(json.loads(message.data), connection)
                else:
                    code, number, time_ns = struct.unpack_from("<BIQ", message.data)
                    assert code == 1
                    content = json.loads(message.data[13:])
                    self.messages.append((self.channels[number]["topic"], time_ns, content))

    async def _take(self, content, connection):
        if content["op"] == "advertise":
            self.channels |= {one["id"]: one for one in content["channels"]}
            wanted = [{"id": one["id"], "channelId": one["id"]} for one in content["channels"]]
            await connection.send_json({"op": "subscribe", "subscriptions": wanted})


def test_foxglove_lists_topics_and_receives_everything_in_order(board):
    made = outlet.maker("foxglove=127.0.0.1:0")(board)
    viewer = Viewer(made.place.rpartition(":")[2])
    wait_until(lambda: viewer.channels)
    time.sleep(0.2)  # the subscription has no answer
    sent = _heard(board, made, 0.5)
    want = [frame.sequence for frame, _ in sent]
    wait_until(lambda: sum(one[0] == "/spots/0/touch" for one in viewer.messages) >= len(want))
    made.close()
    topics = {one["topic"] for one in viewer.channels.values()}
    assert topics == {f"/spots/0/{kind}" for kind in ("touch", "spectrum", "contact", "key")}
    for channel in viewer.channels.values():
        names = set(json.loads(channel["schema"])["properties"])
        for topic, _, content in viewer.messages:
            assert topic != channel["topic"] or set(content) <= names
    touches = [one for one in viewer.messages if one[0] == "/spots/0/touch"]
    assert [content["sequence"] for *_, content in touches] == want
    assert [time_ns for _, time_ns, _ in touches] == [round(1e9 * utc_s) for _, utc_s in sent]


def test_an_unknown_value_is_left_out():
    row = sending.row(UNTOUCHED, 0.0, 0.0, [])
    assert "position_um" not in row
    assert row["known"] is False
    assert sending.row(TOUCH, 0.0, 0.0, [])["position_um"] == 42_000


@pytest.mark.parametrize(
    ("name", "why"),
    [
        ("osc=host:x", "'host:x' is not an address for OSC"),
        ("osc=127.0.0.1:70000", "is not an address for OSC"),
        ("osc=no.such.host.invalid:9000", "cannot send OSC to no.such.host.invalid"),
    ],
)
def test_a_wrong_address_is_refused(name, why):
    with pytest.raises(spots.SpotsError, match=why):
        outlet.maker(name)(Board(stand_in()))


def test_a_port_in_use_is_refused():
    with socket.create_server(("127.0.0.1", 0)) as taken:
        name = f"foxglove=127.0.0.1:{taken.getsockname()[1]}"
        with refusal(RequirementError):
            outlet.maker(name)(Board(stand_in()))


@pytest.mark.parametrize("package", ["pythonosc", "pylsl", "aiohttp", "rerun"])
def test_a_missing_package_is_named_with_its_extra(package, monkeypatch):
    name = {"pythonosc": "osc", "pylsl": "lsl", "aiohttp": "foxglove"}.get(package, package)
    for one in [one for one in sys.modules if one.partition(".")[0] == package]:
        monkeypatch.delitem(sys.modules, one)
    monkeypatch.setitem(sys.modules, package, None)
    monkeypatch.delitem(sys.modules, f"spots_net.to_{name}", raising=False)
    with refusal(RequirementError):
        outlet.maker(name)


def test_the_layout_for_foxglove_shows_what_is_served():
    path = Path(__file__).parents[2] / "examples" / "foxglove" / "spots.json"
    layout = json.loads(path.read_text())
    plan = ["F3", "F4", "F5", "F6", "F7", "F8"]
    columns = {one.name: set(schema(one)["properties"]) for one in tables(plan)}
    shown = [line["value"] for panel in layout["configById"].values() for line in panel["paths"]]
    for one in shown:
        topic, _, column = one.partition(".")
        assert column in columns[topic.removeprefix("/spots/0/")]
    assert {one.partition(".")[2] for one in shown} >= {"position_um", "force_mN", "counts_F3"}
    assert {*layout["configById"]} == {*_panels(layout["layout"])}


def _panels(split):
    if isinstance(split, str):
        yield split
    else:
        for side in ("first", "second"):
            yield from _panels(split[side])
