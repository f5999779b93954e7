# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The broadcasters of a feed: what they send, what the buffer then has, and what they refuse."""

import pytest
from feed_helpers import Wire, seen
from times_and_transforms import transform

from tf2_ros_tools.live import Feed


@pytest.fixture
def broadcasting():
    with Feed(name="x://robot", wire=Wire()) as feed:
        yield feed


def test_broadcasters_send_and_the_buffer_has_it(broadcasting):
    feed = broadcasting
    feed.broadcaster().sendTransform(transform("map", "base", 1.0, (1, 0, 0)))
    moving = feed.broadcaster()
    assert moving is feed.broadcaster() and feed.static_broadcaster() is feed.static_broadcaster()
    moving.sendTransform([transform("map", "a", 1.0), transform("map", "b", 1.0)])
    assert [topic for topic, _ in feed._wire.sent] == ["/tf", "/tf"]
    again = Feed()
    for _, data in feed._wire.sent:
        again.take(data, False)
    assert sorted(again.buffer.frames()) == sorted(feed.buffer.frames()) == ["a", "b", "base", "map"]
    assert "broadcaster: 'this program'" in feed.buffer.all_frames_as_yaml()
    assert feed.topics["/tf"].count == 0  # nothing was heard from the robot


def test_a_static_broadcaster_sends_the_last_of_each_child_again(broadcasting):
    feed = broadcasting
    fixed = feed.static_broadcaster()
    mount = transform("base", "camera", xyz=(1, 0, 0))
    fixed.sendTransform(mount)
    mount.transform.translation.x = 5.0  # a program may use its message again
    fixed.sendTransform(transform("base", "lidar", xyz=(2, 0, 0)))
    fixed.sendTransform(iter([transform("base", "lidar", xyz=(3, 0, 0))]))
    again = Feed()
    again.take(feed._wire.sent[-1][1], True)
    assert (seen(again, "base", "camera"), seen(again, "base", "lidar")) == (1, 3)
    with pytest.raises(TypeError):
        fixed.sendTransform([transform("base", "gripper"), None])
    fixed.sendTransform(transform("base", "imu"))
    assert len(feed._wire.sent) == 4
    again.take(feed._wire.sent[-1][1], True)
    assert sorted(again.buffer.frames()) == ["base", "camera", "imu", "lidar"]


def test_a_static_broadcaster_keeps_one_transform_of_a_frame_with_and_without_a_slash(broadcasting):
    feed = broadcasting
    fixed = feed.static_broadcaster()
    for x, child in enumerate(("/dock", "dock", "/dock", "dock")):
        fixed.sendTransform(
            [transform("map", child, xyz=(-1, 0, 0)), transform("/map", child, xyz=(x, 0, 0))]
        )
        late = Feed()
        late.take(feed._wire.sent[-1][1], True)
        assert seen(feed, "map", "dock") == seen(late, "map", "dock") == x


def named(child):
    """With a name that ROS's own class would not accept."""
    one = transform("map", "base")
    one._child_frame_id = child
    return one


@pytest.mark.parametrize(
    "what", [None, "text", [transform("map", "base"), 5], named(5), named(None), [named("a"), named(b"b")]]
)
@pytest.mark.parametrize("kind", ["broadcaster", "static_broadcaster"])
def test_what_is_not_a_transform_is_refused_and_nothing_sent(broadcasting, kind, what):
    with pytest.raises(TypeError, match="expected a (geometry_msgs/TransformStamped|str)"):
        getattr(broadcasting, kind)().sendTransform(what)
    assert broadcasting._wire.sent == []


@pytest.mark.parametrize(
    ("parent", "child", "numbers", "reason"),
    [
        ("map", "map", {}, "frame_id and child_frame_id are the same"),
        ("map", "", {}, "child_frame_id is not set"),
        ("map", "arm", {"xyz": (float("nan"), 0, 0)}, "a number is NaN"),
        ("map", "arm", {"xyzw": (0, 0, 0, 0)}, "the rotation is too short or too long to be normalized"),
    ],
)
@pytest.mark.parametrize("kind", ["broadcaster", "static_broadcaster"])
def test_what_every_buffer_refuses_is_not_sent(broadcasting, kind, parent, child, numbers, reason):
    broadcaster = getattr(broadcasting, kind)()
    invalid = transform(parent, child, 1.0, **numbers)
    which = f"from frame_id '{parent}' to child_frame_id '{child}'"
    with pytest.raises(ValueError, match=f"^the transform {which} is not sent: {reason}$"):
        broadcaster.sendTransform([transform("map", "base"), invalid])
    assert broadcasting._wire.sent == []
    broadcaster.sendTransform(transform("map", "base", 1.0))
    assert sorted(broadcasting.buffer.frames()) == ["base", "map"]


def test_a_rotation_of_another_length_is_sent_with_one_warning(broadcasting, capfd):
    long = transform("map", "base", 1.0, xyzw=(0, 0, 0, 2))
    for _ in range(3):
        broadcasting.broadcaster().sendTransform(long)
    broadcasting.static_broadcaster().sendTransform(transform("map", "arm"))
    assert len(broadcasting._wire.sent) == 4
    # By the broadcaster, and by the buffer of the feed.
    assert capfd.readouterr().err.count("has a rotation of length 2") <= 2


def test_broadcasters_end(broadcasting):
    feed = broadcasting
    one = feed.broadcaster()
    feed.close()
    with pytest.raises(ConnectionError, match="^x://robot has ended .it was closed.$"):
        one.sendTransform(transform("map", "base"))
    with pytest.raises(ConnectionError, match="^x://robot has ended .it was closed.$"):
        feed.broadcaster()
    with pytest.raises(ConnectionError, match=r"^the feed cannot send; use a feed from connect\(\)$"):
        Feed().broadcaster()
