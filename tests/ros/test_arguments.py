"""Arguments: what is a time or a timeout in every call, and what those in the places of others are told."""

import asyncio
import math
from datetime import timedelta
from types import SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import PointStamped, PoseStamped, Transform, TransformStamped
from making import at, stamp_ns, transform
from processes import PROMPT_S, seconds_of
from rclpy.duration import Duration
from rclpy.time import Time

import tf2_geometry_msgs

pytestmark = pytest.mark.ours

HALF = 1_500_000_000
TIMES = [HALF, np.int64(HALF), np.datetime64(HALF, "ns"), np.datetime64(1500, "ms")]
ADVICE = (
    r"use Time\(seconds=\.\.\.\), node\.get_clock\(\)\.now\(\), an int of nanoseconds, a datetime64, "
    r"or Time\(\) for the latest"
)
DAY_S = 86400


@pytest.fixture
def buffer(tf2_ros):
    buffer = tf2_ros.Buffer()
    for seconds in (1, 2):
        buffer.set_transform(transform("map", "base", seconds, (seconds, 0, 0)), "me")
    return buffer


# Each with one time, or with the same one twice, and a timeout where it has one.
LOOKUPS = {
    "lookup_transform": lambda b, t, **how: b.lookup_transform("map", "base", t, **how),
    "lookup_transform_full": lambda b, t, **how: b.lookup_transform_full("map", t, "base", t, "map", **how),
    "can_transform": lambda b, t, **how: b.can_transform("map", "base", t, **how),
    "can_transform_full": lambda b, t, **how: b.can_transform_full("map", t, "base", t, "map", **how),
    "wait_for_transform_async": lambda b, t, **how: b.wait_for_transform_async(
        "map", "base", t, **how
    ).result(),
    "wait_for_transform_full_async": lambda b, t, **how: b.wait_for_transform_full_async(
        "map", t, "base", t, "map", **how
    ).result(),
    "lookup_transform_async": lambda b, t, **how: asyncio.run(
        b.lookup_transform_async("map", "base", t, **how)
    ),
    "lookup_transform_full_async": lambda b, t, **how: asyncio.run(
        b.lookup_transform_full_async("map", t, "base", t, "map", **how)
    ),
}
OTHER_TIMES = {
    "target_time": lambda b, t: b.lookup_transforms("map", "base", [1], fixed_frame="map", target_time=t),
    "transform_full": lambda b, t: b.transform_full(point(), "map", t, "map"),
    "lookupVelocityCore": lambda b, t: b.lookupVelocityCore("base", "map", t, Duration(seconds=0.1)),
    "_chain": lambda b, t: b._chain("map", t, "base", t, "map"),
    "_allFramesAsDot": lambda b, t: b._allFramesAsDot(t),
}
every_lookup = pytest.mark.parametrize("call", LOOKUPS)


def point():
    message = PointStamped()
    message.header.frame_id = "base"
    message.header.stamp = at(1.5).to_msg()
    return message


@every_lookup
@pytest.mark.parametrize("moment", TIMES, ids=repr)
def test_every_lookup_takes_integers_and_datetimes(buffer, call, moment):
    assert LOOKUPS[call](buffer, moment) == LOOKUPS[call](buffer, at(1.5))


@pytest.mark.parametrize("call", OTHER_TIMES)
def test_a_float_as_a_time_is_refused_with_what_to_use(buffer, call):
    with pytest.raises(TypeError, match=ADVICE):
        OTHER_TIMES[call](buffer, 1.5)


@every_lookup
def test_a_lookup_refuses_a_float_with_what_to_use(buffer, call):
    with pytest.raises(TypeError, match=f"time must .*; float has neither: {ADVICE}"):
        LOOKUPS[call](buffer, 1.5)


def test_other_calls_take_integers_and_datetimes(buffer):
    for moment in TIMES:
        rows, _ = buffer.lookup_transforms("map", "base", [moment, moment])
        assert rows.tolist() == [[1.5, 0, 0]] * 2
        rows, _ = buffer.lookup_transforms("base", "base", [at(1)], fixed_frame="map", target_time=moment)
        assert rows.tolist() == [[-0.5, 0, 0]]
        assert buffer.transform_points([[1.0, 0, 0]], [moment], "map", "base").tolist() == [[2.5, 0, 0]]
        assert stamp_ns(buffer.transform_full(point(), "map", moment, "map")) == HALF
        (speed, _, _), _ = buffer.lookupVelocityCore("base", "map", moment, Duration(seconds=0.1))
        assert speed == pytest.approx(1)
        assert buffer._chain("map", moment, "base", moment, "map") == ["base", "map"]
        assert buffer._allFramesAsDot(moment) == buffer._allFramesAsDot(at(1.5))


def test_stamped_takes_any_time(tf2_ros):
    for moment in (*TIMES, at(1.5), at(1.5).to_msg(), SimpleNamespace(nanoseconds=HALF)):
        assert stamp_ns(tf2_ros.Stamped(SimpleNamespace(), moment, "map")) == HALF
    with pytest.raises(TypeError, match=f"^stamp must .*{ADVICE}"):
        tf2_ros.Stamped(SimpleNamespace(), 1.5, "map")


@every_lookup
@pytest.mark.parametrize(
    "duration", [Duration(seconds=1.5), Duration(seconds=1.5).to_msg()], ids=["rclpy", "message"]
)
def test_a_duration_as_a_time_is_refused_with_what_to_use(buffer, call, duration):
    with pytest.raises(TypeError, match=rf"time is a Duration, which says how long and not when: {ADVICE}$"):
        LOOKUPS[call](buffer, duration)


# Programs for tf2 ask for the latest time like this, too.
@pytest.mark.parametrize("zero", [Duration(), Duration().to_msg()], ids=["rclpy", "message"])
def test_a_duration_of_zero_is_the_latest_time(buffer, zero):
    assert stamp_ns(buffer.lookup_transform("map", "base", zero)) == 2 * 10**9


def test_a_time_in_the_wrong_unit_is_suspected(buffer, tf2_py):
    buffer.set_transform(transform("map", "robot", 1_795_000_000), "me")
    asked = "The requested time is in 1970: is it in the wrong unit, or simulated time"
    with pytest.raises(tf2_py.ExtrapolationException, match=asked):
        buffer.lookup_transform("map", "robot", 1_795_000_000)
    with pytest.raises(tf2_py.ExtrapolationException) as plausible:
        buffer.lookup_transform("map", "robot", Time(seconds=1_794_000_000))
    assert "1970" not in str(plausible.value)


def test_a_timeout_of_years_warns_that_a_number_is_seconds(buffer, recwarn):
    with pytest.warns(UserWarning, match="^timeout=5000000000 is 158 years, because a number is seconds$"):
        assert buffer.can_transform("map", "base", Time(), timeout=5_000_000_000)
    for timeout in (10**7, 1e9, math.inf, 2**63, Duration(seconds=10**9)):
        assert buffer.can_transform("map", "base", Time(), timeout=timeout)
    assert not recwarn.list


@every_lookup
def test_every_lookup_takes_seconds_as_a_timeout(buffer, call):
    for timeout in (DAY_S, float(DAY_S), np.float32(DAY_S), math.inf, 0, -1.0):
        assert LOOKUPS[call](buffer, at(1.5), timeout=timeout) == LOOKUPS[call](buffer, at(1.5))


@pytest.mark.parametrize("call", ["lookup_transform", "lookup_transform_full"])
def test_seconds_are_how_long_a_lookup_waits(buffer, tf2_ros, call):
    seconds, error = seconds_of(lambda: LOOKUPS[call](buffer, at(9), timeout=0.05))
    assert type(error) is tf2_ros.ExtrapolationException
    assert 0.05 <= seconds < PROMPT_S


@pytest.mark.parametrize("call", ["lookup_transform", "lookup_transform_full"])
@pytest.mark.parametrize("timeout", [-DAY_S, -math.inf, 0.0])
def test_without_seconds_a_lookup_does_not_wait(buffer, tf2_ros, call, timeout):
    seconds, error = seconds_of(lambda: LOOKUPS[call](buffer, at(9), timeout=timeout))
    assert type(error) is tf2_ros.ExtrapolationException
    assert seconds < PROMPT_S


@pytest.mark.parametrize("call", ["lookup_transform_async", "lookup_transform_full_async"])
def test_seconds_are_how_long_a_coroutine_waits(buffer, tf2_ros, call):
    seconds, error = seconds_of(lambda: LOOKUPS[call](buffer, at(9), timeout=0.05))
    assert type(error) is tf2_ros.TimeoutException
    assert seconds >= 0.05


def test_objects_are_transformed_within_seconds(buffer):
    assert buffer.transform(point(), "map", 1.0).point.x == 1.5
    assert buffer.transform_full(point(), "map", HALF, "map", 1).point.x == 1.5
    assert asyncio.run(buffer.transform_async(point(), "map", math.inf)).point.x == 1.5


@every_lookup
def test_a_timeout_that_is_none_is_refused(buffer, call):
    with pytest.raises(TypeError, match=r"^timeout must be .*, not bool: use Duration\(seconds=\.\.\.\)"):
        LOOKUPS[call](buffer, at(1.5), timeout=True)
    with pytest.raises(ValueError, match="^timeout is NaN"):
        LOOKUPS[call](buffer, at(1.5), timeout=math.nan)
    with pytest.raises(TypeError, match="^timeout is a Time"):
        LOOKUPS[call](buffer, Duration(), timeout=Time())


def test_a_timedelta_is_refused_as_a_duration(tf2_ros, buffer):
    pandas = pytest.importorskip("pandas")
    for wrong in (timedelta(seconds=10), pandas.Timedelta("10s")):
        advice = rf"is a {type(wrong).__name__}: use Duration\(seconds=\.\.\.\)$"
        with pytest.raises(TypeError, match=f"^cache_time {advice}"):
            tf2_ros.Buffer(cache_time=wrong)
        with pytest.raises(TypeError, match=f"^averaging_interval {advice}"):
            buffer.lookupVelocityCore("base", "map", at(1.5), wrong)
        with pytest.raises(TypeError, match=f"^timeout {advice}"):
            buffer.lookup_transform("map", "base", at(1.5), timeout=wrong)


def test_an_authority_that_is_no_text_is_called_so(buffer):
    for call in (buffer.set_transform, buffer.set_transform_static):
        with pytest.raises(TypeError, match="^authority must be a str, not bytes$"):
            call(transform("map", "base", 1), b"me")


def test_a_name_of_a_frame_that_is_none_is_called_by_its_argument(buffer):
    text = "a frame name must be a str, not"
    with pytest.raises(TypeError, match=f"^target_frame: {text} Time"):
        buffer.lookup_transform(at(1), "map", "base")
    with pytest.raises(TypeError, match=f"^source_frame: {text} Time"):
        buffer.lookup_transform("map", at(1), "base")
    with pytest.raises(TypeError, match=f"^fixed_frame: {text} int"):
        buffer.lookup_transform_full("map", at(1), "base", at(1), 5)
    with pytest.raises(TypeError, match=f"^fixed_frame: {text} int"):
        buffer.lookup_transforms("map", "base", [at(1)], fixed_frame=5, target_time=at(1))


def test_points_and_times_come_before_the_frames(buffer):
    with pytest.raises(TypeError, match="^points .*, not str: the frames follow points and times$"):
        buffer.transform_points("map", "base", [[1.0, 0, 0]], [1])
    with pytest.raises(TypeError, match="^times .*, not str$"):
        buffer.transform_points([[1.0, 0, 0]], "map", "base", [1])


@pytest.mark.parametrize("wrong", [10.0, 10, True, "10"], ids=repr)
def test_other_durations_are_no_numbers(tf2_ros, buffer, node, wrong):
    advice = r"must have nanoseconds, .*: use Duration\(seconds=\.\.\.\)$"
    with pytest.raises(TypeError, match=f"^averaging_interval {advice}"):
        buffer.lookupVelocityCore("base", "map", at(1.5), wrong)
    with pytest.raises(TypeError, match=f"^tolerance {advice}"):
        tf2_ros.MessageFilter(None, buffer, "map", 0, node=node, tolerance=wrong)


def test_a_filter_takes_seconds_as_its_timeout(tf2_ros, buffer, node):
    tf2_ros.MessageFilter(None, buffer, "map", 0, node=node, buffer_timeout=0.5).close()
    with pytest.raises(TypeError, match="^buffer_timeout must be a duration or seconds"):
        tf2_ros.MessageFilter(None, buffer, "map", 0, node=node, buffer_timeout="0.5")


def test_the_input_of_a_filter_begins_with_the_type(tf2_ros, node, buffer):
    with pytest.raises(TypeError, match=r"^input must be \(message type, topic, qos\), in this order"):
        tf2_ros.MessageFilter(("points", PointStamped, 10), buffer, "map", 10, node=node)


class TestFunctionsForMessages:
    """do_transform_*: what to pass instead."""

    @pytest.mark.parametrize("wrong", [PointStamped(), None, TransformStamped], ids=str)
    def test_the_transform_is_the_second_argument(self, wrong):
        with pytest.raises(AttributeError, match="got .*; pass the message first, then the transform$"):
            tf2_geometry_msgs.do_transform_point(TransformStamped(), wrong)

    def test_a_stamped_pose_has_a_function_of_its_own(self):
        with pytest.raises(
            AttributeError, match="got PoseStamped: .*; use the function whose name ends in _stamped$"
        ):
            tf2_geometry_msgs.do_transform_pose(PoseStamped(), TransformStamped())


class TestLacking:
    """Where tf2 raises an AttributeError, what is raised is one, too."""

    @pytest.mark.parametrize("kind", [TypeError, AttributeError])
    @pytest.mark.parametrize(
        ("call", "text"),
        [
            (lambda tf, b: tf.TransformBroadcaster(b), "create_publisher; Buffer"),
            (lambda tf, b: tf.StaticTransformBroadcaster(None), "create_publisher; NoneType"),
            (lambda tf, b: tf.TransformListener(b, 10), "create_subscription; int"),
            (lambda tf, b: tf.TransformListener(None, b), "create_subscription; Buffer"),
            (lambda tf, b: tf.BufferClient("server", b), "create_client; str"),
            (lambda tf, b: tf.BufferServer(b, "server", b), "create_service; str"),
            (lambda tf, b: tf.MessageFilter(None, b, "map", 1, node=b), "create_subscription; Buffer"),
        ],
    )
    def test_something_else_as_a_node(self, tf2_ros, buffer, call, text, kind):
        with pytest.raises(kind, match=rf"^\w+ needs a node, which has {text} has not$"):
            call(tf2_ros, buffer)

    @pytest.mark.parametrize("name", ["TransformBroadcaster", "StaticTransformBroadcaster"])
    @pytest.mark.parametrize("wrong", [None, 5, "map", Transform(), [Transform()]], ids=repr)
    @pytest.mark.parametrize("strict", [False, True])
    def test_a_broadcaster_sends_transforms_alone(self, tf2_ros, node, name, wrong, strict):
        broadcaster = getattr(tf2_ros, name)(node, strict=strict)
        with pytest.raises(TypeError, match=r"^sendTransform takes a TransformStamped, or several, not \w+$"):
            broadcaster.sendTransform(wrong)
        if name.startswith("Static"):
            assert broadcaster.net_message.transforms == []

    @pytest.mark.parametrize("register", ["registerCallback", "registerFailureCallback"])
    def test_a_filter_calls_functions(self, tf2_ros, node, buffer, register):
        with tf2_ros.MessageFilter(None, buffer, "map", 10, node=node) as points:
            with pytest.raises(TypeError, match=f"^{register} needs a function to call, not str$"):
                getattr(points, register)("callback")
            assert points.callbacks == {}


class TestClassesAsObjects:
    """``PointStamped`` where ``PointStamped()`` is meant."""

    def test_a_buffer_inserts_no_class(self, buffer):
        with pytest.raises(TypeError, match="^expected .*, got the class TransformStamped: "):
            buffer.set_transform(TransformStamped, "me")

    def test_a_function_for_points_takes_no_class(self):
        with pytest.raises(AttributeError, match="got a class: .*; pass a message, not its class$"):
            tf2_geometry_msgs.do_transform_point(PointStamped, TransformStamped())

    def test_a_broadcaster_sends_no_class(self, tf2_ros, node):
        with pytest.raises(TypeError, match="^sendTransform takes .* not the class TransformStamped$"):
            tf2_ros.TransformBroadcaster(node).sendTransform(TransformStamped)

    def test_a_filter_takes_no_class(self, tf2_ros, node, buffer):
        with tf2_ros.MessageFilter(None, buffer, "map", 10, node=node) as points:
            with pytest.raises(TypeError, match="^the class PointStamped has no header"):
                points.add(PointStamped)


class TestDuckTypes:
    """What has the attributes that are used is accepted, as in tf2."""

    def test_a_node_of_its_own_kind_will_do(self, tf2_ros, node):
        class Publishing:
            create_publisher = node.create_publisher
            get_logger = node.get_logger

        tf2_ros.TransformBroadcaster(Publishing(), 10).sendTransform(transform("map", "base"))

    def test_a_buffer_of_its_own_kind_will_do(self, tf2_ros, node):
        class Kept:
            def __init__(self):
                self.set_transform = self.set_transform_static = self.kept = []

        assert not tf2_ros.TransformListener(Kept(), node).receives

    def test_a_subclass_with_its_own_callback_needs_no_buffer(self, tf2_ros, node):
        class Printing(tf2_ros.TransformListener):
            def callback(self, data):
                print(self.buffer, data)

        for anything in (None, node, "no buffer"):
            assert Printing(anything, node).node is node

    def test_any_two_fields_are_a_cache_time(self, tf2_ros):
        for cache_time in (Duration(seconds=2).to_msg(), SimpleNamespace(sec=2, nanosec=0)):
            assert tf2_ros.Buffer(cache_time).cache_time_ns == 2 * 10**9
