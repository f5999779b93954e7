# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What has arrived waits until somebody reads the buffer, and is there when somebody does; nobody spins."""

import gc
import itertools
import os
import sys
import threading
import time
from functools import partial

import pytest
from forked_children import in_a_child
from making_objects import transform
from paths import PROGRAMS, SUPPORT
from processes import output_of
from rclpy.duration import Duration
from rclpy.time import Time
from spinning_nodes import repeated
from waiting import DEADLINE_S, errors_so_far, until

from tf2_msgs.msg import TFMessage
from tf2_ros._receive import receiver
from tf2_ros._receive.inbox import Inbox
from tf2_ros._receive.subscriptions import Subscriptions, TopicArrivals

pytestmark = pytest.mark.ours

S = 10**9
LATEST = Time()


def taken(listener):
    """How many messages of dynamic transforms were taken."""
    return listener._tf2_state.topics[0].arrivals.taken()[0]


def output_with_own_settings(program, *arguments):
    """The profiles of the tests would have the middleware deliver later."""
    names = [name for name in os.environ if name.endswith("_PROFILES_FILE")]
    env = {**os.environ, **dict.fromkeys(names, str(SUPPORT / "fastdds_log.xml"))}
    return output_of(PROGRAMS / program, *arguments, env=env)


def test_every_read_sees_what_arrived_before_it():
    assert output_with_own_settings("finds_own_transforms.py", 50, 5000) == "{}\n"


def test_a_large_message_is_inserted_as_a_whole_without_the_gil_and_leaves_no_memory():
    assert output_with_own_settings("receives_large_messages.py").splitlines() == [
        "whole: 10 of 10; other threads ran: True",
        "memory is given back: True",
    ]


class TestWithoutAReader:
    def test_what_is_refused_is_logged(self, listener, peer, capfd):
        peer().send(("map", "map", 1 * S, 5))
        until(lambda: "TF_SELF_TRANSFORM" in errors_so_far())

    def test_the_thread_never_needs_the_gil(self, buffer, listener, flood):
        """More messages than the queue holds twice arrive while one C call keeps the GIL."""
        import ctypes

        process = flood(100, 1, 300)
        until(lambda: taken(listener) > 0)
        ctypes.PyDLL(None).usleep(2_500_000)
        process.wait()
        until(lambda: buffer.statistics()["taken"] == 300)


class TestEventsExecutor:
    @pytest.fixture
    def events_executor(self, ros):
        experimental = pytest.importorskip("rclpy.experimental")
        executor = experimental.EventsExecutor()
        yield executor
        for node in executor.get_nodes():
            executor.remove_node(node)
        executor.spin_once(timeout_sec=0.01)

    def spin(self, executor, condition):
        # Not `until`: the rounds of this executor end when the time is over, whatever has happened.
        deadline = time.monotonic() + DEADLINE_S
        while not condition():
            assert time.monotonic() < deadline
            executor.spin_once(timeout_sec=0.05)

    def test_a_listener_may_be_moved_to_it_and_back_and_one_made_in_it(
        self, tf2_ros, buffer, listener, node, peer, executor, events_executor
    ):
        publisher, second, ticks = peer(), tf2_ros.Buffer(), itertools.count()
        node.create_timer(0.01, lambda: next(ticks))
        publisher.send(("map", "before", 1 * S, 5))
        until(lambda: "before" in buffer, executor)
        executor.remove_node(node)
        events_executor.add_node(node)
        self.spin(events_executor, lambda: listener.receives == ())
        with tf2_ros.TransformListener(second, node) as other:
            assert other.receives == ()
            publisher.matched(2)
            publisher.send(("map", "beside", 1 * S, 5))
            publisher.send(("map", "fixed", 0, 5), static=True)
            self.spin(
                events_executor, lambda: "beside" in buffer and "fixed" in buffer and "beside" in second
            )
        events_executor.remove_node(node)
        executor.add_node(node)
        publisher.send(("map", "after", 1 * S, 5))
        until(lambda: "after" in buffer, executor)
        assert listener.receives == ()
        assert next(ticks) > 0

    @pytest.mark.parametrize("is_first", [True, False])
    def test_it_may_take_the_node_while_a_listener_subscribes(
        self, tf2_ros, buffer, node, peer, events_executor, monkeypatch, is_first
    ):
        """The middleware reports arrivals to whoever asked last."""

        class Racing(Subscriptions):
            def subscribe(self, *arguments):
                if not is_first:
                    super().subscribe(*arguments)
                if node.executor is None:
                    events_executor.add_node(node)
                    events_executor.spin_once(timeout_sec=0.05)
                if is_first:
                    super().subscribe(*arguments)

        publisher = peer()
        monkeypatch.setattr(receiver, "Subscriptions", Racing)
        with tf2_ros.TransformListener(buffer, node) as listener:
            assert listener.receives == ()
            publisher.matched(1)
            publisher.send(("map", "robot", 1 * S, 5))
            publisher.send(("map", "fixed", 0, 5), static=True)
            self.spin(events_executor, lambda: "robot" in buffer and "fixed" in buffer)
        # The executor keeps a subscription until it has looked.
        self.spin(events_executor, lambda: not any(map(node.count_subscribers, ("/tf", "/tf_static"))))


def test_buffers_are_exchanged_while_threads_read_and_wait(tf2_ros, node, flood):
    """The buffers stay whole, and each wait ends."""
    flood(200, 2)
    numbers = itertools.count()
    buffers = [tf2_ros.Buffer() for _ in range(3)]

    def exchange():
        listener.buffer = buffers[next(numbers) % 3]
        threading.Event().wait(0.0001)

    def wait(buffer):
        future = buffer.wait_for_transform_async("map", "f0", LATEST, timeout=0.01)
        buffer.can_transform("map", "f1", LATEST, Duration(seconds=0.002))
        until(future.done)
        future.exception()

    with (
        tf2_ros.TransformListener(buffers[0], node) as listener,
        repeated(exchange, exchange, *(partial(wait, buffer) for buffer in buffers)),
    ):
        # Not for some seconds: on a busy machine, all that is sent in them may arrive together.
        until(lambda: all(buffer.statistics()["taken"] > 300 for buffer in buffers))
    for buffer in buffers:
        buffer._self_check()
        until(lambda buffer=buffer: buffer.statistics()["waiters"] == 0)


@pytest.fixture
def publisher(new_node):
    """Publishes in this process."""
    return new_node("sending").create_publisher(TFMessage, "/tf", 100)


def test_an_answer_is_not_lost_with_the_listener_that_received_it(tf2_ros, buffer, new_node, publisher):
    for number in range(5):
        node = new_node(f"listening_{number}")
        listener = tf2_ros.TransformListener(buffer, node)
        until(lambda: publisher.get_subscription_count() > 0)
        future = buffer.wait_for_transform_async("map", f"frame_{number}", LATEST)
        message = TFMessage(transforms=[transform("map", f"frame_{number}", 1)])
        interval = sys.getswitchinterval()
        sys.setswitchinterval(10)  # the background thread must wait
        try:
            publisher.publish(message)
            deadline = time.monotonic() + DEADLINE_S
            while not buffer.can_transform("map", f"frame_{number}", LATEST) and time.monotonic() < deadline:
                pass
            listener.unregister()
            node.destroy_node()
            del listener, node
            gc.collect()
        finally:
            sys.setswitchinterval(interval)
        until(future.done)
        until(lambda: publisher.get_subscription_count() == 0)


def test_where_the_middleware_refuses_the_executor_takes_the_messages(
    tf2_ros, buffer, node, peer, executor, monkeypatch
):
    from tf2_ros._receive import receiver

    class Refused(receiver.Subscriptions):
        def subscribe(self, *_):
            raise RuntimeError("not implemented")

    monkeypatch.setattr(receiver, "Subscriptions", Refused)
    with tf2_ros.TransformListener(buffer, node) as listener:
        assert listener.receives == ()
        peer().send(("map", "robot", 1 * S, 5))
        until(lambda: "robot" in buffer, executor)


def test_no_python_runs_while_the_inboxes_are_locked():
    """A finalizer might, and take the lock again."""

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
