# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a signal handler raises leaves the call that it interrupts, also while a buffer reads its clock."""

import gc
import operator
import signal
import sys
import time
import weakref
from collections import deque

import pytest
from excused_faults import WITHOUT_LOCKS_LEFT
from geometry_msgs.msg import PointStamped
from rclpy.clock import JumpHandle
from simulated_clock import simulate
from times_and_transforms import S, insert, stamp_ns, transform

from tf2_py._internal import errors
from tf2_ros.message_filter import MANY

SIGNALS = 200


class Alarm(Exception):
    """What the handler raises."""


@pytest.fixture
def alarms():
    """A function that calls something until SIGNALS alarms were raised; returns how many left it."""
    raised = []

    def handle(*_):
        raised.append(None)
        raise Alarm

    def call_until_interrupted(call):
        # Not in the try below: in Python 3.13.0, an interrupt at the end of this loop would leave that, too.
        before = len(raised)
        while len(raised) == before:
            call()

    def let_out(call):
        caught = 0
        while len(raised) < SIGNALS:
            try:
                signal.setitimer(signal.ITIMER_REAL, 0.0005 + len(raised) % 7 * 1e-4)
                call_until_interrupted(call)
            except Alarm:
                caught += 1
        return caught

    # Python ignores what is raised in a callback of the collector, such as that of hypothesis.
    gc.disable()
    handler = signal.signal(signal.SIGALRM, handle)
    yield let_out
    gc.enable()
    signal.setitimer(signal.ITIMER_REAL, 0)
    signal.signal(signal.SIGALRM, handler)


@pytest.fixture(params=["the system's", "a node's", "simulated"])
def clocked(request, tf2_ros, node):
    """A buffer with a clock of rclpy's, and its time in nanoseconds."""
    if request.param == "the system's":
        return tf2_ros.Buffer(), time.time_ns()
    if request.param == "simulated":
        simulate(node, seconds=100)
    return tf2_ros.Buffer(node=node), node.get_clock().now().nanoseconds


@WITHOUT_LOCKS_LEFT
def test_out_of_a_lookup_that_fails(tf2_ros, clocked, alarms):
    buffer, now_ns = clocked
    buffer.set_transform(transform("map", "base", ns=now_ns), "x")

    def fail():
        try:
            buffer.lookup_transform("map", "base", now_ns + 2000 * S)
        except tf2_ros.TransformException as error:
            assert "ahead of" in str(error)

    assert alarms(fail) == SIGNALS


@WITHOUT_LOCKS_LEFT
def test_out_of_an_insert_that_ends_waits(tf2_ros, clocked, alarms):
    buffer, now_ns = clocked
    futures = deque()

    def deliver():
        futures.append(buffer.wait_for_transform_async("map", "base", 0, max_age=1000.0))
        buffer.set_transform(transform("map", "base", ns=now_ns), "x")
        buffer.clear()

    assert alarms(deliver) == SIGNALS
    assert {type(one.exception()) for one in futures if one.done()} == {type(None)}


@WITHOUT_LOCKS_LEFT
def test_out_of_a_filter(tf2_ros, clocked, node, alarms):
    buffer, now_ns = clocked
    insert(buffer, "map", "base", 1)
    filter = tf2_ros.MessageFilter(None, buffer, "map", 5, node=node)
    # In C, because what a handler raises in a callback is logged.
    filter.registerFailureCallback(operator.is_)
    point = PointStamped()
    point.header.frame_id = "base"
    point.header.stamp.sec = now_ns // S + 500
    # The warning about many drops comes first, because rclpy reads a line of the caller's source for it: an
    # alarm would leave that file open.
    for _ in range(2 * MANY):
        filter.add(point)
    assert alarms(lambda: filter.add(point)) == SIGNALS
    filter.close()


@WITHOUT_LOCKS_LEFT
def test_out_of_calls_with_changes(tf2_ros, clocked, alarms):
    buffer, now_ns = clocked
    changes = deque()
    stamps = iter(range(now_ns, now_ns + 10**12, 10**6))
    buffer.set_transform(transform("map", "base", ns=next(stamps)), "x")
    subscription = []

    def change():
        if not subscription or subscription[0].state == "cancelled":
            subscription[:] = [buffer.on_change("map", "base", changes.append, max_age=1000.0)]
        buffer.set_transform(transform("map", "base", ns=next(stamps)), "x")

    assert alarms(change) == SIGNALS
    assert len(changes) > SIGNALS


def test_an_insert_that_is_interrupted_loses_no_call_with_changes(tf2_ros):
    """The interrupt comes while the insert reads a clock of the program's, before it delivers."""
    buffer, changes, interrupts = tf2_ros.Buffer(), [], []

    class Clock:
        def now(self):
            if interrupts:
                raise interrupts.pop()
            return 10 * S

    buffer.clock = Clock()
    buffer.on_change("map", "base", changes.append, max_age=100.0)
    interrupts.append(KeyboardInterrupt())
    with pytest.raises(KeyboardInterrupt):
        insert(buffer, "map", "base", 1)
    insert(buffer, "map", "base", 2)
    assert [stamp_ns(one) for one in changes] == [S, 2 * S]


def test_an_insert_that_is_interrupted_loses_no_message_of_a_filter(tf2_ros, node, monkeypatch):
    """The interrupt comes while the insert says why the message is dropped."""
    buffer, dropped, interrupts = tf2_ros.Buffer(cache_time=10.0), [], [KeyboardInterrupt()]
    extrapolation = errors.extrapolation

    def interrupted(*facts):
        if interrupts:
            raise interrupts.pop()
        return extrapolation(*facts)

    filter = tf2_ros.MessageFilter(None, buffer, "map", 5, node=node)
    filter.registerFailureCallback(lambda _, reason: dropped.append(reason))
    point = PointStamped()
    point.header.frame_id, point.header.stamp.sec = "base", 2
    filter.add(point)
    insert(buffer, "map", "base", 3)
    monkeypatch.setattr(errors, "extrapolation", interrupted)
    with pytest.raises(KeyboardInterrupt):
        insert(buffer, "map", "base", 100)
    assert dropped == [tf2_ros.FilterFailureReason.OUT_THE_BACK]
    filter.close()


def test_a_clock_calls_no_handle_that_is_gone(tf2_ros, monkeypatch):
    """The handler raises in the finalizer of a buffer, before that unregisters the handle for jumps."""
    ignored = []
    monkeypatch.setattr(sys, "unraisablehook", lambda args: ignored.append(args.exc_type))
    buffer = tf2_ros.Buffer()
    clock, handle = buffer.clock, weakref.ref(buffer.jump_handle)

    def interrupted(_):
        raise Alarm

    with monkeypatch.context() as patched:
        patched.setattr(JumpHandle, "unregister", interrupted)
        del buffer
    assert ignored == [Alarm]
    assert handle() is not None  # else the next jump of the clock would crash
    clock.handle.remove_clock_callback(handle())
