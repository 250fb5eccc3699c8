"""Messages for ROS 2, read by software that is not ours: rosbags, mcap-ros2 and zenoh-ros2-sdk."""

import json
import math
import random
import re
import struct
import time
from collections import defaultdict
from contextlib import ExitStack
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
import zenoh
from mcap.reader import make_reader
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_typestore
from support.net import DEADLINE_S, publishing, session, stand_in, topic_key, wait_until
from support.refusals import refusal
from zenoh_ros2_sdk.attachment import Attachment
from zenoh_ros2_sdk.discovery import (
    get_service_names_and_types,
    get_topic_info,
    get_topic_names_and_types,
)
from zenoh_ros2_sdk.qos import QosProfile, QosReliability
from zenoh_ros2_sdk.service_client import ROS2ServiceClient
from zenoh_ros2_sdk.subscriber import ROS2Subscriber
from zenoh_ros2_sdk.utils import compute_service_type_hash, compute_type_hash_from_msg

import spots
import spots_sim
from spots import Board
from spots.errors import PortError, SettingError
from spots.recording.export import export
from spots.recording.recorder import Recorder
from spots_linkage.digital_twin import Terminal
from spots_linkage.limits import Limit
from spots_linkage.twin import _publisher
from spots_net import publish as publish_module
from spots_net import zenoh_session as session_module
from spots_net.publish import Publisher
from spots_net.ros2 import naming
from spots_net.ros2.messages import DIAGNOSTICS, types
from spots_net.ros2.types import FRAME, OWN, own, packed, service, store


def test_standard_types_have_the_hashes_of_a_distribution():
    jazzy = get_typestore(Stores.ROS2_JAZZY)
    # As `ros2 topic info --verbose` of Jazzy prints it.
    hashed = "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77"
    assert store().hash_rihs01("geometry_msgs/msg/WrenchStamped") == hashed
    assert jazzy.hash_rihs01("geometry_msgs/msg/WrenchStamped") == hashed


def _text(kind):
    return store().generate_msgdef(kind, ros_version=2)[0].split("=" * 80)[0]


def _parts(kind):
    """Return the definitions of the types in a type, by their names."""
    _, *others = store().generate_msgdef(kind, ros_version=2)[0].split("=" * 80 + "\nMSG: ")
    pairs = (one.split("\n", 1) for one in others)
    return {name.replace("/", "/msg/"): text for name, text in pairs}


@pytest.mark.parametrize("name", OWN)
def test_own_types_have_the_hashes_that_another_implementation_computes(name):
    parts = _parts(own(name))
    other = compute_type_hash_from_msg(own(name), _text(own(name)), parts)
    assert other == store().hash_rihs01(own(name))


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("ros2") / "run.spots"
    with spots_sim.open(seed=71) as board, Recorder(board, path):
        board.stream("touch", "spectrum", "contact")
        for _, _ in zip(range(250), board.touches()):
            pass
    return path


@pytest.mark.board
def test_a_recording_becomes_a_bag_that_others_read(recording, tmp_path):
    (bag,) = export(recording, "ros2", tmp_path / "run.mcap")
    with bag.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        assert reader.get_header().profile == "ros2"
        schemas = {one.name: one.encoding for one in reader.get_summary().schemas.values()}
        found = defaultdict(list)
        for _, channel, _, message in reader.iter_decoded_messages():
            found[channel.topic.rpartition("/")[2]].append(message)
    assert set(schemas.values()) == {"ros2msg"}
    touches = [one for _, one in spots.Recording(recording) if isinstance(one, spots.Touch)]
    readings = found["reading"]
    assert [one.sequence for one in readings] == [one.sequence for one in touches]
    for reading, touch in zip(readings, touches):
        assert reading.trusted == touch.trusted
        assert _same(reading.position_m, touch.position_um / 1e6)
        assert _same(reading.force_n, touch.force_mN / 1e3)
        assert _same(reading.contrast_log2, touch.contrast)
    pressed = [one for one in touches if one.trusted]
    assert [one.point.x for one in found["point"]] == [one.position_um / 1e6 for one in pressed]
    assert sum(one.wrench.force.z < 0 for one in found["wrench"]) == len(pressed) > 20
    spectrum = found["spectrum"][0]
    assert list(spectrum.channels) == ["F3", "F4", "F5", "F6", "F7", "F8"]
    assert spectrum.exposure_us == 10_000
    assert found["contact"]


def _same(one, other):
    return one == other or (math.isnan(one) and math.isnan(other))


@pytest.mark.board
@pytest.mark.parametrize("kind", [*types().values(), FRAME, "sensor_msgs/msg/JointState"])
def test_a_thousand_messages_of_each_type_are_decoded_identically(kind):
    decode_all(kind, 1000)


def decode_all(kind, count):
    rng, made = random.Random(8_130), store().types
    text, _ = store().generate_msgdef(kind, ros_version=2)
    decode = DecoderFactory().decoder_for(
        "cdr", Schema(id=1, name=kind, encoding="ros2msg", data=text.encode())
    )
    for _ in range(count):
        message = _random(rng, kind, made)
        data = packed(message)
        assert packed(store().deserialize_cdr(data, kind)) == data
        _equal(decode(data), message, made)


def _random(rng, kind, made):
    fields = store().fielddefs[kind][1]
    return made[kind](*(_value(rng, node.name, detail, made) for _, (node, detail) in fields))


def _value(rng, node, detail, made):
    if node == "NAME":
        return _random(rng, detail, made)
    if node == "BASE":
        return _base(rng, detail[0])
    item, count = detail
    name = item[1][0]
    if node == "SEQUENCE":
        count = rng.randrange(9)
    values = [_base(rng, name) for _ in range(count)]
    return values if name == "string" else np.array(values, name)


def _base(rng, name):
    if name == "string":
        return "".join(rng.choices("F345678\u00e4\u20ac", k=rng.randrange(9)))
    if name == "bool":
        return rng.random() < 0.5
    if name.startswith("float"):
        value = rng.choice((math.nan, 0.0, rng.gauss(0, 1) * 10.0 ** rng.randrange(-9, 9)))
        return float(np.float32(value)) if name == "float32" else value
    limits = np.iinfo(name)
    return rng.randint(limits.min, limits.max)


def _equal(found, wanted, made):
    for field in wanted.__dataclass_fields__:
        if field in ("__msgtype__",) or field.isupper():
            continue
        one, other = getattr(found, field), getattr(wanted, field)
        if hasattr(other, "__dataclass_fields__"):
            _equal(one, other, made)
        elif isinstance(other, float):
            assert _same(one, other), field
        elif isinstance(other, np.ndarray):
            one = np.frombuffer(one, np.uint8) if isinstance(one, bytes) else np.array(one)
            np.testing.assert_array_equal(one, other)
        else:
            assert one == other, field


@pytest.fixture
def peer(net, monkeypatch):
    """A peer that is not ours: the session of zenoh-ros2-sdk, on loopback."""
    from zenoh_ros2_sdk.session import ZenohSession

    config = json.loads(net.leaf.read_text())
    place = config["connect"]["endpoints"][0].rpartition("/")[2]
    host, _, port = place.partition(":")
    monkeypatch.setenv("ZENOH_SESSION_CONFIG_URI", str(net.leaf))
    monkeypatch.setattr(ZenohSession, "_instance", None)
    made = ZenohSession.get_instance(host, int(port))
    made.options = {"router_ip": host, "router_port": int(port), "domain_id": 0}
    yield made
    made.close()


class Heard:
    """A subscriber of zenoh-ros2-sdk, which gets the definition of a type, but not its hash."""

    def __init__(self, peer, topic, kind):
        self.messages, self.samples = [], []
        parts = _parts(kind)
        for one, text in reversed(parts.items()):
            peer.register_message_type(text, one)
        text = _text(kind)
        self.subscriber = ROS2Subscriber(
            topic,
            kind,
            self.messages.append,
            text,
            type_hash=compute_type_hash_from_msg(kind, text, parts),
            **peer.options,
        )
        key = self.subscriber.keyexpr
        peer.session.declare_subscriber(
            key, zenoh.handlers.Callback(self.samples.append, indirect=False)
        )


def test_a_foreign_peer_hears_readings_with_marks_in_order(net, peer):
    heard = Heard(peer, "/spots_a1/strip0/reading", own("Reading"))
    with publishing(net.hub, stand_in()):
        wait_until(lambda: len(heard.messages) > 50)
    marks = [Attachment.from_bytes(one.attachment.to_bytes()) for one in heard.samples]
    numbers = [one.sequence_id for one in marks]
    assert numbers == [*range(numbers[0], numbers[0] + len(numbers))]
    assert len({one.gid for one in marks}) == 1
    for message, mark in zip(heard.messages, marks):
        stamp = message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == mark.timestamp_ns
        assert message.header.frame_id == "spots_a1_strip0"
        assert message.position_m == pytest.approx(0.0425)
        assert 0 <= message.stamp_error_s < 0.1


def test_a_foreign_peer_lists_topics_and_services(net, peer):
    with publishing(net.hub, stand_in()):
        names = {f"/spots_a1/strip0/{kind}" for kind in types()} | {"/spots_a1/frames"}
        names.add("/diagnostics")
        services = {f"/spots_a1/{name}" for name in ("hello", "get", "sync")}
        wait_until(lambda: names <= {*dict(get_topic_names_and_types(**peer.options))})
        listed = dict(get_topic_names_and_types(**peer.options))
        assert listed["/spots_a1/strip0/wrench"] == ["geometry_msgs/msg/WrenchStamped"]
        assert listed["/spots_a1/frames"] == ["spots_msgs/msg/Frame"]
        found = dict(get_service_names_and_types(**peer.options))
        assert found == {name: ["std_srvs/srv/Trigger"] for name in services}
        assert list(peer.liveliness.get("@ros2_lv/0/*/*/*/NN/%/%/spots_a1"))
    wait_until(lambda: not list(peer.liveliness.get("@ros2_lv/0/**")))


def _trigger(peer, name):
    request, response = "# nothing", "bool success\nstring message"
    return ROS2ServiceClient(
        name,
        "std_srvs/srv/Trigger",
        request,
        response,
        type_hash=compute_service_type_hash("std_srvs/srv/Trigger", request, response),
        timeout=DEADLINE_S,
        **peer.options,
    )


def test_a_foreign_peer_calls_services(net, peer):
    announced = "@ros2_lv/0/*/*/*/MP/*/*/*/%spots_a1%frames/**"
    with publishing(net.hub, stand_in()):
        wait_until(lambda: list(peer.liveliness.get(announced)))
        for name, key, value in (
            ("hello", "board", "stand-in"),
            ("get", "gain", 9),
            ("sync", "stream", ["contact", "touch", "spectrum"]),
        ):
            client = _trigger(peer, f"/spots_a1/{name}")
            response = client.call(structure_needs_at_least_one_member=0)
            client.close()
            assert response.success
            assert json.loads(response.message)[key] == value


def test_a_foreign_peer_follows_a_restart_and_a_second_publisher(net, peer):
    # The peer joins late, keeps its subscriptions, and hears both boards apart.
    boards = {name: stand_in(name) for name in ("a1", "b2")}
    with publishing(net.hub, boards["a1"]):
        wait_until(lambda: boards["a1"]._port.count > 50)
        first = Heard(peer, "/spots_a1/strip0/reading", own("Reading"))
        second = Heard(peer, "/spots_b2/strip0/reading", own("Reading"))
        wait_until(lambda: len(first.messages) > 10)
        assert first.messages[0].sequence > 50
        assert not second.messages
    count = len(first.messages)
    with publishing(net.hub, stand_in("a1"), stand_in("b2")):
        wait_until(lambda: len(first.messages) > count + 10 and len(second.messages) > 10)
    gids = {Attachment.from_bytes(one.attachment.to_bytes()).gid for one in first.samples}
    assert len(gids) == 2


def test_a_service_has_the_hash_that_another_implementation_computes():
    made = service("/x/hello")
    computed = compute_service_type_hash(made.kind, "# nothing", "bool success\nstring message")
    assert made.type_hash == computed


@pytest.mark.parametrize(("reliable", "depth"), [(False, 10), (True, 3)])
def test_names_and_quality_of_service_are_the_users(net, peer, reliable, depth):
    def named(board, session):
        return Publisher(board, "0", "left_finger", naming.Qos(reliable, depth), session)

    with publishing(net.hub, stand_in(), kind=named), spots.open("zenoh:left_finger") as board:
        assert board.info["id"] == "a1"
        (info,) = get_topic_info(
            "/left_finger/strip0/reading", verbose=True, **peer.options
        ).publishers
        qos = QosProfile.decode(info.qos)
        assert (qos.reliability is QosReliability.RELIABLE) == reliable
        assert qos.history_depth == depth
        assert next(board.touches()).force_mN == 3000


def test_the_state_of_the_link_is_a_diagnostic(net):
    heard = []
    with session(net.leaf) as other, publishing(net.hub, stand_in()):
        other.declare_subscriber("0/diagnostics/*/*", heard.append)
        wait_until(lambda: heard)
    (status,) = store().deserialize_cdr(heard[0].payload.to_bytes(), DIAGNOSTICS).status
    assert (status.name, status.message, status.hardware_id) == (
        "spots_a1: link",
        "connected",
        "a1",
    )
    assert {one.key for one in status.values} >= {"frames", "lost", "restarts"}


def test_what_nobody_wants_is_not_made(net, monkeypatch):
    made, real = [], publish_module.packed
    monkeypatch.setattr(publish_module, "packed", lambda one: made.append(one) or real(one))
    link = stand_in()
    with session(net.leaf) as other, publishing(net.hub, link):
        wait_until(lambda: link._port.count > 100)
        assert made == []
        other.declare_subscriber(topic_key("a1", "point"), lambda sample: None)
        wait_until(lambda: len(made) > 10)
        assert {one.__msgtype__ for one in made} == {"geometry_msgs/msg/PointStamped"}


def test_an_attachment_has_the_layout_of_rmw_zenoh():
    mark = naming.Attachment(3, 5, bytes(range(16)))
    assert mark.packed() == struct.pack("<qqB16s", 3, 5, 16, bytes(range(16)))
    assert naming.unpacked(mark.packed()) == mark
    assert naming.unpacked(mark.packed()[:-1]) is None
    assert naming.unpacked(None) is None


@pytest.mark.parametrize("domain", ["233", "-1", "x", "1.5", "9" * 400, "\u0663"])
def test_a_domain_that_does_not_exist_is_refused(domain):
    with refusal(SettingError):
        Publisher(Board(stand_in()), domain)


def test_the_domain_comes_from_the_environment(net, monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    with publishing(net.hub, stand_in()), spots.open("zenoh:") as board:
        assert board.info["id"] == "a1"
        monkeypatch.setenv("ROS_DOMAIN_ID", "8")
        monkeypatch.setattr(session_module, "_PATIENCE_S", 0.2)
        with refusal(PortError):
            spots.open("zenoh:")


def test_the_angles_of_a_twin_are_joint_states(net, peer, monkeypatch):
    monkeypatch.setenv("ZENOH_CONFIG", str(net.hub))
    kind = "sensor_msgs/msg/JointState"
    joints = Heard(peer, "/spots_twin/joint_states", kind)
    points = Heard(peer, "/spots_twin/end_point", "geometry_msgs/msg/PointStamped")
    board, angles = SimpleNamespace(now_s=lambda: 12.0), (0.5, 2.25)
    there = Terminal(10.0, 40.0, 90.5, None, None, angles, Limit.NONE, False, True)
    nowhere = there._replace(x_mm=None, y_mm=None, limit=Limit.SINGULAR)
    with ExitStack() as stack:
        put = _publisher(stack, board)
        put(nowhere)
        wait_until(lambda: put(nowhere) or joints.messages)
        wait_until(lambda: put(there) or points.messages)
    wait_until(lambda: not list(peer.liveliness.get("@ros2_lv/0/*/*/*/MP/*/*/spots_twin/**")))
    for message in joints.messages:
        assert message.name == ["joint1", "joint2"]
        assert message.position.tolist() == [0.5, 2.25]
        ago_s = time.time() - message.header.stamp.sec
        assert 1.0 <= ago_s < 10.0
    place = points.messages[0]
    assert (place.point.x, place.point.y) == (0.04, 0.0905)
    assert place.header.frame_id == "spots_twin_base"


def test_the_package_for_ros_generates_each_own_type():
    folder = Path(__file__).parents[2] / "examples" / "ros2"
    text = (folder / "spots_msgs" / "CMakeLists.txt").read_text()
    assert re.findall(r"msg/(\w+)\.msg", text) == list(OWN)
    (inside,) = re.findall(r"CMAKE_CURRENT_SOURCE_DIR\}/([./\w]+)", text)
    for name in OWN:
        assert (folder / "spots_msgs" / inside / "msg" / f"{name}.msg").exists()
    for package in ("spots_msgs", "spots_bringup"):
        assert ElementTree.parse(folder / package / "package.xml").findtext("name") == package
    command = (folder / "spots_bringup" / "launch" / "publish.launch.yaml").read_text()
    assert re.findall("cmd: spots (.+)", command) == ["publish --wait"]
