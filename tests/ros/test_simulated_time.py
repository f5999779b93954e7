"""Simulated time that starts late, is switched, stops and jumps, while something waits in every way."""

import asyncio
import time
from concurrent.futures import ThreadPoolExecutor

import pytest
from making import at, transform
from processes import DEADLINE_S, until
from rclpy.clock import ClockType
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rclpy.time import Time
from spinning import spinning

pytestmark = pytest.mark.ours

WANTED_S = 2000  # the stamp that everything waits for
TIMEOUT_S = 1.0
LATE_S = 10.0  # of a busy machine


class Clock:
    """The clock of a node, as a simulator and the parameter of the node change it."""

    def __init__(self, node):
        self._node = node

    def switch(self, on):
        self._node.set_parameters([Parameter("use_sim_time", value=on)])

    def set(self, seconds):
        clock = self._node.get_clock()
        clock.set_ros_time_override(Time(seconds=seconds, clock_type=ClockType.ROS_TIME))


# Before the waits begin, and while they last.
EVENTS = {
    "simulated time begins late": (lambda clock: clock.switch(True), lambda clock: clock.set(WANTED_S)),
    "it is far ahead": (
        lambda clock: (clock.switch(True), clock.set(10)),
        lambda clock: clock.set(2**31 - 1),
    ),
    "it jumps back": (lambda clock: (clock.switch(True), clock.set(3000)), lambda clock: clock.set(1500)),
    "it begins anew": (lambda clock: (clock.switch(True), clock.set(3000)), lambda clock: clock.set(0)),
    "it stands still": (lambda clock: (clock.switch(True), clock.set(100)), lambda clock: None),
    "it is switched on": (lambda clock: None, lambda clock: clock.switch(True)),
    "it is switched off": (
        lambda clock: (clock.switch(True), clock.set(1500)),
        lambda clock: clock.switch(False),
    ),
    "it is switched off and on": (
        lambda clock: (clock.switch(True), clock.set(1500)),
        lambda clock: (clock.switch(False), clock.switch(True), clock.set(1000)),
    ),
}


class Waits:
    """A wait of each kind for one transform, and what became of each."""

    def __init__(self, tf2_ros, buffer, timeout_s):
        self._errors = tf2_ros.TransformException
        self._pool = ThreadPoolExecutor()
        self._buffer, timeout = buffer, Duration(seconds=timeout_s)
        asked = "map", "robot", at(WANTED_S)
        self._future = buffer.wait_for_transform_async(*asked, timeout=timeout)
        self._began = time.monotonic()
        self._calls = {
            "lookup": self._pool.submit(self._timed, lambda: buffer.lookup_transform(*asked, timeout)),
            "can": self._pool.submit(self._timed, lambda: buffer.can_transform(*asked, timeout)),
            "await": self._pool.submit(
                self._timed, lambda: asyncio.run(buffer.lookup_transform_async(*asked, timeout=timeout))
            ),
        }
        # On a busy machine some may have expired before others begin.
        until(lambda: self.waiting() == 1 + len(self._calls) or time.monotonic() > self._began + timeout_s)

    def _timed(self, call):
        try:
            outcome = "answered" if call() else "no"
        except self._errors as error:
            outcome = type(error).__name__
        return outcome, time.monotonic() - self._began

    def waiting(self):
        return self._buffer.statistics()["waiters"]

    def outcomes(self):
        """Of each kind what came of it, once all have ended; and how long those in threads took."""
        ended = {name: call.result(DEADLINE_S) for name, call in self._calls.items()}
        until(self._future.done)
        outcomes = {name: outcome for name, (outcome, _) in ended.items()}
        error = self._future.exception()
        outcomes["future"] = "answered" if error is None else type(error).__name__
        return outcomes, [took for _, took in ended.values()]

    def end(self):
        self._pool.shutdown()


@pytest.fixture
def waiting(tf2_ros, new_node, executor):
    """Begins waits on a new buffer; what it returns has `clock`, `buffer` and `waits`."""
    node = new_node("simulated")
    executor.add_node(node)
    begun = []

    def begin(before, timeout_s):
        clock = Clock(node)
        before(clock)
        buffer = tf2_ros.Buffer(Duration(seconds=5000), node)
        buffer.set_transform(transform("map", "robot", 1), "me")
        buffer.set_transform_static(transform("robot", "camera"), "me")
        begun.append(Waits(tf2_ros, buffer, timeout_s))
        return clock, buffer, begun[-1]

    with spinning(executor):
        yield begin
        for waits in begun:
            waits.end()


@pytest.mark.parametrize("event", EVENTS)
def test_waits_go_on_and_are_answered(waiting, event):
    before, meanwhile = EVENTS[event]
    clock, buffer, waits = waiting(before, DEADLINE_S)
    count = waits.waiting()
    meanwhile(clock)
    assert waits.waiting() == count
    # What was cleared does not answer, nor does it keep what comes from doing so.
    assert buffer.can_transform("robot", "camera", 0)
    buffer.set_transform(transform("map", "robot", WANTED_S - 1), "me")
    assert waits.waiting() == count
    buffer.set_transform(transform("map", "robot", WANTED_S), "me")
    outcomes, _ = waits.outcomes()
    assert outcomes == dict.fromkeys(outcomes, "answered")
    assert waits.waiting() == 0


@pytest.mark.parametrize("event", EVENTS)
def test_timeouts_count_steady_time(waiting, event):
    before, meanwhile = EVENTS[event]
    clock, buffer, waits = waiting(before, TIMEOUT_S)
    meanwhile(clock)
    outcomes, took = waits.outcomes()
    expected = {
        "lookup": {"ExtrapolationException", "LookupException", "ConnectivityException"},
        "can": {"no"},
        "await": {"TimeoutException"},
        "future": {"TimeoutException"},
    }
    assert {name for name in expected if outcomes[name] not in expected[name]} == set()
    assert all(TIMEOUT_S <= one < TIMEOUT_S + LATE_S for one in took)
    assert waits.waiting() == 0
    # And nothing of it is left for later.
    buffer.set_transform(transform("map", "robot", WANTED_S), "me")
    assert buffer.can_transform("map", "robot", at(WANTED_S))
