# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Arguments: what is a time or a timeout in every call, and what is said of wrong ones."""

import asyncio
import functools
import inspect
import math
import re
import time
from datetime import timedelta
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest
from geometry_msgs.msg import (
    Point32,
    PointStamped,
    Pose,
    PoseStamped,
    Transform,
    TransformStamped,
    Vector3,
    Wrench,
)
from rclpy.duration import Duration
from rclpy.time import Time
from sensor_msgs.msg import PointCloud2, PointField
from simulated_clock import simulate
from times_and_transforms import at, stamp_ns, transform
from waiting import PROMPT_S, errors_so_far, seconds_of, until

import tf2_geometry_msgs
import tf2_ros.correction
import tf2_sensor_msgs
from tf2_ros.numpy import propagate
from tf2_ros.serialization import MessageSource, serialize_transforms

HALF = 1_500_000_000
ADVICE = (
    r"use Time\(seconds=\.\.\.\), node\.get_clock\(\)\.now\(\), an int of nanoseconds, a datetime64, "
    r"or Time\(\) for the latest"
)


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
    "lookup_transform_async": lambda b, t, **how: asyncio.run(
        b.lookup_transform_async("map", "base", t, **how)
    ),
    "lookup_transform_full_async": lambda b, t, **how: asyncio.run(
        b.lookup_transform_full_async("map", t, "base", t, "map", **how)
    ),
}
OTHERS = {
    "lookup_transforms": lambda b, t: b.lookup_transforms("map", "base", [t, t])[0].tolist(),
    "lookup_matrix": lambda b, t: b.lookup_matrix("map", "base", t).tolist(),
    "lookup_matrices": lambda b, t: b.lookup_matrices("map", "base", [t, t]).tolist(),
    "target_time": lambda b, t: (
        b.lookup_transforms("map", "base", [1], fixed_frame="map", target_time=t, on_missing="nan")[0].shape
    ),
    "transform_points": lambda b, t: b.transform_points([[1.0, 0, 0]], [t], "map", "base").tolist(),
    "transform_full": lambda b, t: b.transform_full(point(), "map", t, "map"),
    "lookupVelocityCore": lambda b, t: b.lookupVelocityCore("base", "map", t, Duration(seconds=0.1)),
    "_chain": lambda b, t: b._chain("map", t, "base", t, "map"),
    "_allFramesAsDot": lambda b, t: b._allFramesAsDot(t),
    "Stamped": lambda b, t: stamp_ns(tf2_geometry_msgs.tf2_ros.Stamped(SimpleNamespace(), t, "map")),
}
every_lookup = pytest.mark.parametrize("call", LOOKUPS.values(), ids=LOOKUPS)
every_call = pytest.mark.parametrize("call", [*LOOKUPS.values(), *OTHERS.values()], ids=[*LOOKUPS, *OTHERS])


def point():
    message = PointStamped()
    message.header.frame_id = "base"
    message.header.stamp = at(1.5).to_msg()
    return message


async def awaiting(buffer):
    return await buffer.lookup_transform_async("map", "base", Time(), timeout=5 * 10**9)


class TestTimes:
    @every_call
    def test_every_call_takes_integers_and_datetimes(self, buffer, call):
        for moment in (HALF, np.datetime64(1500, "ms")):
            assert call(buffer, moment) == call(buffer, at(1.5))

    @every_call
    def test_a_float_is_refused_with_what_to_use(self, buffer, call):
        with pytest.raises(TypeError, match=f"float.*{ADVICE}|^times: "):
            call(buffer, 1.5)

    @every_lookup
    def test_a_duration_is_refused_with_what_to_use(self, buffer, call):
        for duration in (Duration(seconds=1.5), Duration(seconds=1.5).to_msg(), timedelta(seconds=1.5)):
            kind = "timedelta" if isinstance(duration, timedelta) else "a Duration"
            with pytest.raises(TypeError, match=rf"time: expected a time, got {kind}: {ADVICE}") as error:
                call(buffer, duration)
            # Where a timeout follows the time, and not a frame.
            ends_with_timeout = str(error.value).endswith("the latest. Pass a timeout as timeout=")
            assert ends_with_timeout == str(error.value).startswith("time: ")

    def test_a_duration_of_zero_is_the_latest_time(self, buffer):
        # Programs for tf2 ask for the latest time like this, too.
        for zero in (Duration(), Duration().to_msg()):
            assert stamp_ns(buffer.lookup_transform("map", "base", zero)) == 2 * 10**9

    def test_a_time_in_the_wrong_unit_is_suspected(self, buffer, tf2_py):
        buffer.set_transform(transform("map", "robot", 1_795_000_000), "me")
        asked = "The requested time is in 1970: is it in the wrong unit"
        with pytest.raises(tf2_py.ExtrapolationException, match=asked):
            buffer.lookup_transform("map", "robot", 1_795_000_000)
        with pytest.raises(tf2_py.ExtrapolationException) as plausible:
            buffer.lookup_transform("map", "robot", Time(seconds=1_794_000_000))
        assert "1970" not in str(plausible.value)
        buffer.set_transform(transform("map", "simulated", 5), "me")
        with pytest.raises(tf2_py.ExtrapolationException, match="The sample is from 1970: is it in sim"):
            buffer.lookup_transform("map", "simulated", Time(seconds=1_794_000_000))
        buffer.set_transform(transform("map", "unset", 0), "me")
        with pytest.raises(tf2_py.ExtrapolationException, match=r"years too old\. Its stamp is 0: was it n"):
            buffer.lookup_transform("map", "unset", Time(seconds=1_794_000_000))

    @pytest.mark.parametrize("way", ["can_transform", "with a timeout", "future", "before the data"])
    def test_a_time_in_the_wrong_unit_is_logged_for_those_who_see_no_error(self, buffer, capfd, way):
        seconds = 1_795_000_000
        if way != "before the data":
            buffer.set_transform(transform("map", "robot", seconds), "me")
        if way == "can_transform":
            assert not buffer.can_transform("map", "robot", seconds)
        elif way == "with a timeout":
            assert not buffer.can_transform("map", "robot", seconds, 0.001)
        else:
            waiting = buffer.wait_for_transform_async("map", "robot", seconds)
            assert not waiting.done()
        buffer.set_transform(transform("map", "robot", seconds + 1), "me")
        line = (
            "A lookup at 1.795000000 s has no answer. The requested time is in 1970: is it in the wrong unit"
        )
        until(lambda: line in errors_so_far())

    @pytest.mark.parametrize("simulated", [False, True])
    def test_a_time_ahead_of_the_clock_of_the_buffer_is_called_so(self, tf2_ros, tf2_py, node, simulated):
        if simulated:
            simulate(node, seconds=100)
        buffer = tf2_ros.Buffer(node=node if simulated else None)
        now_ns = 100 * 10**9 if simulated else time.time_ns()
        for ago_ns in (2, 1):
            buffer.set_transform(transform("map", "robot", ns=now_ns - ago_ns), "me")

        def error(time_ns, **options):
            with pytest.raises(tf2_py.ExtrapolationException) as caught:
                buffer.lookup_transform("map", "robot", time_ns, **options)
            return str(caught.value)

        said = r"too old; the requested time is (\d+)\.\d{9} s ahead of the clock of the buffer"
        for options in ({}, {"timeout": 0.01}, {"tolerance": 1}):
            ahead = re.search(said, error(now_ns + 3600 * 10**9, **options))
            assert 3500 < int(ahead[1]) <= 3600
        assert "ahead" not in error(now_ns) + error(1)
        buffer.clock = None
        assert "ahead" not in error(now_ns + 3600 * 10**9)


class TestTimeouts:
    @every_lookup
    def test_a_number_is_seconds(self, buffer, call):
        for timeout in (86400, math.inf, 0, -1.0):
            assert call(buffer, at(1.5), timeout=timeout) == call(buffer, at(1.5))
        for timeout, least in ((0.05, 0.05), (0.0, 0), (-math.inf, 0)):
            seconds, error = seconds_of(lambda timeout=timeout: call(buffer, at(9), timeout=timeout))
            assert least <= seconds < PROMPT_S
            assert error is None or type(error).__name__ in ("ExtrapolationException", "TimeoutException")

    def test_objects_are_transformed_within_seconds(self, buffer):
        assert buffer.transform(point(), "map", 1.0).point.x == 1.5
        assert buffer.transform_full(point(), "map", HALF, "map", 1).point.x == 1.5
        assert asyncio.run(buffer.transform_async(point(), "map", math.inf)).point.x == 1.5

    @every_lookup
    def test_what_is_none_is_refused(self, buffer, call):
        for wrong in (math.nan, Time()):
            with pytest.raises((TypeError, ValueError), match="^timeout"):
                call(buffer, at(1.5), timeout=wrong)

    def test_years_warn_that_a_number_is_seconds(self, buffer, recwarn):
        with pytest.warns(
            UserWarning,
            match="^timeout=5000000000 means 158 years: numbers are seconds. For nanosec",
        ):
            assert buffer.can_transform("map", "base", Time(), timeout=5_000_000_000)
        for timeout in (10**7, 1e9, math.inf, 2**63, Duration(seconds=10**9)):
            assert buffer.can_transform("map", "base", Time(), timeout=timeout)
        assert not recwarn.list


DURATIONS = {
    "cache_time": lambda tf, b, n, wrong: tf.Buffer(cache_time=wrong),
    "averaging_interval": lambda tf, b, n, wrong: b.lookupVelocityCore("base", "map", at(1.5), wrong),
    "timeout": lambda tf, b, n, wrong: b.lookup_transform("map", "base", at(1.5), timeout=wrong),
    "tolerance": lambda tf, b, n, wrong: tf.MessageFilter(None, b, "map", 0, node=n, tolerance=wrong),
    "buffer_timeout": lambda tf, b, n, wrong: tf.MessageFilter(
        None, b, "map", 0, node=n, buffer_timeout=wrong
    ),
}


@pytest.mark.parametrize("argument", DURATIONS)
def test_every_duration_is_given_in_the_same_ways(tf2_ros, buffer, node, argument):
    for right in (Duration(seconds=1), Duration(seconds=1).to_msg(), timedelta(seconds=1), 1, 1.0):
        DURATIONS[argument](tf2_ros, buffer, node, right)
    for wrong in (Time(seconds=10), True, "10"):
        with pytest.raises(TypeError, match=rf"^{argument}: .*: use Duration\(seconds=\.\.\.\)$"):
            DURATIONS[argument](tf2_ros, buffer, node, wrong)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda b: b.set_transform(transform("a", "b", 1), b"me"), "authority: expected a str, got bytes$"),
        (lambda b: b.set_transform(transform("a", "b", 1)), "authority is missing"),
        (lambda b: b.set_transform_static(transform("a", "b", 1)), "authority is missing"),
        (lambda b: b.set_transforms([transform("a", "b", 1)]), "authority is missing"),
        (lambda b: b.set_transforms_cdr(b""), "authority is missing"),
        (lambda b: b.set_transform(TransformStamped, "me"), "expected .*, got the class TransformStamped: "),
        (lambda b: b.lookup_transform(at(1), "map", "base"), "target_frame: expected .*, got Time"),
        (lambda b: b.lookup_transform("map", at(1), "base"), "source_frame: expected .*, got Time"),
        (
            lambda b: b.lookup_transform_full("map", at(1), "base", at(1), 5),
            "fixed_frame: expected a str, got int",
        ),
        (
            lambda b: b.transform_points("map", "base", [[1.0, 0, 0]], [1]),
            "points: .*, got str: the frames follow points and times$",
        ),
        (lambda b: b.transform_points([[1.0, 0, 0]], "map", "base", [1]), "times: .*, got str$"),
    ],
)
def test_an_argument_of_the_wrong_type_is_called_by_its_name(buffer, call, text):
    with pytest.raises(TypeError, match=f"^{text}"):
        call(buffer)


# Each needs the code in C of a buffer; called with another object, that ends the process.
@pytest.mark.parametrize(
    "use",
    [
        lambda ros, mock, node: ros.MessageFilter(None, mock, "map", 10, node=node),
        lambda ros, mock, node: ros.BufferServer(mock, node, "lookup"),
        lambda ros, mock, node: tf2_sensor_msgs.deskew(PointCloud2(), mock, "map"),
        lambda ros, mock, node: tf2_ros.correction.correct(mock, "map", "odom", "base", [1], [np.eye(4)]),
    ],
    ids=["MessageFilter", "BufferServer", "deskew", "correct"],
)
def test_a_mock_that_passes_for_a_buffer_is_refused(tf2_ros, node, use):
    with pytest.raises(TypeError, match=r"^buffer: expected a .*, got \w*Mock$"):
        use(tf2_ros, MagicMock(spec=tf2_ros.Buffer), node)


# Where tf2 raises an AttributeError, what is raised is one, too.
either_kind = pytest.mark.parametrize("kind", [TypeError, AttributeError])


@either_kind
@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda tf, b: tf.TransformBroadcaster(b), "create_publisher, got Buffer"),
        (lambda tf, b: tf.StaticTransformBroadcaster(None), "create_publisher, got NoneType"),
        (lambda tf, b: tf.TransformListener(b, 10), "create_subscription, got int"),
        (lambda tf, b: tf.TransformListener(None, b), "create_subscription, got Buffer"),
        (lambda tf, b: tf.BufferClient("server", b), "create_client, got str"),
        (lambda tf, b: tf.BufferServer(b, "server", b), "create_service, got str"),
        (lambda tf, b: tf.MessageFilter(None, b, "map", 1, node=b), "create_subscription, got Buffer"),
    ],
)
def test_something_else_as_a_node(tf2_ros, buffer, call, text, kind):
    with pytest.raises(kind, match=rf"^\w+: expected a node with {text}$"):
        call(tf2_ros, buffer)


@either_kind
@pytest.mark.parametrize(
    ("call", "first"),
    [
        (lambda tf, b, n: tf.TransformListener(n, b), "the buffer first, then the node"),
        (lambda tf, b, n: tf.StaticTransformListener(n, b), "the buffer first, then the node"),
        (lambda tf, b, n: tf.TransformListener(n, 10), "the buffer first, then the node"),
        (lambda tf, b, n: tf.BufferServer(n, b, "server"), "the buffer first, then the node"),
        (lambda tf, b, n: tf.BufferClient("server", n), "the node first, then the name"),
    ],
)
def test_a_swapped_node_is_told_where_it_belongs(tf2_ros, buffer, node, call, first, kind):
    with pytest.raises(kind, match=rf"^\w+: expected a node with create_\w+, got \w+; pass {first}$"):
        call(tf2_ros, buffer, node)


@either_kind
@pytest.mark.parametrize("name", ["TransformListener", "StaticTransformListener"])
@pytest.mark.parametrize("has_node", [True, False])
def test_a_listener_refuses_what_it_cannot_fill(tf2_ros, node, name, has_node, kind):
    count = len(list(node.subscriptions))
    for wrong, text in (
        (tf2_ros.Buffer, "the class Buffer"),
        (None, "NoneType"),
        ("map", "str"),
        (node, "Node; pass the buffer first, then the node"),
    ):
        with pytest.raises(kind, match=rf"^{name}: expected a buffer with set_transform, got {text}$"):
            getattr(tf2_ros, name)(wrong, node if has_node else None)
    assert len(list(node.subscriptions)) == count


@either_kind
@pytest.mark.parametrize("name", ["TransformBroadcaster", "StaticTransformBroadcaster"])
@pytest.mark.parametrize("strict", [False, True])
def test_a_broadcaster_sends_only_transforms(tf2_ros, node, name, strict, kind):
    broadcaster = getattr(tf2_ros, name)(node, strict=strict)
    for wrong in (None, 5, "map", Transform(), [Transform()], TransformStamped):
        with pytest.raises(
            kind, match=r"^sendTransform: expected a TransformStamped, or several, got [\w ]+$"
        ):
            broadcaster.sendTransform(wrong)
    if name.startswith("Static"):
        assert broadcaster.net_message.transforms == []


async def awaits(*_):
    """Nobody would await this."""


class Awaits:
    async def __call__(self, *_):
        """Nobody would await this."""


def test_what_nobody_would_await_is_refused(buffer):
    for wrong in (awaits, Awaits()):
        with pytest.raises(TypeError, match="^on_change: .* got an async one"):
            buffer.on_change("map", "base", wrong)
        with pytest.raises(TypeError, match="^add_source: .* got an async one"):
            buffer.add_source("this test", wrong)


def test_a_filter_refuses_wrong_inputs_callbacks_and_messages(tf2_ros, node, buffer):
    expected = "input: expected (message type, topic, qos), in this order, and a type with a header"
    with pytest.raises(
        TypeError, match=rf"^{re.escape(expected)}, got \('points', <class .*PointStamped'>, 10\)$"
    ):
        tf2_ros.MessageFilter(("points", PointStamped, 10), buffer, "map", 10, node=node)
    with tf2_ros.MessageFilter(None, buffer, "map", 10, node=node) as points:
        for register in ("registerCallback", "registerFailureCallback"):
            with pytest.raises(TypeError, match=f"^{register}: expected a function, got str$"):
                getattr(points, register)("callback")
            for wrong in (awaits, functools.partial(awaits, 1), Awaits(), Awaits().__call__):
                with pytest.raises(TypeError, match=f"^{register}: .* ordinary function, got an async one"):
                    getattr(points, register)(wrong)
        assert points.callbacks == {}
        with pytest.raises(TypeError, match="^message: expected a header .*, got the class PointStamped"):
            points.add(PointStamped)
        with pytest.raises(TypeError, match="^message: .*, got Wrench; WrenchStamped has one$"):
            points.add(Wrench())
    with pytest.raises(TypeError, match=rf"^{re.escape(expected)}, got .*; PoseStamped has one$"):
        tf2_ros.MessageFilter((Pose, "poses", 10), buffer, "map", 10, node=node)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        *(
            (
                lambda wrong=wrong: tf2_geometry_msgs.do_transform_point(TransformStamped(), wrong),
                "got .*; pass the message first, then the transform",
            )
            for wrong in (PointStamped(), None, TransformStamped)
        ),
        (
            lambda: tf2_geometry_msgs.do_transform_pose(PoseStamped(), TransformStamped()),
            "got PoseStamped: .*; use the function whose name ends in _stamped",
        ),
        (
            lambda: tf2_geometry_msgs.do_transform_point(PointStamped, TransformStamped()),
            "got a class: .*; pass a message, not its class",
        ),
    ],
)
def test_a_function_for_messages_says_what_to_pass_instead(call, text):
    with pytest.raises(AttributeError, match=f"{text}$"):
        call()


def test_a_node_in_the_place_of_the_cache_time(tf2_ros, node):
    with pytest.raises(
        TypeError, match=r"^Buffer: cache_time comes first: pass the node as Buffer\(node=node\)$"
    ):
        tf2_ros.Buffer(node)


@either_kind
@pytest.mark.parametrize(
    ("message", "stamped", "function"),
    [
        (Pose(), "PoseStamped", "do_transform_pose"),
        (Wrench(), "WrenchStamped", "do_transform_wrench"),
        (Vector3(), "Vector3Stamped", "do_transform_vector3"),
        (Point32(), None, "do_transform_point"),
    ],
    ids=lambda one: type(one).__name__,
)
def test_an_object_without_a_header(buffer, kind, message, stamped, function):
    """The error names what transforms it."""
    put = f"put it into a {stamped}, or " if stamped else ""
    text = (
        f"object_stamped: expected an object with a header, got {type(message).__name__}: {put}"
        f"call tf2_geometry_msgs.{function} with a transform"
    )
    with pytest.raises(kind, match=f"^{re.escape(text)}$"):
        buffer.transform(message, "map")
    with pytest.raises(kind, match=f"^{re.escape(text)}$"):
        buffer.transform_full(message, "map", at(1), "map")
    with pytest.raises(kind, match=f"^{re.escape(text)}$"):
        buffer.transform_async(message, "map").send(None)
    assert callable(getattr(tf2_geometry_msgs, function))


@either_kind
def test_an_object_of_a_program_without_a_header(buffer, kind):
    class Height:
        pass

    buffer.registration.add(Height, lambda height, transform: height)
    with pytest.raises(kind, match="^object_stamped: expected an object with a header, got Height$"):
        buffer.transform(Height(), "map")


def test_a_listener_with_its_own_callback_needs_no_buffer(tf2_ros, node):
    class Printing(tf2_ros.TransformListener):
        def callback(self, data):
            print(self.buffer, data)

    for anything in (None, node, "no buffer"):
        assert Printing(anything, node).node is node


# What takes a bool. Others that count as true, such as "no" and NaN, would do what their text does not say.

CLOUD = PointCloud2(
    height=1,
    width=1,
    point_step=12,
    row_step=12,
    data=bytes(12),
    fields=[PointField(name=name, offset=4 * i, datatype=7, count=1) for i, name in enumerate("xyz")],
)


def with_filter(buffer, node, value):
    with tf2_ros.MessageFilter(None, buffer, "map", 10, node=node) as points:
        points.registerFailureCallback(print, with_text=value)


def with_listener(buffer, node, value):
    tf2_ros.TransformListener(buffer, node, static_only=value).unregister()


ONE = transform("map", "base", 3)
BOOLS = {  # by class or module, function and parameter
    "Buffer.set_transform replace": lambda b, _, v: b.set_transform(ONE, "x", replace=v),
    "Buffer.set_transforms static": lambda b, _, v: b.set_transforms([transform("a", "b")], "x", v),
    "Buffer.set_transforms replace": lambda b, _, v: b.set_transforms([ONE], "x", replace=v),
    "Buffer.set_transforms_cdr static": lambda b, _, v: b.set_transforms_cdr(
        serialize_transforms([transform("c", "d")]), "x", v
    ),
    "LookupPolicy extrapolate": lambda b, _, v: b.lookup_transform(
        "map", "base", at(5), tolerance=9, extrapolate=v
    ),
    "MessageSource static": lambda _b, _n, v: MessageSource("/tf", v),
    "propagate lever_arm": lambda _b, _n, v: propagate(np.eye(6), ([[0, 0, 0]], [[0, 0, 0, 1]]), lever_arm=v),
    "do_transform_cloud only_xyz": lambda _b, _n, v: tf2_sensor_msgs.do_transform_cloud(
        CLOUD, ONE, only_xyz=v
    ),
    "MessageFilter.registerFailureCallback with_text": with_filter,
    "TransformListener static_only": with_listener,
    "TransformBroadcaster strict": lambda _, node, v: tf2_ros.TransformBroadcaster(node, strict=v),
    "StaticTransformBroadcaster strict": lambda _, node, v: tf2_ros.StaticTransformBroadcaster(
        node, strict=v
    ),
}
# Those of tf2 and of sensor_msgs_py, for which Python's truth counts, as there.
BOOLS_OF_OTHERS = {
    "Buffer.can_transform return_debug_tuple",
    "Buffer.can_transform_full return_debug_tuple",
    "BufferClient.can_transform return_debug_tuple",
    "BufferClient.can_transform_full return_debug_tuple",
    "BufferInterface.can_transform return_debug_tuple",
    "BufferInterface.can_transform_full return_debug_tuple",
    "StaticTransformListener spin_thread",
    "TransformListener spin_thread",
}
# What programs do not make, or do not call.
RESULTS = {"BufferSource", "FrameInfo", "History"}


@pytest.mark.parametrize("where", BOOLS)
@pytest.mark.parametrize(
    "wrong", ["no", "False", 0.0001, math.nan, 0, 1, [], np.array([True]), np.int8(1)], ids=repr
)
def test_a_bool_is_a_bool(node, buffer, where, wrong):
    name, before = where.split()[-1], buffer.statistics()
    with pytest.raises(TypeError, match=f"^{name}: expected a bool, got {type(wrong).__name__}$"):
        BOOLS[where](buffer, node, wrong)
    assert buffer.statistics() == before


@pytest.mark.parametrize("where", BOOLS)
@pytest.mark.parametrize("right", [False, True, np.False_, np.True_], ids=repr)
def test_a_bool_of_numpy_is_one_too(node, buffer, where, right):
    BOOLS[where](buffer, node, right)


def bools_of(name, function):
    try:
        parameters = inspect.signature(function).parameters.values()
    except (TypeError, ValueError):
        return set()
    return {f"{name} {one.name}" for one in parameters if one.annotation in (bool, "bool")}


def test_each_parameter_that_is_a_bool_is_tried():
    found = {"LookupPolicy extrapolate", "MessageSource static"}  # whose kinds are not in a signature
    for module in (tf2_ros, tf2_ros.numpy, tf2_ros.serialization, tf2_ros.correction, tf2_sensor_msgs):
        for name in {*dir(module), *vars(module)} - RESULTS:
            one = getattr(module, name)
            if name.startswith("_") or not (getattr(one, "__module__", None) or "").startswith("tf2_"):
                continue
            found |= bools_of(name, one)
            for method, function in inspect.getmembers(one, callable) if isinstance(one, type) else ():
                if not method.startswith("_"):
                    found |= bools_of(f"{name}.{method}", function)
    assert found == {*BOOLS, *BOOLS_OF_OTHERS, *(one for one in found if one.startswith("BufferCore."))}
