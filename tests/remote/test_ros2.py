"""Messages for ROS 2, read by software that is not ours: rosbags, mcap-ros2 and zenoh-ros2-sdk."""

import math
import random
import struct
from collections import defaultdict

import numpy as np
import pytest
import zenoh
from mcap.reader import make_reader
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_typestore
from support.net import DEADLINE_S, session, stand_in, wait_until
from zenoh_ros2_sdk.utils import compute_type_hash_from_msg

import spots
import spots_sim
from spots import Board
from spots.recording.export import export
from spots_net.publishing import publish, stream
from spots_net.ros2 import naming
from spots_net.ros2.messages import types
from spots_net.ros2.to_ros2 import Ros2
from spots_net.ros2.types import OWN, own, store


def test_standard_types_have_the_hashes_of_a_distribution():
    jazzy = get_typestore(Stores.ROS2_JAZZY)
    # As `ros2 topic info --verbose` of Jazzy prints it.
    hashed = "RIHS01_8dc3deaf06b2ab281f9f9a742a8961c328ca7cec16e3fd6586d3a5c83fa78f77"
    assert store().hash_rihs01("geometry_msgs/msg/WrenchStamped") == hashed
    assert jazzy.hash_rihs01("geometry_msgs/msg/WrenchStamped") == hashed


def _text(kind):
    return store().generate_msgdef(kind, ros_version=2)[0].split("=" * 80)[0]


@pytest.mark.parametrize("name", OWN)
def test_own_types_have_the_hashes_that_another_implementation_computes(name):
    parts = {one: _text(one) for one in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time")}
    other = compute_type_hash_from_msg(own(name), _text(own(name)), parts)
    assert other == store().hash_rihs01(own(name))


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    path = tmp_path_factory.mktemp("ros2") / "run.spots"
    with spots_sim.open(seed=71) as board, board.record(path):
        board.stream("touch", "spectrum", "contact")
        for _, _ in zip(range(250), board.touches()):
            pass
    return path


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
        assert _same(reading.position_m, touch.position_um * 1e-6)
        assert _same(reading.force_n, touch.force_mN * 1e-3)
        assert _same(reading.contrast_log2, touch.contrast)
    pressed = [one for one in touches if one.trusted]
    assert [one.point.x for one in found["point"]] == [one.position_um * 1e-6 for one in pressed]
    assert sum(one.wrench.force.z < 0 for one in found["wrench"]) == len(pressed) > 20
    spectrum = found["spectrum"][0]
    assert list(spectrum.channels) == ["F3", "F4", "F5", "F6", "F7", "F8"]
    assert spectrum.exposure_us == 10_000
    assert found["contact"]


def _same(one, other):
    return one == other or (math.isnan(one) and math.isnan(other))


def test_ten_thousand_messages_of_each_type_are_decoded_identically():
    rng = random.Random(8_130)
    made = store().types
    for kind in types().values():
        text, _ = store().generate_msgdef(kind, ros_version=2)
        schema = Schema(id=1, name=kind, encoding="ros2msg", data=text.encode())
        decode = DecoderFactory().decoder_for("cdr", schema)
        for number in range(10_000):
            message = _random(rng, kind, made)
            data = bytes(store().serialize_cdr(message, kind))
            assert bytes(store().serialize_cdr(store().deserialize_cdr(data, kind), kind)) == data
            if number % 20 == 0:
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
            np.testing.assert_array_equal(np.array(one), other)
        else:
            assert one == other, field


def test_a_node_that_a_subscriber_of_rmw_zenoh_sees(net, monkeypatch):
    from zenoh_ros2_sdk.attachment import Attachment
    from zenoh_ros2_sdk.discovery import _parse_liveliness_keyexpr
    from zenoh_ros2_sdk.keyexpr import topic_keyexpr
    from zenoh_ros2_sdk.utils import ros2_to_dds_type

    monkeypatch.setenv("ZENOH_CONFIG", str(net.hub))
    board = Board(stand_in())
    node, got = Ros2(board, "7"), []
    kind = own("Reading")
    key = topic_keyexpr(
        7, "/spots_a1/strip0/reading", ros2_to_dds_type(kind), store().hash_rihs01(kind)
    )
    with session(net.leaf) as other:
        other.declare_subscriber(key, zenoh.handlers.Callback(got.append, indirect=False))
        wait_until(lambda: len(list(other.liveliness().get("@ros2_lv/7/**"))) == 6)
        stream(board)
        while len(got) < 50:
            publish(board, [node], 0.1)
        seen = [
            _parse_liveliness_keyexpr(str(one.ok.key_expr))
            for one in other.liveliness().get("@ros2_lv/7/**", timeout=DEADLINE_S)
        ]
        topics = {one["qualified_name"] for one in seen if one}
        node.close()
        wait_until(lambda: not list(other.liveliness().get("@ros2_lv/7/**")))
    assert "/spots_a1/strip0/wrench" in topics
    marks = [Attachment.from_bytes(one.attachment.to_bytes()) for one in got]
    numbers = [one.sequence_id for one in marks]
    assert numbers == [*range(numbers[0], numbers[0] + len(numbers))]
    assert len({one.gid for one in marks}) == 1
    for sample, mark in zip(got, marks):
        message = store().deserialize_cdr(sample.payload.to_bytes(), kind)
        stamp = message.header.stamp
        assert stamp.sec * 10**9 + stamp.nanosec == mark.timestamp_ns
        assert message.header.frame_id == "spots_a1_strip0"


def test_an_attachment_has_the_layout_of_rmw_zenoh():
    mark = naming.attachment(3, 5, bytes(range(16)))
    assert mark == struct.pack("<qqB16s", 3, 5, 16, bytes(range(16)))


def test_a_domain_that_does_not_exist_is_refused():
    with pytest.raises(spots.SpotsError, match="'233' is not a ROS domain"):
        Ros2(Board(stand_in()), "233")
