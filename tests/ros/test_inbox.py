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
from calls_in_threads import repeated
from forked_children import in_a_child
from paths import PROGRAMS, SUPPORT
from processes import output_of
from rclpy.duration import Duration
from rclpy.time import Time
from times_and_transforms import transform
from waiting import DEADLINE_S, errors_so_far, until

from tf2_msgs.msg import TFMessage
from tf2_ros._process.inbox import Inbox
from tf2_ros._receive.subscriptions import Subscriptions, TopicArrivals

S = 10**9
LATEST = Time()


def taken(listener):
    """How many messages of dynamic transforms were taken."""
    return listener._tf2_state.topics[0].arrivals.taken()[0]


def output_with_own_settings(program, *arguments):
    """The profiles of the tests would have the middleware deliver later."""
    names = [name for name in os.environ if name.endswith("_PROFILES_FILE")]
    env = {**os.environ, **dict.fromkeys(names, str(SUPPORT / "fastdds_only_without_log.xml"))}
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
