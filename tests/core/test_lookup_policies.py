# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Ways to ask for a tolerance, extrapolation or a longest gap; answers: test_buffer_beside_model.py."""

import asyncio

import pytest
from times_and_transforms import S, at, at_ns, stamp_ns, transform

from tf2_py.typing import LookupPolicy


def test_a_gap_that_is_too_long_is_described(tf2_ros):
    buffer = tf2_ros.Buffer()
    for second in (2, 4):
        buffer.set_transform(transform("map", "base", second), "x")
    with pytest.raises(tf2_ros.ExtrapolationException) as raised:
        buffer.lookup_transform("map", "base", at_ns(3 * S), max_gap=1)
    assert str(raised.value) == (
        "Lookup at time 3.000000000 would require interpolation across 2.000000000 s, when looking up "
        "transform from frame [base] to frame [map]; the samples of base at 2.000000000 and "
        "4.000000000 are further apart than max_gap, 1.000000000 s"
    )
    with pytest.raises(tf2_ros.ExtrapolationException, match=r"^times\[1\]: Lookup at time 3"):
        buffer.lookup_transforms("map", "base", [2 * S, 3 * S], max_gap=1)


def test_a_frame_without_data_is_described_rather_than_one_with_a_gap_that_is_too_long(tf2_ros):
    buffer = tf2_ros.Buffer()
    for parent, child, stamps in (("map", "torn", (2, 6)), ("map", "late", (2, 3))):
        for second in stamps:
            buffer.set_transform(transform(parent, child, second), "x")
    for ends in (("torn", "late"), ("late", "torn")):
        with pytest.raises(
            tf2_ros.ExtrapolationException, match=r"sample of late \(parent map\) .* is 1\.0+ s too old"
        ):
            buffer.lookup_transform(*ends, at_ns(4 * S), max_gap=1)
        with pytest.raises(tf2_ros.ExtrapolationException, match="the samples of torn at 2.0+ and 6.0+"):
            buffer.lookup_transform(*ends, at_ns(4 * S), max_gap=1, tolerance=1)


LATE = at_ns(5 * S // 2)
ONE, TWO, DATA = ("map", "base", LATE), ("map", LATE, "base", LATE, "odom"), transform("base", "data", 2.5)
WAYS = {
    "lookup_transform": lambda b, **p: b.lookup_transform(*ONE, **p),
    "with a timeout": lambda b, **p: b.lookup_transform(*ONE, 0.001, **p),
    "full": lambda b, **p: b.lookup_transform_full(*TWO, **p),
    "full, with a timeout": lambda b, **p: b.lookup_transform_full(*TWO, 0.001, **p),
    "async": lambda b, **p: asyncio.run(b.lookup_transform_async(*ONE, timeout=0.01, **p)),
    "full async": lambda b, **p: asyncio.run(b.lookup_transform_full_async(*TWO, timeout=0.01, **p)),
    "transform": lambda b, **p: b.transform(DATA, "map", **p),
    "transform_full": lambda b, **p: b.transform_full(DATA, "map", LATE, "odom", **p),
    "transform_async": lambda b, **p: asyncio.run(b.transform_async(DATA, "map", timeout=0.01, **p)),
}


@pytest.mark.parametrize("way", WAYS)
def test_every_way_to_look_up_takes_each_argument_of_the_table(tf2_ros, way):
    pytest.importorskip("tf2_geometry_msgs")
    buffer = tf2_ros.Buffer()
    for second in (2, 3):
        buffer.set_transform(transform("map", "odom", second), "x")
        buffer.set_transform(transform("odom", "base", second), "x")
    assert WAYS[way](buffer, **dict.fromkeys(LookupPolicy.__annotations__)) == WAYS[way](buffer)


def robot(tf2_ros):
    """A buffer in which odom has stopped at 1 s, and base moves on until 3 s."""
    buffer = tf2_ros.Buffer()
    buffer.set_transform(transform("map", "odom", 1), "x")
    for second in (1, 2, 3):
        buffer.set_transform(transform("odom", "base", second, (second, 0, 0)), "x")
    return buffer


def stamped(kind, seconds, **fields):
    message = kind(**fields)
    message.header.frame_id, message.header.stamp = "base", at(seconds).to_msg()
    return message


WAYS_TO_TRANSFORM = {
    "transform": lambda b, data, **p: b.transform(data, "map", **p),
    "with a timeout": lambda b, data, **p: b.transform(data, "map", 0.001, **p),
    "transform_full": lambda b, data, **p: b.transform_full(data, "map", data.header.stamp, "odom", **p),
    "transform_async": lambda b, data, **p: asyncio.run(b.transform_async(data, "map", 0.01, **p)),
}


@pytest.mark.parametrize("policy", [{}, {"extrapolate": True}, {"max_gap": 1}], ids=str)
@pytest.mark.parametrize("way", WAYS_TO_TRANSFORM)
def test_data_keeps_its_stamp_under_a_tolerance(tf2_ros, way, policy):
    pytest.importorskip("tf2_geometry_msgs")
    from geometry_msgs.msg import PointStamped, PoseWithCovarianceStamped, TwistStamped

    buffer, carry = robot(tf2_ros), WAYS_TO_TRANSFORM[way]
    for kind in (PointStamped, PoseWithCovarianceStamped, TwistStamped):
        moved = carry(buffer, stamped(kind, 2.5), tolerance=2, **policy)
        assert (moved.header.frame_id, stamp_ns(moved)) == ("map", 5 * S // 2)
    # And so the way back leads to where it began.
    moved = carry(buffer, stamped(PointStamped, 2), tolerance=2, **policy)
    assert moved.point.x == 2
    assert buffer.transform(moved, "base", tolerance=2, **policy).point.x == 0
    # The lookup itself says how old its answer is.
    if not policy.get("extrapolate"):
        assert stamp_ns(buffer.lookup_transform("map", "base", at(2), tolerance=2)) == S


@pytest.mark.parametrize("way", WAYS_TO_TRANSFORM)
def test_data_without_a_time_gets_that_of_the_transform_under_a_policy_too(tf2_ros, way):
    pytest.importorskip("tf2_geometry_msgs")
    from geometry_msgs.msg import PointStamped

    buffer, point = robot(tf2_ros), stamped(PointStamped, 0)
    for policy in ({}, {"tolerance": 2}, {"max_gap": 1}):
        assert stamp_ns(WAYS_TO_TRANSFORM[way](buffer, point, **policy)) == S


@pytest.mark.parametrize("way", WAYS_TO_TRANSFORM)
@pytest.mark.parametrize("seconds", [0, 2])
def test_a_cloud_keeps_its_own_stamp_under_a_tolerance(tf2_ros, way, seconds):
    pytest.importorskip("tf2_sensor_msgs")
    from sensor_msgs.msg import PointCloud2, PointField

    fields = [PointField(name=name, offset=4 * i, datatype=7, count=1) for i, name in enumerate("xyz")]
    layout = {"fields": fields, "height": 1, "width": 1, "point_step": 12, "row_step": 12, "data": bytes(12)}
    cloud = stamped(PointCloud2, seconds, **layout)
    moved = WAYS_TO_TRANSFORM[way](robot(tf2_ros), cloud, tolerance=2)
    assert (moved.header.frame_id, stamp_ns(moved)) == ("map", seconds * S)


def test_the_target_time_is_the_stamp_of_a_full_transform_under_a_tolerance(tf2_ros):
    pytest.importorskip("tf2_geometry_msgs")
    from geometry_msgs.msg import PointStamped

    buffer, point = robot(tf2_ros), stamped(PointStamped, 2)
    for target_time, wanted in ((at(2.75), 11 * S // 4), (11 * S // 4, 11 * S // 4), (at(0), S)):
        moved = buffer.transform_full(point, "map", target_time, "odom", tolerance=2)
        assert stamp_ns(moved) == wanted


def test_a_transform_that_a_program_returns_is_not_changed(tf2_ros):
    pytest.importorskip("tf2_geometry_msgs")
    from geometry_msgs.msg import PointStamped

    kept = transform("map", "base", 1)

    class Mine(tf2_ros.BufferInterface):
        def lookup_transform(self, target, source, time, timeout=None, **policy):
            return kept

    assert stamp_ns(Mine().transform(stamped(PointStamped, 2), "map", tolerance=2)) == 2 * S
    assert stamp_ns(kept) == S


@pytest.mark.parametrize("name", ["timeout", "time_out"])
def test_a_timeout_is_meant_only_by_methods_that_wait(tf2_ros, name):
    buffer, how = tf2_ros.Buffer(), {name: 1}
    unknown = f"got an unexpected keyword argument '{name}'"
    for call, run in (
        ("lookup_matrix", lambda: buffer.lookup_matrix("map", "base", S, **how)),
        ("lookup_matrices", lambda: buffer.lookup_matrices("map", "base", [S], **how)),
        ("lookup_transforms", lambda: buffer.lookup_transforms("map", "base", [S], **how)),
        ("transform_points", lambda: buffer.transform_points([(0, 0, 1)], [S], "map", "base", **how)),
    ):
        with pytest.raises(
            TypeError, match=rf"^{call}\(\) {unknown}\. It does not wait: first call lookup_tr"
        ):
            run()
    with pytest.raises(TypeError, match=r"'time_out'\. Did you mean 'timeout'\?$"):
        buffer.lookup_transform("map", "base", at_ns(S), time_out=1)


@pytest.mark.parametrize(
    ("policy", "error", "text"),
    [
        ({"tolerance": -1}, ValueError, "must not be negative"),
        ({"tolerance": float("-inf")}, ValueError, "must not be negative, got -inf s"),
        ({"tolerance": float("nan")}, ValueError, "NaN"),
        ({"tolerance": "1"}, TypeError, "tolerance"),
        ({"max_gap": -0.1}, ValueError, "must not be negative"),
        ({"extrapolate": True}, TypeError, "needs a tolerance"),
        ({"tolerance": 1, "extrapolate": "no"}, TypeError, "^extrapolate: expected a bool, got str$"),
        ({"tolerence": 1}, TypeError, r"^CALL\(\) got .* 'tolerence'. Did you mean 'tolerance'\?$"),
        ({"color": 1}, TypeError, r"^CALL\(\) got an unexpected keyword .* 'color'$"),
    ],
    ids=str,
)
def test_wrong_policies_are_refused_by_every_method_and_misspelt_ones_named_with_it(
    tf2_ros, policy, error, text
):
    buffer, given = tf2_ros.Buffer(), ("map", "base", at_ns(S))
    for call, run in (
        ("lookup_transform", lambda: buffer.lookup_transform(*given, **policy)),
        ("lookup_transform", lambda: buffer.lookup_transform(*given, timeout=1, **policy)),
        ("lookup_transforms", lambda: buffer.lookup_transforms("map", "base", [S], **policy)),
        ("transform_points", lambda: buffer.transform_points([(0, 0, 1)], [S], "map", "base", **policy)),
        ("wait_for_transform_async", lambda: buffer.wait_for_transform_async(*given, **policy)),
        ("lookup_transform_async", lambda: buffer.lookup_transform_async(*given, **policy).send(None)),
    ):
        with pytest.raises(error, match=text.replace("CALL", call)):
            run()
