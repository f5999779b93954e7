# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What receives transforms needs no executor, loses nothing, and ends in every order."""

import sys
import threading

import pytest
from excused_faults import tried
from forked_children import in_a_child
from interposed_libraries import with_library
from making_objects import at, translation
from paths import PROGRAMS
from processes import run
from rclpy.duration import Duration
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.time import Time
from spinning_nodes import knows
from waiting import DEADLINE_S, errors_so_far, until

from tf2_msgs.msg import TFMessage

pytestmark = pytest.mark.ours

# Of lark, which rclpy imports with its first node.
IGNORED = "ignore:module 'sre_:DeprecationWarning"
S = 10**9
LATEST = Time()
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
# With Zenoh, every publisher fits every subscription.
with_unfit_publishers = pytest.mark.skipif(
    qos_check_compatible(QoSProfile(depth=1), LATCHED)[0] != QoSCompatibility.ERROR,
    reason="this middleware knows no incompatible QoS",
)


def taken(buffer):
    return buffer.statistics()["taken"]


class TestWithoutAnExecutor:
    def test_a_callback_of_a_single_threaded_executor_may_wait(self, buffer, listener, node, executor, peer):
        publisher, found = peer(), []

        def look_up():
            timer.cancel()
            found.append(buffer.lookup_transform("map", "robot", at(5), Duration(seconds=DEADLINE_S)))

        def send_when_it_waits():
            until(lambda: buffer.statistics()["waiters"] == 1)
            publisher.send(("map", "robot", 4 * S, 1), ("map", "robot", 6 * S, 3))

        timer = node.create_timer(0.001, look_up)
        sender = threading.Thread(target=send_when_it_waits)
        sender.start()
        until(lambda: found, executor)
        sender.join()
        assert translation(found[0])[0] == 2

    def test_a_bare_core_is_filled_as_well(self, tf2_ros, tf2_py, node, peer):
        core = tf2_py.BufferCore()
        with tf2_ros.TransformListener(core, node) as listener:
            assert listener.receives
            peer().send(("map", "robot", 1 * S, 1))
            until(lambda: core._frameExists("robot"))

    @with_unfit_publishers
    def test_a_publisher_with_incompatible_qos_is_logged(self, listener, new_node, capfd):
        """The node is not spun, so no executor can log it."""
        other = new_node("volatile")
        other.create_publisher(TFMessage, "/tf_static", 10)
        until(lambda: "incompatible QoS" in errors_so_far())
        said = (
            "Nothing is received from /volatile on /tf_static: Volatile publisher and transient local subscr"
        )
        until(lambda: said in errors_so_far())

    @with_unfit_publishers
    def test_one_whose_node_the_graph_does_not_know_yet_is_named_later(
        self, ros, tf2_ros, buffer, new_node, capfd
    ):
        asked = []

        class Knowing(ros.node.Node):
            """Knows the endpoints of other nodes before it knows these nodes, as the graph may."""

            def get_publishers_info_by_topic(self, topic):
                found = super().get_publishers_info_by_topic(topic)
                asked.append(len(found))
                if sum(map(bool, asked)) == 1:
                    for one in found:
                        one.node_name = "_NODE_NAME_UNKNOWN_"
                return found

        node = Knowing("knowing")
        with tf2_ros.TransformListener(buffer, node):
            other = new_node("volatile")
            other.create_publisher(TFMessage, "/tf_static", 10)
            until(lambda: "Nothing is received from" in errors_so_far())
            assert "from /volatile on /tf_static" in errors_so_far()
        node.destroy_node()


def test_a_message_of_any_size_is_taken(buffer, listener, peer):
    publisher = peer()
    many = [("map", f"robot{i}", 1 * S, i) for i in range(20_000)]
    publisher.send(*many)
    publisher.send(("map", "last", 1 * S, 1))
    until(knows(buffer, "last"))
    assert taken(buffer) == len(many) + 1
    assert translation(buffer.lookup_transform("map", "robot19999", LATEST))[0] == 19999


class TestTrouble:
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

    def test_no_python_runs_while_the_inboxes_are_locked(self):
        """A finalizer might, and take the lock again."""
        from tf2_ros._receive.inbox import Inbox
        from tf2_ros._receive.subscriptions import Subscriptions, TopicArrivals

        class Handle:
            __enter__ = __exit__ = lambda *_: None

            @property
            def pointer(self):
                return topic.taken()[0]  # takes the lock

        topic, source = TopicArrivals(), Subscriptions()
        inbox = Inbox(source, print)

        def subscribe():
            with pytest.raises(RuntimeError, match="does not report arrivals"):
                source.subscribe(topic, Handle(), "/tf", False, 1)

        assert in_a_child(subscribe) == 0
        inbox.close()


class TestEnd:
    @pytest.mark.timeout(600)  # may be repeated; each end has a limit of its own
    @pytest.mark.parametrize("how", ["spun", "not spun"])
    def test_any_order_hundreds_of_times(self, flood, tmp_path, how):
        flood(200, 5)
        environment = with_library("stack_at_alarm", tmp_path)
        options = ("-W", "error", "-W", IGNORED)
        program = (sys.executable, *options, PROGRAMS / "ends_listeners_in_any_order.py", how)
        done = tried(lambda: run(*program, env=environment))
        # Zenoh reports each message that arrives just after the end of its subscription.
        lines = done.stderr.splitlines()
        assert [line for line in lines if "[rmw_zenoh_cpp]: SubscriberCallback triggered" not in line] == []
        assert (done.returncode, done.stdout) == (0, "nothing is left\n")

    def test_an_executor_that_has_just_met_an_event_handler_does_not_wait_for_it(self, listener, node):
        """If another thread destroys the subscription then, the executor would raise InvalidHandle."""
        met = [one for one in node.waitables if one.callback_group is listener.group]
        assert met
        listener.unregister()
        assert not any(map(listener.group.can_execute, met))

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
