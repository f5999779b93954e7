"""Recorded poses, and Foxglove's transforms, as transforms."""

import math
from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from making_bags import (
    FORMATS,
    S,
    Sent,
    drive,
    field,
    header,
    store,
    turn,
    varint,
    write_mcap,
)

from tf2_ros_tools import bag
from tf2_ros_tools.foxglove import tf_message
from tf2_ros_tools.loading import hear, wanted

pytestmark = pytest.mark.ours

ODOMETRY = "nav_msgs/msg/Odometry"
STAMPED = "geometry_msgs/msg/PoseStamped"
WITH_COVARIANCE = "geometry_msgs/msg/PoseWithCovarianceStamped"


def posed(ns, x, topic, msgtype, frame="map", child="base", ros=2):
    """A message with the pose x, 2, 3 and a turn by x."""
    types = store(ros).types

    def make(name, *fields, **named):
        return types[f"{name.replace('/', '/msg/')}"](*fields, **named)

    point, rotation = make("geometry_msgs/Point", x, 2.0, 3.0), make("geometry_msgs/Quaternion", *turn(x))
    pose, covariance = make("geometry_msgs/Pose", point, rotation), np.zeros(36)
    if msgtype != STAMPED:
        pose = make("geometry_msgs/PoseWithCovariance", pose, covariance)
    fields = {"header": header(ns, frame, ros), "pose": pose}
    if msgtype == ODOMETRY:
        still = [make("geometry_msgs/Vector3", 0.0, 0.0, 0.0) for _ in range(2)]
        twist = make("geometry_msgs/TwistWithCovariance", make("geometry_msgs/Twist", *still), covariance)
        fields |= {"child_frame_id": child, "twist": twist}
    return Sent(ns, topic, fields, msgtype)


STAMPS = [100 * S + i * S // 10 for i in range(20)]


def series(topic, msgtype, **how):
    return [posed(ns, i / 10, topic, msgtype, **how) for i, ns in enumerate(STAMPS)]


def check(buffer, target, source):
    translations, rotations = buffer.lookup_transforms(target, source, STAMPS)
    np.testing.assert_allclose(translations, [(i / 10, 2, 3) for i in range(20)], atol=1e-15)
    np.testing.assert_allclose(rotations, [turn(i / 10) for i in range(20)], atol=1e-15)


class TestPoses:
    @pytest.mark.parametrize("msgtype", [ODOMETRY, STAMPED, WITH_COVARIANCE])
    @pytest.mark.parametrize("form", ["mcap", "folder-sqlite3", "ros1"])
    def test_each_type_is_a_transform_between_the_given_frames(self, msgtype, form, tmp_path):
        messages = series("/pose", msgtype, ros=1 if form == "ros1" else 2)
        path = FORMATS[form](tmp_path, messages)
        check(bag.load(path, poses={"/pose": ("world", "gps")}), "world", "gps")

    def test_odometry_names_its_frames(self, tmp_path):
        path = write_mcap(tmp_path / "run.mcap", [*drive(), *series("/odom", ODOMETRY, frame="o", child="b")])
        buffer = bag.load(path, poses={"/odom": None})
        check(buffer, "o", "b")
        assert buffer.parent("odom") == "map"  # of /tf
        assert set(hear(path, wanted(poses={"/odom": None})).publishers) == {"/tf", "/tf_static", "/odom"}

    def test_several_topics_times_and_frames_that_change(self, tmp_path):
        messages = [
            *series("/odom", ODOMETRY),
            *series("/gps", STAMPED),
            *series("/odom", ODOMETRY, child="b"),
        ]
        path = write_mcap(tmp_path / "run.mcap", messages, chunk_size=1 << 20)
        both = {"/odom": None, "/gps": ("map", "gps"), "/lost": ("map", "x")}
        for child in ("base", "gps", "b"):
            check(bag.load(path, poses=both), "map", child)
        buffer = bag.load(path, poses=both, start=STAMPS[5], end=STAMPS[9])
        assert {one.count for one in buffer.frames().values() if one.parent} == {5}

    @pytest.mark.parametrize(
        ("poses", "error", "said"),
        [
            (
                {"/pose": None},
                bag.BagError,
                "run.mcap, topic /pose: a geometry_msgs/msg/PoseStamped does not name the child frame; "
                r'pass the frames, as in poses={"/gps/pose": \("map", "gps"\)}$',
            ),
            (
                {"/tf": ("a", "b")},
                bag.BagError,
                "run.mcap, topic /tf: its type is tf2_msgs/msg/TFMessage",
            ),
            (
                {"/odom": "gps"},
                TypeError,
                r"poses must map topics to \(parent, child\) or None, not /odom",
            ),
            ({"/odom": ("a",)}, TypeError, "poses must map topics to "),
            ({"/bad": None}, bag.BagError, "run.mcap, topic /bad, log time 5 ns: "),
        ],
    )
    def test_what_does_not_fit_is_told_in_one_sentence(self, poses, error, said, tmp_path):
        broken = Sent(5, "/bad", b"\0\1\0\0" + bytes(30), ODOMETRY)
        path = write_mcap(tmp_path / "run.mcap", [broken, *drive(), *series("/pose", STAMPED)])
        with pytest.raises(error, match=said):
            bag.load(path, poses=poses)


# Foxglove.

# Two transforms, as Google's library wrote them: map to base at 100.3 s, and base to caméra at 100.4 s; and
# one without a translation and a rotation, at -1 s and 5 ns.
LIST = bytes.fromhex(
    "0a460a0808641080c6868f0112036d61701a0462617365221b09ba092fd41d92ee3f1133baba95cde9d23f19000000000000e0bf"
    "2a121922eddfe9c920c33f2137e95e3e03a4ef3f0a4a0a080864108088debe011204626173651a0763616dc3a97261221b09f8a2"
    "dbe75479ed3f116b672be93aecd83f19000000000000e0bf2a1219bcd23d23ff6dc93f217a627795b45cef3f"
)
BARE = bytes.fromhex("0a0d08ffffffffffffffffff0110051201611a0162")


class TestFoxglove:
    def test_what_googles_library_writes_is_read(self, tmp_path):
        path = write_mcap(tmp_path / "run.mcap", [Sent(1, "/tf", LIST)], foxglove="protobuf")
        buffer = bag.load(path)
        found = buffer.lookup_transform("map", "base", 100_300_000_000).transform
        assert (found.translation.x, found.translation.z) == (math.cos(0.3), -0.5)
        assert found.rotation.z == pytest.approx(math.sin(0.15), abs=1e-15)
        assert buffer.frames()["caméra"].newest_ns == 100_400_000_000
        single = [Sent(1, "/tf", BARE, "foxglove.FrameTransform")]
        [(_, _, bare)] = bag.transforms(write_mcap(path, single, foxglove="protobuf"))
        assert (bare.header.stamp.sec, bare.header.stamp.nanosec) == (-1, 5)
        assert (bare.transform.translation.x, bare.transform.rotation.w) == (0.0, 1.0)

    @pytest.mark.parametrize(
        ("content", "said"),
        [
            (b"\x0a\x7f", "a field of 127 bytes does not fit into a protobuf message"),
            (b"\xff" * 11, "a number of a protobuf message has no end"),
            (b"\x08\x01", "TypeError: "),
            (field(1, field(1, b"\x08" + varint(1 << 40))), "fit into 32 bits of seconds"),
            (field(1, field(2, b"\xff")), "can't decode byte 0xff"),
        ],
    )
    def test_a_malformed_message_is_named(self, content, said, tmp_path):
        messages = [*drive(), Sent(5, "/tf", content)]
        path = write_mcap(tmp_path / "run.mcap", messages, foxglove="protobuf")
        with pytest.raises(bag.BagError) as refused:
            bag.load(path)
        where = f"{path}, topic /tf, log time 5 ns: not a foxglove.FrameTransforms: "
        assert str(refused.value).startswith(where) and said in str(refused.value)

    def test_other_topics_and_encodings_are_named(self, tmp_path):
        path = write_mcap(tmp_path / "run.mcap", drive(prefix="/one"), foxglove="protobuf")
        others = "its topics with transforms: /one/tf, /one/tf_static: choose from these"
        with pytest.raises(bag.BagError, match=others):
            bag.load(path)
        write_mcap(path, [Sent(1, "/tf", b"{}")], foxglove="json")
        with pytest.raises(bag.BagError, match="topic /tf: its encoding is json, not protobuf"):
            bag.load(path)


@given(st.data())
def test_no_bytes_make_the_reader_fail_otherwise(data):
    broken = bytearray(LIST)
    places = st.lists(st.integers(0, len(LIST) - 1), min_size=1, max_size=4)
    for place in data.draw(places):
        broken[place] = data.draw(st.integers(0, 255))
    end = data.draw(st.integers(1, len(LIST)))
    with suppress(ValueError):
        tf_message("foxglove.FrameTransforms", bytes(broken[:end]))
