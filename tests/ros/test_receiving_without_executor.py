# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What receives transforms needs no executor, whatever the size of a message."""

import threading

import pytest
from rclpy.duration import Duration
from rclpy.time import Time
from spinning_nodes import knows
from times_and_transforms import at, translation
from waiting import DEADLINE_S, until

pytestmark = pytest.mark.ours

S = 10**9
LATEST = Time()


def taken(buffer):
    return buffer.statistics()["taken"]


def test_a_callback_of_a_single_threaded_executor_may_wait(buffer, listener, node, executor, peer):
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


def test_a_bare_core_is_filled_as_well(tf2_ros, tf2_py, node, peer):
    core = tf2_py.BufferCore()
    with tf2_ros.TransformListener(core, node) as listener:
        assert listener.receives
        peer().send(("map", "robot", 1 * S, 1))
        until(lambda: core._frameExists("robot"))


def test_a_message_of_any_size_is_taken(buffer, listener, peer):
    publisher = peer()
    many = [("map", f"robot{i}", 1 * S, i) for i in range(20_000)]
    publisher.send(*many)
    publisher.send(("map", "last", 1 * S, 1))
    until(knows(buffer, "last"))
    assert taken(buffer) == len(many) + 1
    assert translation(buffer.lookup_transform("map", "robot19999", LATEST))[0] == 19999
