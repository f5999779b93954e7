# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Listeners, with the publishers in processes of their own."""

import gc
import re
import sys
import threading

import pytest
from interposed_libraries import output_with_library
from paths import PROGRAMS
from processes import run
from public_names import NAMES
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible
from rclpy.serialization import serialize_message
from rclpy.time import Time
from spinning_nodes import knows, queue_of, shut_down_at_sleep
from times_and_transforms import at, transform, translation
from waiting import DEADLINE_S, errors_so_far, until

from tf2_msgs.msg import TFMessage

pytestmark = pytest.mark.usefixtures("inserter")

S = 10**9
LATEST = Time()
by_the_inbox = pytest.mark.parametrize("inserter", ["inbox"])
OF_ITS_OWN = re.compile("__|_tf2_|_[A-Z]")  # names that a program would not use
# The methods of tf2's BufferCore, which is written in C.
OF_THE_CORE = {
    *("can_transform_core", "can_transform_full_core", "clear", "get_latest_common_time"),
    *("lookup_transform_core", "lookup_transform_full_core", "lookupVelocityCore", "lookupVelocityFullCore"),
    *("all_frames_as_yaml", "all_frames_as_string", "_allFramesAsDot", "_chain", "_frameExists"),
    "_getFrameStrings",
}


def using_every_name(kind, *attributes):
    """A subclass whose objects have attributes of the names that tf2's, with these attributes, lack."""
    of_tf2 = {*OF_THE_CORE, *attributes, "cache_time_ns", "receives"}
    for one in NAMES["tf2_ros"]["names"].values():
        of_tf2.update(one.get("members", ()))

    class Mine(kind):
        def __init__(self, *arguments):
            super().__init__(*arguments)
            for name in {name for one in (self, *kind.__mro__[:-1]) for name in vars(one)} - of_tf2:
                if not OF_ITS_OWN.match(name):
                    setattr(self, name, None)

    return Mine


def test_programs_may_use_every_name_that_tf2_does_not(tf2_ros, node, executor, peer):
    of_buffers = ("registration", "clock", "srv", "jump_handle")
    of_listeners = ("buffer", "node", "group", "tf_sub", "tf_static_sub")
    buffer = using_every_name(tf2_ros.Buffer, *of_buffers)(None, node)
    listener = using_every_name(tf2_ros.TransformListener, *of_listeners)(buffer, node)
    assert buffer.frames is buffer._wait is None
    sender = peer()
    sender.send(("map", "robot", 1 * S, 1))
    sender.send(("robot", "arm", 0, 1), static=True)
    until(knows(buffer, "arm"), executor)
    future = buffer.wait_for_transform_async("map", "late", at(2))
    with pytest.raises(tf2_ros.LookupException, match=r"Did you mean \[robot\]\?"):
        buffer.lookup_transform("map", "robbot", LATEST)
    assert x_of(buffer, "arm") == 2
    for options in ({}, {"timeout": 0.01}):
        assert buffer.lookup_transform("map", "arm", at(2), tolerance=1, **options).header.stamp.sec == 1
    buffer.set_transform(transform("map", "late", 2), "me")
    until(future.done, executor)
    assert repr(buffer) and repr(listener)
    buffer.time_jump_callback(None)
    listener.unregister()
    assert not knows(buffer, "robot")()


def x_of(buffer, child, parent="map", time=LATEST):
    return translation(buffer.lookup_transform(parent, child, time))[0]


class TestOverTheNetwork:
    def test_a_restarted_recording_loses_nothing_after_its_clock(self, tf2_ros, new_node, executor, peer):
        node = new_node("simulated", parameter_overrides=[Parameter("use_sim_time", value=True)])
        executor.add_node(node)
        buffer, simulator = tf2_ros.Buffer(node=node), peer()
        tf2_ros.TransformListener(buffer, node)
        gc.collect()  # no reference to it is needed

        def set_clock(seconds):
            # Again and again: messages of a clock may be lost.
            clock = node.get_clock()
            until(lambda: simulator.set_clock(seconds) or clock.now().nanoseconds == seconds * S, executor)

        set_clock(100)
        simulator.send(("map", "robot", 100 * S, 1), ("robot", "old", 100 * S, 1))
        until(knows(buffer, "old"), executor)
        assert "broadcaster: 'default_authority'" in buffer.all_frames_as_yaml()
        set_clock(95)
        simulator.send(("map", "robot", 95 * S, 2), ("robot", "new", 95 * S, 3))
        until(lambda: x_of(buffer, "new", time=at(95)) == 5 if "new" in buffer else False, executor)
        assert not buffer.can_transform("map", "old", LATEST)


@pytest.mark.tf2
def test_a_buffer_of_another_kind_is_filled_once_it_is_assigned(buffer, listener, executor, peer):
    class Recorder:
        def __init__(self):
            self.seen = []

        def set_transform(self, transform, authority):
            self.seen.append((transform.child_frame_id, authority, threading.current_thread()))

    publisher = peer()
    publisher.send(("map", "robot", 1 * S, 1))
    until(knows(buffer, "robot"), executor)
    recorder = listener.buffer = Recorder()
    publisher.send(("map", "robot", 2 * S, 1))
    until(lambda: recorder.seen, executor)
    assert recorder.seen == [("robot", "default_authority", threading.current_thread())]


@pytest.mark.tf2
def test_a_node_that_wraps_the_callbacks_of_its_subscriptions(ros, tf2_ros, buffer, peer):
    received = []

    class Wrapping(ros.node.Node):
        def create_subscription(self, msg_type, topic, callback, *arguments, **options):
            def wrapped(message):
                received.append((topic, type(message).__name__))
                callback(message)

            return super().create_subscription(msg_type, topic, wrapped, *arguments, **options)

    node = Wrapping("wrapping")
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    tf2_ros.TransformListener(buffer, node)
    peer().send(("map", "robot", 1 * S, 1))
    until(knows(buffer, "robot"), executor)
    assert received == [("/tf", "TFMessage")]
    executor.shutdown()
    node.destroy_node()


@pytest.mark.tf2
def test_a_fake_node_with_the_arguments_of_tf2_alone(tf2_ros, buffer):
    class Fake:
        def __init__(self):
            self.made, self.destroyed, self.sent = {}, [], []

        def create_subscription(self, msg_type, topic, callback, qos_profile, callback_group=None):
            self.made[topic] = callback
            return topic

        def create_publisher(self, msg_type, topic, qos_profile):
            return type("Publisher", (), {"publish": staticmethod(self.sent.append)})()

        def destroy_subscription(self, subscription):
            self.destroyed.append(subscription)

    node = Fake()
    listener = tf2_ros.TransformListener(buffer, node)
    for broadcaster in (tf2_ros.TransformBroadcaster(node), tf2_ros.StaticTransformBroadcaster(node)):
        broadcaster.sendTransform(transform("map", "robot", 1))
        node.made["/tf"](node.sent.pop())
    assert buffer.can_transform("map", "robot", LATEST)
    listener.unregister()
    assert node.destroyed == ["/tf", "/tf_static"]


@pytest.mark.tf2
def test_the_graph_shows_what_tf2_shows(tf2_ros, new_node):
    def seen():
        whose = (node.get_name(), node.get_namespace())
        publishers = dict(node.get_publisher_names_and_types_by_node(*whose))
        publishers.pop("/rosout", None)  # of rcl; with Cyclone DDS later than the others, on Humble never
        return {
            "nodes": node.get_node_names(),
            "parameters": [parameter.name for parameter in node.get_parameters_by_prefix("").values()],
            "services": dict(node.get_service_names_and_types_by_node(*whose)),
            "publishers": publishers,
            "subscribers": dict(node.get_subscriber_names_and_types_by_node(*whose)),
            "clients": node.get_client_names_and_types_by_node(*whose),
        }

    node = new_node("shown")
    # With Cyclone DDS, the graph has a node before what the node has.
    until(lambda: node.get_name() in node.get_node_names())
    until(lambda: len(seen()["services"]) == len(list(node.services)))
    until(lambda: "/parameter_events" in seen()["publishers"])
    before = seen()
    buffer = tf2_ros.Buffer(node=node)
    tf2_ros.TransformListener(buffer, node)
    tf2_ros.TransformBroadcaster(node)
    tf2_ros.StaticTransformBroadcaster(node)
    kind = {topic: ["tf2_msgs/msg/TFMessage"] for topic in ("/tf", "/tf_static")}
    expected = {
        **before,
        "services": {**before["services"], "/tf2_frames": ["tf2_msgs/srv/FrameGraph"]},
        "publishers": {**before["publishers"], **kind},
        "subscribers": {**before["subscribers"], **kind},
    }
    until(lambda: all(len(seen()[what]) == len(expected[what]) for what in expected))
    assert seen() == expected


def test_malformed_messages_are_counted_and_survived(tf2_ros, buffer, node, executor, peer, capfd, inserter):
    if inserter == "executor":
        pytest.skip("there rclpy reads the messages")
    # DDS fills up to four bytes, and carries no empty data at all.
    good = serialize_message(TFMessage(transforms=[transform("map", "evil", 1)]))
    bad = [b"\x00", good[:-4], good + b"\x00" * 12, good[:4] + b"\xff\xff\xff\xff" + good[8:]]
    tf2_ros.TransformListener(buffer, node)
    publisher = peer()
    for data in bad:
        publisher.send_bytes(data)
    publisher.send(("map", "robot", 1 * S, 1))
    until(knows(buffer, "robot"), executor)
    until(lambda: buffer.statistics()["malformed_messages"] == len(bad), executor)
    assert buffer._getFrameStrings() == ["robot", "map"]
    # At most once in a second; they are counted when they arrive, and logged a little later.
    line = "Ignoring a malformed message on /tf"
    until(lambda: line in errors_so_far(), executor)
    assert errors_so_far().count(line) < len(bad)


def test_a_received_name_ends_at_a_nul(tf2_ros, buffer, node, executor, peer):
    tf2_ros.TransformListener(buffer, node)
    made = TFMessage(transforms=[transform("map", "robotXarm", 1), transform("map", "end", 1)])
    peer().send_bytes(bytes(serialize_message(made)).replace(b"robotXarm", b"robot\0arm"))
    until(knows(buffer, "end"), executor)
    assert buffer._getFrameStrings() == ["robot", "map", "end"]


@pytest.mark.tf2
def test_a_set_transform_of_the_buffer_itself_is_called(tf2_ros, buffer, node, executor, peer):
    seen = []
    buffer.set_transform = lambda transform, authority: seen.append(transform)
    tf2_ros.TransformListener(buffer, node)
    peer().send(("map", "robot", 1 * S, 1), ("map", "robot", 2 * S, 1))
    until(lambda: len(seen) == 2, executor)
    assert buffer._getFrameStrings() == []


@pytest.mark.tf2
def test_of_the_subscriptions_the_quality_of_service_may_be_chosen(tf2_ros, buffer, node):
    usual = tf2_ros.TransformListener(buffer, node)
    assert usual.tf_sub.qos_profile.depth == 100
    assert usual.tf_sub.qos_profile.durability == DurabilityPolicy.VOLATILE
    assert usual.tf_static_sub.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    qos = QoSProfile(depth=3, reliability=ReliabilityPolicy.BEST_EFFORT)
    chosen = tf2_ros.TransformListener(buffer, node, qos=qos, static_qos=7)
    assert (chosen.tf_sub.qos_profile.depth, chosen.tf_static_sub.qos_profile.depth) == (3, 7)
    assert chosen.tf_sub.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT


@by_the_inbox
def test_without_an_executor_the_log_says_that_a_publisher_does_not_fit(listener, new_node, capfd):
    volatile = QoSProfile(depth=10)
    if qos_check_compatible(volatile, listener.tf_static_sub.qos_profile)[0] != QoSCompatibility.ERROR:
        pytest.skip("with this middleware, every publisher fits")
    new_node("volatile").create_publisher(TFMessage, "/tf_static", volatile)
    until(lambda: "on topic '/tf_static', offering incompatible QoS" in errors_so_far())


@pytest.mark.parametrize("kind", ["TransformListener", "StaticTransformListener"])
def test_a_listener_that_starts_last_gets_the_static_transforms_of_every_publisher(
    tf2_ros, buffer, node, new_node, executor, kind
):
    publishing = new_node("many")
    frames = [f"mount{i}" for i in range(150)]
    for frame in frames:
        broadcaster = tf2_ros.StaticTransformBroadcaster(publishing)
        broadcaster.sendTransform(transform("base", frame))
    getattr(tf2_ros, kind)(buffer, node)
    until(lambda: all(buffer.can_transform("base", frame, LATEST) for frame in frames), executor)


class TestThread:
    def test_a_listener_without_a_node_spins_its_own(self, tf2_ros, buffer, ros, peer):
        with tf2_ros.TransformListener(buffer, None) as listener:
            assert listener.node.get_name().startswith("transform_listener_impl_")
            peer().send(("map", "robot", 1 * S, 1))
            until(knows(buffer, "robot"))
        assert not listener.dedicated_listener_thread.is_alive()

    @pytest.mark.tf2
    def test_a_call_of_del_waits_for_its_end(self, tf2_ros, buffer, node):
        listener = tf2_ros.TransformListener(buffer, node, spin_thread=True)
        listener.__del__()
        assert not listener.dedicated_listener_thread.is_alive()

    @by_the_inbox
    def test_a_constructor_that_fails_leaves_no_thread(self, tf2_ros, buffer, node):
        class Failing(tf2_ros.TransformListener):
            def _TransformListener__spin(self):
                assert self.receives
                raise KeyError("too late")

        before = threading.active_count()
        for _ in range(50):
            with pytest.raises(KeyError, match="too late"):
                Failing(buffer, node, spin_thread=True)
        assert list(node.subscriptions) == []
        # Fewer: a thread of an earlier test may have ended meanwhile.
        until(lambda: threading.active_count() <= before)

    @pytest.mark.parametrize("whose", ["its own", "a program's"])
    def test_a_shutdown_that_wakes_nobody_ends_it(self, tf2_ros, buffer, ros, node, whose):
        """After a signal, rclpy wakes executors before it shuts down, and they may sleep again in between."""
        listener = tf2_ros.TransformListener(buffer, None if whose == "its own" else node, spin_thread=True)
        shut_down_at_sleep(queue_of(listener.node))
        until(lambda: not listener.dedicated_listener_thread.is_alive())

    def test_destroying_the_node_ends_it(self, tf2_ros, buffer, new_node):
        node = new_node("spun")
        listener = tf2_ros.TransformListener(buffer, node, spin_thread=True)
        node.destroy_node()
        until(lambda: not listener.dedicated_listener_thread.is_alive())


class TestEnd:
    def test_unregistering_ends_the_subscriptions(self, tf2_ros, buffer, node):
        topics = ["/ending_tf", "/ending_tf_static"]
        listener = tf2_ros.TransformListener(buffer, node, tf_topic=topics[0], tf_static_topic=topics[1])
        until(lambda: all(node.count_subscribers(topic) == 1 for topic in topics))
        listener.unregister()
        listener.unregister()
        until(lambda: all(node.count_subscribers(topic) == 0 for topic in topics))

    def test_a_finalizer_takes_no_lock_of_the_executor(self, tf2_ros, ros, buffer):
        """It may run in the middle of whatever its own thread does."""
        listener = tf2_ros.TransformListener(buffer, None)
        executor = listener.executor

        def end():
            with executor._tasks_lock, executor._nodes_lock, executor._shutdown_lock:
                listener.__del__()

        ending = threading.Thread(target=end, daemon=True)
        ending.start()
        ending.join(DEADLINE_S)
        assert not ending.is_alive()
        listener.dedicated_listener_thread.join(DEADLINE_S)
        assert not listener.dedicated_listener_thread.is_alive()

    def test_one_that_was_never_initialized_can_be_ended(self, tf2_ros):
        listener = tf2_ros.TransformListener.__new__(tf2_ros.TransformListener)
        listener.unregister()
        with listener:
            listener.__del__()
        assert listener.receives == () and listener.tf_sub is None

    def test_one_whose_making_a_signal_interrupts_ends_in_silence(self, tf2_ros, monkeypatch, capfd):
        def interrupted():
            raise KeyboardInterrupt

        module = sys.modules[tf2_ros.TransformListener.__module__]
        monkeypatch.setattr(module, "ListenerState", interrupted)
        with pytest.raises(KeyboardInterrupt):
            tf2_ros.TransformListener(None)
        gc.collect()
        assert capfd.readouterr().err == ""

    @pytest.mark.parametrize("how", ["unspun", "hidden", "shutdown", "waiting", "future", "called back"])
    def test_the_interpreter_exits_without_output(self, how, inserter):
        done = run(sys.executable, PROGRAMS / "exits_while_active.py", how, inserter)
        assert (done.returncode, done.stdout, done.stderr) == (0, "at the end\n", "")

    @by_the_inbox
    def test_so_it_does_if_a_call_waits_until_modules_are_destroyed(self):
        done = run(sys.executable, PROGRAMS / "exits_while_active.py", "called back at the very end", "inbox")
        assert (done.returncode, done.stdout, done.stderr) == (0, "at the end\n", "")

    @pytest.mark.parametrize("how", ["thread", "interrupted"])
    def test_a_node_spun_by_a_thread_keeps_the_program_until_its_context_ends(self, how, inserter):
        done = run(sys.executable, PROGRAMS / "exits_while_active.py", how, inserter)
        assert (done.returncode, done.stdout) == (0, "at the end\nafter the end\n")
        # Python itself speaks of an interrupt that finds it waiting for its last thread.
        assert how == "interrupted" or done.stderr == ""

    def test_the_interpreter_exits_while_rclpy_handles_a_signal(self, inserter, tmp_path):
        printed = output_with_library(
            "late_signals", tmp_path, "interrupted", inserter, program="exits_while_active"
        )
        assert printed == "at the end\nafter the end\n"

    def test_one_may_be_closed_while_rclpy_handles_a_signal(self, inserter, tmp_path):
        """As a `with` statement does after Ctrl-C; what is freed is overwritten."""
        overwriting = {"MALLOC_PERTURB_": "165", "GLIBC_TUNABLES": "glibc.malloc.tcache_count=0"}
        printed = output_with_library(
            "late_signals", tmp_path, "closed", inserter, program="exits_while_active", **overwriting
        )
        assert printed == "at the end\n"

    @by_the_inbox
    def test_an_executor_that_has_just_met_an_event_handler_does_not_wait_for_it(self, listener, node):
        """If another thread destroys the subscription then, the executor would raise InvalidHandle."""
        met = [one for one in node.waitables if one.callback_group is listener.group]
        assert met
        listener.unregister()
        assert not any(map(listener.group.can_execute, met))

    @by_the_inbox
    def test_one_subscription_may_be_destroyed_alone(self, buffer, listener, node, peer):
        publisher = peer()
        publisher.send(("map", "robot", 1 * S, 1))
        until(knows(buffer, "robot"))
        node.destroy_subscription(listener.tf_sub)
        until(lambda: node.count_subscribers("/tf") == 0)
        publisher.send_without_subscriber(("map", "unsubscribed", 1 * S, 1))
        publisher.send(("robot", "arm", 0, 1), static=True)
        until(knows(buffer, "arm"))
        assert not buffer.can_transform("map", "unsubscribed", LATEST)
        assert listener.receives
