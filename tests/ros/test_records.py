# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a receiver notes of each transform, if it is asked to."""

import numpy as np
import pytest
from rclpy.utilities import get_rmw_implementation_identifier
from times_and_transforms import S, transform
from waiting import errors_so_far, until, until_told

from tf2_msgs.msg import TFMessage
from tf2_ros.records import RECORD, Recording

MALFORMED = bytes.fromhex("0001000001000000")  # one transform is announced


@pytest.fixture
def heard(tf2_ros, node):
    """A function: a Recording of so many transforms that a listener of `node` fills."""
    listeners = []

    def make(*arguments):
        recording = Recording(*arguments)
        buffer = tf2_ros.Buffer(node=node)
        listeners.append(tf2_ros.TransformListener(buffer, node, recording=recording))
        assert listeners[-1].receives
        return recording

    yield make
    for listener in listeners:
        listener.unregister()


def take(recording, count):
    """So many records, once they have arrived."""
    taken = [np.zeros(0, RECORD)]

    def enough():
        taken.append(recording.take())
        return sum(map(len, taken)) >= count

    until(enough)
    return np.concatenate(taken)


@pytest.mark.skipif(
    get_rmw_implementation_identifier() == "rmw_cyclonedds_cpp",
    reason="Cyclone DDS identifies the publisher of a message differently from the graph",
)
def test_each_transform_has_its_publisher_times_and_names(heard, node, peer):
    recording = heard()
    one, other = peer("-r", "__node:=one"), peer("-r", "__node:=other", "-r", "__ns:=/arm")
    before_ns = node.get_clock().now().nanoseconds
    one.send(("map", "odom", 5 * S, 0.0), ("odom", "/base", 6 * S, 0.0))
    records = take(recording, 2)
    other.send(("/map", "odom", 7 * S, 0.0))
    records = np.concatenate([records, take(recording, 1)])
    one.send(("base", "camera", 0, 0.0), static=True)
    records = np.concatenate([records, take(recording, 1)])
    received = [before_ns, *records["received_ns"].tolist(), node.get_clock().now().nanoseconds]
    assert received == sorted(received)

    def told():
        topics = ("/tf", "/tf_static")
        infos = [info for topic in topics for info in node.get_publishers_info_by_topic(topic)]
        nodes = {bytes(info.endpoint_gid)[:16]: f"{info.node_namespace}{info.node_name}" for info in infos}
        names, gids = recording.frames(), recording.publishers()
        return [
            (nodes.get(gids[one["publisher"]]), names[one["parent"]], names[one["child"]], one["stamp_ns"])
            for one in records
        ]

    expected = [
        ("/one", "map", "odom", 5 * S),
        ("/one", "odom", "base", 6 * S),
        ("/armother", "map", "odom", 7 * S),
        ("/one", "base", "camera", 0),
    ]
    until_told(lambda: told() == expected)
    assert records["static"].tolist() == [0, 0, 0, 1] and len(recording.publishers()) == 3


def test_a_rotation_that_newer_releases_refuse_is_marked(heard, node, capfd):
    recording = heard()
    publisher = node.create_publisher(TFMessage, "/tf", 10)
    turns = {"odom": (0, 0, 0, 1), "arm": (0, 0, 0, 2), "hand": (0, 0, 0, 0)}
    until(lambda: publisher.get_subscription_count() == 1)
    publisher.publish(
        TFMessage(transforms=[transform("map", child, 1, xyzw=turns[child]) for child in turns])
    )
    records = take(recording, 3)
    marks = {recording.frames()[one["child"]]: (one["unnormalized"], one["refusals"] != 0) for one in records}
    assert marks == {"odom": (0, False), "arm": (1, False), "hand": (0, True)}
    until(lambda: "rotation of length 2." in errors_so_far())
    assert errors_so_far().count("of length") == 1


def test_what_there_is_no_place_for_and_what_cannot_be_read_is_counted(heard, peer):
    recording, talker = heard(3), peer()
    talker.send(*(("map", f"f{i}", S, 0.0) for i in range(5)))
    until(lambda: recording.lost == 2)
    assert len(recording.take()) == 3
    talker.send_bytes(MALFORMED)
    until(lambda: recording.malformed == 1)
    talker.send(("map", "f9", S, 0.0))
    [one] = take(recording, 1)
    assert recording.frames()[one["child"]] == "f9"
    assert (recording.lost, recording.messages, recording.malformed) == (2, 2, 1)


@pytest.mark.parametrize("overridden", [("callback",), ("static_callback",), ("callback", "static_callback")])
def test_a_listener_that_cannot_record_every_topic_says_so(tf2_ros, node, overridden):
    def insert(self, data):
        for one in data.transforms:
            self.buffer.set_transform(one, "example")

    listener = type("Listener", (tf2_ros.TransformListener,), dict.fromkeys(overridden, insert))
    with pytest.raises(NotImplementedError, match="does not work with this listener: this program overrides"):
        listener(tf2_ros.Buffer(node=node), node, recording=Recording())
