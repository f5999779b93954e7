# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An executor takes the messages where the middleware reports arrivals to nobody or to that executor."""

import itertools
import time

import pytest
from waiting import DEADLINE_S, until

from tf2_ros._receive import listener_receiver
from tf2_ros._receive.subscriptions import Subscriptions
from tf2_ros.records import Recording

S = 10**9


def test_where_the_middleware_refuses_the_executor_takes_the_messages(
    tf2_ros, buffer, node, peer, executor, monkeypatch
):
    class Refused(Subscriptions):
        def subscribe(self, *_):
            raise RuntimeError("not implemented")

    monkeypatch.setattr(listener_receiver, "Subscriptions", Refused)
    with tf2_ros.TransformListener(buffer, node) as listener:
        assert listener.receives == ()
        peer().send(("map", "robot", 1 * S, 5))
        until(lambda: "robot" in buffer, executor)


@pytest.fixture
def events_executor(ros):
    experimental = pytest.importorskip("rclpy.experimental")
    executor = experimental.EventsExecutor()
    yield executor
    for node in executor.get_nodes():
        executor.remove_node(node)
    executor.spin_once(timeout_sec=0.01)


def spin(executor, condition):
    # Not `until`: the rounds of this executor end when the time is over, whatever has happened.
    deadline = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline
        executor.spin_once(timeout_sec=0.05)


def test_a_listener_in_an_events_executor_cannot_record_and_says_why(tf2_ros, buffer, node, events_executor):
    events_executor.add_node(node)
    with pytest.raises(NotImplementedError, match="with this listener: an EventsExecutor has the arrivals"):
        tf2_ros.TransformListener(buffer, node, recording=Recording())


def test_a_listener_may_be_moved_to_an_events_executor_and_back_and_one_made_in_it(
    tf2_ros, buffer, listener, node, peer, executor, events_executor
):
    publisher, second, ticks = peer(), tf2_ros.Buffer(), itertools.count()
    node.create_timer(0.01, lambda: next(ticks))
    publisher.send(("map", "before", 1 * S, 5))
    until(lambda: "before" in buffer, executor)
    executor.remove_node(node)
    events_executor.add_node(node)
    spin(events_executor, lambda: listener.receives == ())
    with tf2_ros.TransformListener(second, node) as other:
        assert other.receives == ()
        publisher.matched(2)
        publisher.send(("map", "beside", 1 * S, 5))
        publisher.send(("map", "fixed", 0, 5), static=True)
        spin(events_executor, lambda: "beside" in buffer and "fixed" in buffer and "beside" in second)
    events_executor.remove_node(node)
    executor.add_node(node)
    publisher.send(("map", "after", 1 * S, 5))
    until(lambda: "after" in buffer, executor)
    assert listener.receives == ()
    assert next(ticks) > 0


@pytest.mark.parametrize("is_first", [True, False])
def test_an_events_executor_may_take_the_node_while_a_listener_subscribes(
    tf2_ros, buffer, node, peer, events_executor, monkeypatch, is_first
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
    monkeypatch.setattr(listener_receiver, "Subscriptions", Racing)
    with tf2_ros.TransformListener(buffer, node) as listener:
        assert listener.receives == ()
        publisher.matched(1)
        publisher.send(("map", "robot", 1 * S, 5))
        publisher.send(("map", "fixed", 0, 5), static=True)
        spin(events_executor, lambda: "robot" in buffer and "fixed" in buffer)
    # The executor keeps a subscription until it has looked.
    spin(events_executor, lambda: not any(map(node.count_subscribers, ("/tf", "/tf_static"))))
