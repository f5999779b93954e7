"""
The calls that `reliability.leaks` repeats: at least one for each public name of this project.

A case is named `<group>.<method> <more>`. A group makes its cases from what it sets up on an ExitStack.
"""

import copy
import inspect
import itertools
import os
import pickle
import tempfile
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import NamedTuple

import numpy as np
import rclpy
from geometry_msgs.msg import PointStamped, PoseStamped
from known_types import ALL, TABLES
from making import S, at, at_ns, transform
from making_bags import drive, scan, write_mcap
from random_ends import RandomEnds, make_node
from random_messages import Maker
from rclpy.action import ActionClient, ActionServer
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from repeated_calls import actions, failures, fill, raising
from robots import ARM, SIMPLE, joint_state
from sensor_msgs.msg import PointCloud2, PointField
from sharing import new_name
from spinning import spun_node

import tf2_geometry_msgs
import tf2_ros
import tf2_ros.numpy
import tf2_ros.records
import tf2_ros_tools.bag
import tf2_sensor_msgs
from tf2_msgs.action import LookupTransform
from tf2_msgs.msg import TFMessage
from tf2_py import BufferCore
from tf2_ros import (
    Buffer,
    BufferClient,
    BufferInterface,
    BufferServer,
    ConvertRegistration,
    MessageFilter,
    StaticTransformBroadcaster,
    StaticTransformListener,
    TransformBroadcaster,
    TransformListener,
    TransformRegistration,
)

LONG_S = 20.0
# What has no case of its own, and why.
NO_CASE = {
    "tf2_ros_tools.bag.map_recordings": "works in processes of its own, which end with each recording",
    "BufferServer.check": "runs by itself while there is a server",
}
# What rclpy and Fast DDS themselves leave behind for each call; the cases "(for comparison)" show it.
OF_A_NODE = {"objects": 50, "heap_bytes": 150_000, "resident_bytes": 150_000}
OF_AN_ENTITY = {"objects": 6, "heap_bytes": 300, "resident_bytes": 1000}
# The same without the service that describes types; 3.4 kB of it for each name of a node that is new.
OF_A_SMALL_NODE = {"objects": 6, "heap_bytes": 4_000, "resident_bytes": 6_000}
OF_RANDOM_ENDS = {"objects": 30, "heap_bytes": 20_000, "resident_bytes": 60_000}
# Fast DDS keeps changes of the services in its histories: 80 to 260 bytes for each goal. rclpy's own client
# leaves 34 objects and 900 bytes.
OF_A_GOAL = {"heap_bytes": 500, "resident_bytes": 1500}
GOALS = [
    f"{how}{kind}{mode}"
    for how in ("lookup_transform", "can_transform", "transform")
    for kind in ("", "_full")
    for mode in ("", "_async", " of no time")
]
OF_RCLPY = {
    "Buffer.__init__ with a node": OF_A_NODE,
    "TransformListener.__del__": OF_A_NODE,
    "TransformListener.unregister": OF_AN_ENTITY,
    "TransformListener.unregister among others, in random order": OF_RANDOM_ENDS,
    "TransformBroadcaster.__init__": OF_AN_ENTITY,
    "StaticTransformBroadcaster.__init__": OF_AN_ENTITY,
    "MessageFilter.close": OF_AN_ENTITY,
    "BufferClient.destroy": OF_A_NODE,
    "BufferClient.destroy by its node": OF_A_SMALL_NODE,
    "BufferServer.destroy by its node": OF_A_SMALL_NODE,
    **{f"BufferClient.{name}": OF_A_GOAL for name in GOALS},
}
# How long it takes until what the calls of a group left on purpose is gone: a server keeps results for 10 s.
REST_S = {"BufferClient": 11.0}


class Group(NamedTuple):
    """What its cases are of, beyond what else that has, and what makes them."""

    subject: type | ModuleType
    beyond: type | None
    make: Callable[[ExitStack], dict[str, Callable[[], object]]]


GROUPS = {}


def group(subject, *, beyond=None, name=None):
    """Register a function that makes the cases of a class or module, `beyond` what another has, too."""

    def register(make):
        GROUPS[name or subject.__name__] = Group(subject, beyond, make)
        return make

    return register


def _public(subject, beyond):
    if inspect.isclass(subject):
        static = inspect.getattr_static  # class methods are bound anew each time
        found = [name for name in dir(subject) if not name.startswith("_")]
        return [n for n in found if beyond is None or static(subject, n) is not static(beyond, n, None)]
    listed = {*getattr(subject, "__all__", ()), *(n for n in vars(subject) if n.startswith("do_transform_"))}
    functions = [n for n in sorted(listed) if _is_ours(getattr(subject, n))]
    return [n for n in functions if not inspect.isclass(getattr(subject, n))]


def _is_ours(value):
    return callable(value) and (getattr(value, "__module__", None) or "").startswith("tf2_")


def names():
    """Of all cases."""
    found = []
    for title, group in GROUPS.items():
        with ExitStack() as stack:
            found += [f"{title}.{case}" for case in group.make(stack)]
    return found


def without_case(cases):
    """The public names that no case calls."""
    called = {case.partition(" ")[0] for case in cases}
    wanted = [
        f"{title}.{name}"
        for title, (subject, beyond, _) in GROUPS.items()
        for name in _public(subject, beyond)
    ]
    classes = [
        f"tf2_ros.{name}"
        for name, value in vars(tf2_ros).items()
        if inspect.isclass(value) and not name.startswith("_") and value.__module__.startswith("tf2_ros")
        if not issubclass(value, Exception) and value not in [subject for subject, _, _ in GROUPS.values()]
        if value.__name__ not in ("FilterFailureReason",)  # an enumeration
    ]
    return [name for name in wanted if name not in called and name not in NO_CASE] + classes


def action(case, stack):
    """What a case calls."""
    title = max((title for title in GROUPS if case.startswith(f"{title}.")), key=len)
    return GROUPS[title].make(stack)[case.removeprefix(f"{title}.")]


def _ros(stack):
    if not rclpy.ok():
        # Ctrl-C and SIGTERM shall end the search.
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        stack.callback(rclpy.try_shutdown)


def _node(stack, name="leaks"):
    _ros(stack)
    node = rclpy.create_node(name)
    stack.callback(node.destroy_node)
    return node


def _filled(buffer=None):
    buffer = Buffer() if buffer is None else buffer
    fill(buffer)
    return buffer


def _awaited(coroutine):
    # Of one that has nothing to wait for.
    try:
        coroutine.send(None)
    except StopIteration as done:
        return done.value
    raise AssertionError("it waits")


def _point(ns=S, frame="base"):
    message = PointStamped()
    message.header.frame_id = frame
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(ns, S)
    return message


def _temporary(stack):
    return Path(stack.enter_context(tempfile.TemporaryDirectory()))


@group(BufferCore)
def _core(stack):
    buffer = _filled(BufferCore())
    moving = BufferCore()
    message, stamps = transform("map", "odom"), itertools.count(S, S // 100)
    file = str(_temporary(stack) / "buffer.mcap")
    times = np.full(100, S)
    points = np.ones((100, 3))

    def advance():
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(next(stamps), S)
        moving.set_transform(message, "x")

    def clear():
        moving.clear()
        fill(moving)

    def forget():
        fill(moving)
        moving.forget("odom")

    def limited():
        limited = BufferCore(max_frames=3, max_bytes=10_000, max_waiters=1)
        fill(limited)
        limited.set_transforms([transform("map", f"f{i}", 1) for i in range(4)], "x")

    buffer.save(file)
    full = ("map", at(1), "base", at(1), "map")
    return {
        **actions(buffer),
        **failures(buffer),
        "set_transform of later and later stamps": advance,
        "set_transforms beyond limits": limited,
        "clear": clear,
        "cache_time_ns": lambda: buffer.cache_time_ns,
        "all_frames_as_string": buffer.all_frames_as_string,
        "can_transform_full_core": lambda: buffer.can_transform_full_core(*full),
        "frames": buffer.frames,
        "histories": buffer.histories,
        "tree": buffer.tree,
        "path": lambda: buffer.path("base", "map"),
        "parent": lambda: buffer.parent("base"),
        "parent of an unknown frame": raising(buffer.parent, "bse"),
        "children": lambda: buffer.children("map"),
        "forget": forget,
        "lookupVelocityFullCore": lambda: buffer.lookupVelocityFullCore(
            "base", "map", "map", (0.0, 0.0, 0.0), "map", at(1), Duration()
        ),
        "lookup_transforms": lambda: buffer.lookup_transforms("map", "base", times),
        "lookup_transforms with a policy": lambda: buffer.lookup_transforms(
            "map", "base", times + S, on_missing="nan", tolerance=9, extrapolate=True, interpolation="cubic"
        ),
        "lookup_transforms of two frames": lambda: buffer.lookup_transforms("map", ["base", "map"], times),
        "lookup_transforms of two frames and no time": raising(
            buffer.lookup_transforms, "map", ["base", "map"], times + S
        ),
        "lookup_transforms of no time": raising(buffer.lookup_transforms, "map", "base", times + S),
        "lookup_transforms with NaN": lambda: buffer.lookup_transforms(
            "map", "base", times + S, on_missing="nan"
        ),
        "lookup_velocities": lambda: buffer.lookup_velocities("base", "map", times, Duration()),
        "lookup_velocities of no time": raising(
            buffer.lookup_velocities, "base", "map", times + S, Duration()
        ),
        "transform_points": lambda: buffer.transform_points(points, times, "map", "base"),
        "save": lambda: buffer.save(file),
        "load": lambda: BufferCore.load(file),
        "load of no file": raising(BufferCore.load, os.devnull),
        "_allFramesAsDot": buffer._allFramesAsDot,
        "__getstate__": buffer.__getstate__,
        "__copy__ of copy": lambda: copy.deepcopy(buffer),
    }


@group(Buffer, beyond=BufferCore)
def _buffer(stack):
    buffer = _filled()
    jumping = _filled()
    _ros(stack)
    point = _point()
    stamps = itertools.count(2 * S, S // 100)

    simple, full = ("map", "base", at(1)), ("map", at(1), "base", at(1), "map")
    late = ("map", "base", at(9))
    _ = tf2_geometry_msgs  # registers the types

    def complete():
        # Waits, and an insert that completes them: one future with a callback, one without.
        ns = next(stamps)
        waits = [waited.wait_for_transform_async("map", "odom", at_ns(ns)) for _ in range(2)]
        waits[0].add_done_callback(lambda future: future.result())
        waited.set_transform(transform("map", "odom", ns=ns), "x")
        assert all(wait.done() for wait in waits)

    waited = _filled()

    def follow():
        seen = []
        subscription = waited.on_change("map", "odom", seen.append)
        for _ in range(3):
            waited.set_transform(transform("map", "odom", ns=next(stamps)), "x")
        subscription.cancel()

    def give_up():
        wait = waited.wait_for_transform_async("map", "odom", at_ns(1), tolerance=0)
        waited.set_transform(transform("map", "odom", ns=next(stamps)), "x")
        wait.cancel()

    def cancel():
        buffer.wait_for_transform_async(*late).cancel()

    def expire():
        wait = buffer.wait_for_transform_async(*late, timeout=1e-4)
        ended = threading.Event()
        wait.add_done_callback(lambda _: ended.set())
        assert ended.wait(LONG_S)
        wait.exception()

    def with_a_node():
        # The node's service keeps the buffer, as tf2's.
        other = rclpy.create_node("other")
        Buffer(node=other)
        other.destroy_node()

    def forget():
        fill(jumping)
        jumping.forget("odom")

    def jump():
        jumping.time_jump_callback(None)
        fill(jumping)

    return {
        "lookup_transform": lambda: buffer.lookup_transform(*simple),
        "lookup_transform that times out": raising(buffer.lookup_transform, *late, 1e-4),
        "lookup_transform_full": lambda: buffer.lookup_transform_full(*full),
        "can_transform": lambda: buffer.can_transform(*simple, 0.0, True),
        "can_transform that times out": lambda: buffer.can_transform(*late, 1e-4, True),
        "can_transform_full": lambda: buffer.can_transform_full(*full),
        "lookup_transform_async": lambda: _awaited(buffer.lookup_transform_async(*simple)),
        "lookup_transform_full_async": lambda: _awaited(buffer.lookup_transform_full_async(*full)),
        "wait_for_transform_async": complete,
        "wait_for_transform_async and cancel": cancel,
        "wait_for_transform_async with a policy": give_up,
        "lookup_transform with a policy": lambda: buffer.lookup_transform(*late, tolerance=9),
        "changes": lambda: _awaited(buffer.changes("map", "base").__anext__()),
        "on_change": follow,
        "wait_for_transform_async that times out": expire,
        "wait_for_transform_async and forget": lambda: buffer.wait_for_transform_async(*late),
        "wait_for_transform_full_async": lambda: buffer.wait_for_transform_full_async(*full).result(),
        "transform": lambda: buffer.transform(point, "map"),
        "transform_full": lambda: buffer.transform_full(point, "map", at(1), "map"),
        "transform_async": lambda: _awaited(buffer.transform_async(point, "map")),
        "time_jump_callback": jump,
        "forget": forget,
        "__init__": lambda: _filled(),
        "__init__ with a node": with_a_node,
        "__reduce__ of pickle": lambda: pickle.loads(pickle.dumps(buffer)),
    }


class _Interface(BufferInterface):
    def lookup_transform(self, target_frame, source_frame, time, timeout=None):
        return transform(target_frame, source_frame, 1)

    def lookup_transform_full(
        self, target_frame, target_time, source_frame, source_time, fixed, timeout=None
    ):
        return transform(target_frame, source_frame, 1)

    async def lookup_transform_async(self, target_frame, source_frame, time, *, timeout=None):
        return transform(target_frame, source_frame, 1)


@group(BufferInterface)
def _interface(stack):
    point, own, bare = _point(), _Interface(), BufferInterface()
    full = ("map", at(1), "base", at(1), "map")
    return {
        "transform": lambda: own.transform(point, "map"),
        "transform_full": lambda: own.transform_full(point, "map", at(1), "map"),
        "transform_async": lambda: _awaited(own.transform_async(point, "map")),
        "lookup_transform": raising(bare.lookup_transform, "map", "base", at(1)),
        "lookup_transform_full": raising(bare.lookup_transform_full, *full),
        "lookup_transform_async": raising(
            lambda: _awaited(bare.lookup_transform_async("map", "base", at(1)))
        ),
        "can_transform": raising(bare.can_transform, "map", "base", at(1)),
        "can_transform_full": raising(bare.can_transform_full, *full),
    }


@group(TransformListener)
def _listener(stack):
    node, buffer = _node(stack), Buffer()
    # Each action is made before it is known which one is wanted, so these are made at the first call.
    stamps = itertools.count(S, S // 100)
    message = TFMessage(transforms=[transform("map", "odom", 1)])

    def made(cls=TransformListener):
        cls(buffer, node).unregister()

    def made_with_thread():
        # Otherwise the thread spins the program's node also after the listener's end, as tf2's does.
        with TransformListener(buffer, node, spin_thread=True):
            pass

    def forgotten():
        # The node's subscriptions keep the listener, as tf2's.
        other = rclpy.create_node("forgotten")
        TransformListener(buffer, other)
        other.destroy_node()

    seeds = itertools.count()

    def in_random_order():
        ends = RandomEnds(next(seeds))
        ends.play(40)
        left = ends.left()
        deadline_s = time.monotonic() + LONG_S
        while left and time.monotonic() < deadline_s:  # the threads of the last ones may be ending
            time.sleep(0.01)
            left = ends.left()
        assert not left, left

    def rclpy_alone():
        for topic in ("/tf", "/tf_static"):
            node.destroy_subscription(node.create_subscription(TFMessage, topic, print, 10))

    @_once
    def listening():
        listener = stack.enter_context(TransformListener(buffer, node))
        return listener, TransformBroadcaster(_node(stack, "sending"))

    def receive():
        _, broadcaster = listening()
        ns = next(stamps)
        # Until it has been discovered, what is sent is lost.
        for _ in range(int(LONG_S / 0.2)):
            broadcaster.sendTransform(transform("map", "odom", ns=ns))
            if buffer.can_transform("map", "odom", at_ns(ns), 0.2):
                return
        raise AssertionError("nothing was received")

    return {
        "unregister": made,
        "unregister with spin_thread": made_with_thread,
        "unregister among others, in random order": in_random_order,
        "unregister of static ones": partial(made, StaticTransformListener),
        "__del__": forgotten,
        "buffer": lambda: setattr(listening()[0], "buffer", buffer),
        "callback": lambda: listening()[0].callback(message),
        "callback of a received message": receive,
        "static_callback": lambda: listening()[0].static_callback(message),
        "receives": lambda: listening()[0].receives,
        "tf_sub": lambda: listening()[0].tf_sub,
        "tf_static_sub": lambda: listening()[0].tf_static_sub,
        "(for comparison) subscriptions of rclpy": rclpy_alone,
        "(for comparison) nodes of rclpy": lambda: rclpy.create_node("other").destroy_node(),
        "(for comparison) nodes of rclpy without the description of types": lambda: (
            make_node().destroy_node()
        ),
    }


def _once(make):
    """Call it once, and return the same object from then on."""
    made = []

    def get():
        if not made:
            made.append(make())
        return made[0]

    return get


@group(StaticTransformListener, beyond=TransformListener)
def _static_listener(stack):
    return {}


@group(TransformBroadcaster)
def _broadcaster(stack):
    node = _node(stack)
    message = transform("map", "odom", 1)
    broadcaster = _once(lambda: TransformBroadcaster(node))

    def made():
        node.destroy_publisher(TransformBroadcaster(node).pub_tf)

    return {
        "sendTransform": lambda: broadcaster().sendTransform(message),
        "sendTransform of several": lambda: broadcaster().sendTransform([message, message]),
        "__init__": made,
        "(for comparison) publishers of rclpy": lambda: node.destroy_publisher(
            node.create_publisher(TFMessage, "/tf", 100)
        ),
    }


@group(StaticTransformBroadcaster)
def _static_broadcaster(stack):
    node = _node(stack)
    broadcaster = _once(lambda: StaticTransformBroadcaster(node))

    def made():
        node.destroy_publisher(StaticTransformBroadcaster(node).pub_tf)

    return {
        "sendTransform": lambda: broadcaster().sendTransform(transform("map", "odom", 1)),
        "__init__": made,
    }


@group(MessageFilter)
def _filter(stack):
    node, buffer = _node(stack), _filled()
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    stack.callback(executor.shutdown)
    topic = (PointStamped, "/points", 10)
    passed = []

    def new(source=None, **options):
        return MessageFilter(source, buffer, "map", 5, node=node, **options)

    @_once
    def filtering():
        filtering = stack.enter_context(new())
        filtering.registerCallback(passed.append)
        filtering.registerFailureCallback(lambda message, reason: passed.append(message))
        return filtering

    def pass_on():
        passed.clear()
        filtering().add(_point())
        while not passed:
            executor.spin_once(LONG_S)

    def drop():
        # The sixth one drops the first.
        filtering().add(_point(9 * S))
        executor.spin_once(0)
        passed.clear()

    def clear():
        filtering().add(_point(9 * S))
        filtering().clear()

    def with_callbacks():
        with new() as filtering:
            filtering.registerCallback(print)
            filtering.registerFailureCallback(print)
            filtering.add(_point(9 * S))

    def connect():
        with new() as first, new() as second:
            second.connectInput(first)
            first.add(_point(9 * S))

    return {
        "add": pass_on,
        "add beyond queue_size": drop,
        "clear": clear,
        "close": lambda: new(topic).close(),
        "close without a topic": lambda: new().close(),
        "connectInput": connect,
        "registerCallback": with_callbacks,
        "registerFailureCallback": with_callbacks,
        "setQueueSize": lambda: filtering().setQueueSize(3),
        "setTargetFrames": lambda: filtering().setTargetFrames(["map", "odom"]),
        "setTolerance": lambda: filtering().setTolerance(Duration()),
        "statistics": lambda: filtering().statistics(),
    }


@group(BufferClient)
def _client(stack):
    @_once
    def client():
        server = stack.enter_context(spun_node("answering"))
        stack.callback(BufferServer(_filled(), server, "lookup").destroy)
        asking = stack.enter_context(spun_node("asking"))
        client = BufferClient(asking, "lookup")
        stack.callback(client.destroy)
        assert client.action_client.wait_for_server(LONG_S)
        return client

    @_once
    def lonely():
        return stack.enter_context(spun_node("lonely"))

    @_once
    def plain_client():
        server = stack.enter_context(spun_node("executing"))

        def execute(goal):
            goal.succeed()
            return LookupTransform.Result()

        stack.callback(ActionServer(server, LookupTransform, "plain", execute).destroy)
        client = ActionClient(stack.enter_context(spun_node("sending")), LookupTransform, "plain")
        stack.callback(client.destroy)
        assert client.wait_for_server(LONG_S)
        return client

    def rclpy_alone():
        ended = threading.Event()

        def accepted(future):
            future.result().get_result_async().add_done_callback(lambda _: ended.set())

        plain_client().send_goal_async(LookupTransform.Goal()).add_done_callback(accepted)
        assert ended.wait(LONG_S)

    def by_its_node():
        _ros(stack)
        node = make_node()
        BufferClient(node, "nowhere")
        node.destroy_node()

    simple, full = ("map", "base", at(1), LONG_S), ("map", at(1), "base", at(1), "map", LONG_S)
    point = _point()

    def awaited(make):
        # By the executor of its node, as a program's coroutine would be.
        task = client().node.executor.create_task(make())
        ended = threading.Event()
        task.add_done_callback(lambda _: ended.set())
        assert ended.wait(LONG_S)
        return task.result()

    return {
        "lookup_transform": lambda: client().lookup_transform(*simple),
        "lookup_transform of no time": lambda: raising(client().lookup_transform, "map", "base", at(9))(),
        "lookup_transform_full": lambda: client().lookup_transform_full(*full),
        "can_transform": lambda: client().can_transform(*simple),
        "can_transform_full": lambda: client().can_transform_full(*full),
        "lookup_transform_async": lambda: awaited(
            lambda: client().lookup_transform_async("map", "base", at(1))
        ),
        "lookup_transform_full_async": lambda: awaited(
            lambda: client().lookup_transform_full_async(*full[:-1])
        ),
        "transform": lambda: client().transform(point, "map", LONG_S),
        "transform_full": lambda: client().transform_full(point, "map", at(1), "map", LONG_S),
        "transform_async": lambda: awaited(lambda: client().transform_async(point, "map")),
        "destroy": lambda: BufferClient(lonely(), "nowhere").destroy(),
        "destroy by its node": by_its_node,
        "(for comparison) goals of rclpy": rclpy_alone,
    }


@group(BufferServer)
def _server(stack):
    node = _node(stack)
    buffer = Buffer()

    def by_its_node():
        other = make_node()
        BufferServer(buffer, other, "other_lookup")
        other.destroy_node()

    return {
        "destroy": lambda: BufferServer(buffer, node, "lookup").destroy(),
        "destroy by its node": by_its_node,
    }


@group(Buffer, beyond=Buffer, name="sharing")
def _sharing(stack):
    @_once
    def shared():
        owner = _filled(Buffer(share=new_name()))
        stack.callback(owner._tf2_sharing.close)
        return owner

    @_once
    def attached():
        return Buffer(attach=shared()._tf2_sharing.name)

    stamps = itertools.count(2 * S, S // 100)

    def share():
        owner = _filled(Buffer(share=new_name()))
        owner._tf2_sharing.close()

    def attach():
        reader = Buffer(attach=shared()._tf2_sharing.name)
        reader.lookup_transform("map", "base", at(1))

    def end():
        reader = Buffer(attach=shared()._tf2_sharing.name)
        reader.set_transform(transform("map", "own", 1), "x")
        reader._tf2_sharing.close()

    def insert():
        ns = next(stamps)
        shared().set_transform(transform("map", "odom", ns=ns), "x")
        attached().lookup_transform("map", "odom", at_ns(ns))

    def wait():
        ns = next(stamps)
        waiting = attached().wait_for_transform_async("map", "odom", at_ns(ns))
        ended = threading.Event()
        waiting.add_done_callback(lambda _: ended.set())
        shared().set_transform(transform("map", "odom", ns=ns), "x")
        assert ended.wait(LONG_S)

    return {
        "share and close": share,
        "attach": attach,
        "attach and end": end,
        "attach to no buffer": raising(lambda: Buffer(attach="nowhere")),
        "insert and look up": insert,
        "wait": wait,
    }


@group(tf2_ros)
def _functions(stack):
    pose = PoseStamped()
    return {
        "Stamped": lambda: tf2_ros.Stamped(PointStamped(), at(1), "map"),
        "convert": lambda: tf2_ros.convert(pose, PoseStamped),
        "format_transform": lambda: tf2_ros.format_transform(transform("map", "odom", 1)),
    }


class _Own:
    pass


@group(TransformRegistration)
def _transform_registration(stack):
    return {
        "add": lambda: TransformRegistration().add(_Own, print),
        "get": lambda: TransformRegistration().get(PointStamped),
        "get of no type": raising(lambda: TransformRegistration().get(type("New", (), {}))),
        "print_me": lambda: TransformRegistration().print_me(),
    }


@group(ConvertRegistration)
def _convert_registration(stack):
    functions = ConvertRegistration()
    return {
        "add_from_msg": lambda: functions.add_from_msg(_Own, print),
        "add_to_msg": lambda: functions.add_to_msg(_Own, print),
        "add_convert": lambda: functions.add_convert((_Own, PointStamped), print),
        "get_from_msg": lambda: functions.get_from_msg(PointStamped),
        "get_to_msg": lambda: functions.get_to_msg(PointStamped),
        "get_convert": raising(functions.get_convert, (PointStamped, PoseStamped)),
    }


@group(tf2_ros.numpy)
def _numpy(stack):
    functions = tf2_ros.numpy
    t = transform("map", "base", 1, (1, 2, 3))
    matrix = functions.to_matrix(t)
    rotation = functions.to_rotation(t)
    return {
        "propagate": lambda: functions.propagate(np.eye(6), t),
        "to_matrix": lambda: functions.to_matrix(t),
        "to_matrix of no message": raising(functions.to_matrix, 3),
        "from_matrix": lambda: functions.from_matrix(matrix, PoseStamped),
        "to_arrays": lambda: functions.to_arrays([t, t]),
        "to_columns": lambda: functions.to_columns([t, t]),
        "to_nanoseconds": lambda: functions.to_nanoseconds([1, t.header.stamp]),
        "to_rotation": lambda: functions.to_rotation(t),
        "from_rotation": lambda: functions.from_rotation(rotation),
    }


@group(tf2_ros.records)
def _of_records(stack):
    buffer, recording = BufferCore(), tf2_ros.records.Recording(2)
    sources = [tf2_ros.records.MessageSource("/tf", prefix="robot/")]
    data = serialize_message(TFMessage(transforms=[transform("map", "base_link", 1)]))
    messages = [("/tf", 1, data), ("/tf", 2, b"malformed"), ("/tf", 3, data), ("/tf", 4, data)]

    def insert(**how):
        tf2_ros.records.insert_messages(buffer, messages, sources, on_malformed=ignore, **how)

    def ignore(*_):
        pass

    def insert_and_record():
        insert(recording=recording, records=[])
        recording.take()

    return {
        "insert_messages": insert,
        "insert_messages into records": insert_and_record,
        "read_transforms": lambda: tf2_ros.records.read_transforms(data, sources[0]),
        "refusal_text": lambda: tf2_ros.records.refusal_text(5),
    }


@group(tf2_ros_tools.bag)
def _bag(stack):
    folder = _temporary(stack)
    path, broken = folder / "drive.mcap", folder / "broken.mcap"
    write_mcap(path, [*drive(20), scan(101 * S, 101 * S), joint_state(101 * S, SIMPLE, [0.1, 0.2, 0.3])])
    broken.write_bytes(path.read_bytes()[:-500])
    return {
        "load": lambda: tf2_ros_tools.bag.load(path),
        "load of a broken file": raising(tf2_ros_tools.bag.load, broken),
        "load with a URDF": lambda: tf2_ros_tools.bag.load(path, urdf=ARM),
        "dataset": lambda: tf2_ros_tools.bag.dataset(path, ["camera"], at="/scan", relative_to="map")[0],
        "stamps": lambda: tf2_ros_tools.bag.stamps(path, "/scan"),
        "transforms": lambda: list(tf2_ros_tools.bag.transforms(path)),
        "transforms not read to the end": lambda: next(iter(tf2_ros_tools.bag.transforms(path))),
    }


def _cloud():
    fields = [
        PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
        for i, name in enumerate("xyz")
    ]
    data = np.ones((50, 3), np.float32).tobytes()
    return PointCloud2(
        height=1, width=50, point_step=12, row_step=600, is_dense=True, fields=fields, data=data
    )


def _applied(package):
    t = transform("map", "base", 7.25, (1, 2, 3), (0.1, 0.2, 0.3, 0.9))
    cases = {}
    for cls, function in TABLES[package].items():
        message = Maker(5).message(cls) if cls in ALL else _cloud()
        name = function.__name__
        cases[f"{name} of {cls.__name__}" if name in cases else name] = partial(function, message, t)
    return cases


@group(tf2_geometry_msgs)
def _geometry(stack):
    t, point, covariance = transform("map", "base", 7.25, (1, 2, 3)), _point(), np.ones(36)
    return {
        **_applied("tf2_geometry_msgs"),
        "to_msg_msg": lambda: tf2_geometry_msgs.to_msg_msg(point),
        "from_msg_msg": lambda: tf2_geometry_msgs.from_msg_msg(point),
        "transform_covariance": lambda: tf2_geometry_msgs.transform_covariance(covariance, t),
    }


@group(tf2_sensor_msgs)
def _sensors(stack):
    t, points = transform("map", "base", 7.25, (1, 2, 3)), np.ones((50, 3))
    return {
        **_applied("tf2_sensor_msgs"),
        "transform_points": lambda: tf2_sensor_msgs.transform_points(points, t.transform),
    }
