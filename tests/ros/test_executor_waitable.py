# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What a program that spins sees of transforms that arrive: as if its executor had taken them."""

import itertools
import signal
import threading
import time

import pytest
from calls_in_threads import repeated
from excused_faults import accept
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.time import Time
from spinning_nodes import EXECUTOR, Observer, queue_of, shut_down_at_sleep, spinning
from times_and_transforms import at
from waiting import DEADLINE_S, until

S = 10**9
LATEST = Time()
LONG_S = 60.0  # a wait that nothing but a transform ends
QUIET_S = 0.3  # a wait that nothing ends


def arrived(listener, count):
    """Whether so many messages can be accounted for, without accounting for one."""
    return lambda: listener.buffer.statistics()["taken"] == count


def returns_early(spin_once, at_most):
    """How often it returns before its time is over, until it does not."""
    for count in range(at_most + 1):
        begin = time.monotonic()
        spin_once(timeout_sec=QUIET_S)
        if time.monotonic() - begin >= QUIET_S:
            return count
    return at_most + 1


def sending(publisher):
    """Have another thread send transforms, one after the other."""
    numbers = itertools.count(1)
    return repeated(lambda: publisher.send(("map", "robot", next(numbers) * S, 1)))


class TestSpinOnce:
    def test_it_returns_once_for_all_messages_that_arrived_before(self, listener, executor, peer):
        publisher = peer()
        for n in range(1, 4):
            publisher.send(("map", "robot", n * S, 1))
        publisher.send(("robot", "arm", 0, 1), static=True)
        until(arrived(listener, 4))
        begin = time.monotonic()
        executor.spin_once(timeout_sec=LONG_S)
        assert time.monotonic() - begin < LONG_S
        assert returns_early(executor.spin_once, 10) == 0

    def test_the_executors_own_loops_account_for_what_arrives(self, ros, listener, node, executor, peer):
        publisher = peer()
        with spinning(executor):
            for n in range(1, 4):
                publisher.send(("map", "robot", n * S, 1))
            until(arrived(listener, 3))
            round_of_the_loop = executor.create_task(lambda: None)
            until(round_of_the_loop.done)
        other = SingleThreadedExecutor()
        other.add_node(node)
        assert returns_early(other.spin_once, 10) == 0
        other.shutdown()

    def test_no_loop_is_woken_for_a_message(self, listener, executor, peer):
        publisher, checks, can_execute = peer(), [], listener.group.can_execute

        def check(entity):
            if entity is listener.tf_sub:
                checks.append(entity)
            return can_execute(entity)

        listener.group.can_execute = check
        with spinning(executor):
            publisher.send(("map", "robot", 1 * S, 1))
            until(arrived(listener, 1))
            before, began = len(checks), time.monotonic()
            for n in range(2, 102):
                publisher.send(("map", "robot", n * S, 1))
            until(arrived(listener, 101))
            # One for each round, of which there are ten in a second.
            assert before and len(checks) - before - 10 * (time.monotonic() - began) < 30

    @pytest.mark.parametrize("reads", [True, False])
    def test_it_does_not_return_for_each_message(self, buffer, listener, executor, peer, reads):
        """At most 100 times a second; ten times, once the loop has not read the buffer for a while."""
        returns = 0
        with sending(peer()):
            executor.spin_once(timeout_sec=LONG_S)
            before = buffer.statistics()["taken"]  # which is a read
            for _ in range(0 if reads else 120):
                executor.spin_once(timeout_sec=LONG_S)
            began = time.monotonic()
            while returns < (100 if reads else 30):
                executor.spin_once(timeout_sec=LONG_S)
                returns += 1
                if reads:
                    buffer.can_transform("map", "robot", LATEST)
        seconds, messages = time.monotonic() - began, buffer.statistics()["taken"] - before
        assert returns - (100 if reads else 10) * seconds < 10 and messages > 2 * returns

    @pytest.mark.tf2
    def test_a_node_that_moves_to_another_executor_misses_nothing(self, ros, tf2_ros, buffer, node, peer):
        """The executor that had it is woken by that, and must not take from the other what is due."""
        listener = tf2_ros.TransformListener(buffer, node, spin_thread=True)
        publisher = peer()
        for n in range(1, 11):
            sender = threading.Thread(target=lambda n=n: publisher.send(("map", "robot", n * S, 1)))
            sender.start()
            while not buffer.can_transform("map", "robot", at(n)):
                ros.spin_once(node)
            sender.join()
        listener.unregister()
        listener.executor.shutdown()
        listener.dedicated_listener_thread.join(DEADLINE_S)

    def test_nor_does_one_whose_former_executor_was_just_gathering(
        self, tf2_ros, buffer, node, executor, peer
    ):
        """It prepares for its sleep after the other executor did, and would take away what wakes that one."""
        gathering, asleep, returned = threading.Event(), threading.Event(), threading.Event()
        publisher, other = peer(), SingleThreadedExecutor()

        def is_in_former():
            return threading.current_thread().name == EXECUTOR

        class BeforeListener(Observer):
            def add_to_wait_set(self, _):
                if is_in_former():
                    gathering.set()
                    asleep.wait(DEADLINE_S)

        class AfterListener(Observer):
            def add_to_wait_set(self, _):
                if not is_in_former():
                    asleep.set()

            def is_ready(self, _):
                if is_in_former():
                    returned.set()
                return False

        node.add_waitable(BeforeListener())
        with tf2_ros.TransformListener(buffer, node):
            node.add_waitable(AfterListener())
            with spinning(executor):
                until(gathering.is_set)
                other.add_node(node)
                spinning_once = threading.Thread(target=other.spin_once)
                spinning_once.start()
                until(returned.is_set)
                publisher.send(("map", "robot", 1 * S, 1))
                spinning_once.join(DEADLINE_S)
                assert not spinning_once.is_alive()
        other.shutdown()

    @pytest.mark.parametrize("kind", [SingleThreadedExecutor, MultiThreadedExecutor])
    @pytest.mark.parametrize("of_server", [False, True])
    def test_calls_continue_in_an_executor_that_gets_the_node_during_one(
        self, tf2_ros, buffer, node, executor, kind, of_server
    ):
        """It falls asleep without what calls them, and must be woken when the call in the other returns."""
        server = tf2_ros.BufferServer(buffer, node, "lookup")
        calls = server._call_queue if of_server else queue_of(node)
        begun, asleep, called = threading.Event(), threading.Event(), threading.Event()
        gathered = itertools.count(1)

        def call():
            begun.set()
            asleep.wait(DEADLINE_S)

        class Last(Observer):
            def add_to_wait_set(self, _):
                if begun.is_set() and next(gathered) == 2:  # adding the node has caused another round
                    asleep.set()

        node.add_waitable(Last())
        other = kind()
        with spinning(executor):
            calls.put(call)
            until(begun.is_set)
            executor.remove_node(node)
            other.add_node(node)
            with spinning(other):
                calls.put(called.set)
                until(called.is_set)

    @pytest.mark.tf2
    @pytest.mark.parametrize("spin", ["spin_once", "spin"])
    def test_signal_handlers_run(self, ros, listener, node, peer, spin):
        """Python runs them between two rounds, and transforms cause rounds."""

        def handle(*_):
            raise TimeoutError

        before = signal.signal(signal.SIGALRM, handle)
        try:
            with sending(peer()), pytest.raises((TimeoutError, RuntimeError)) as raised:
                signal.setitimer(signal.ITIMER_REAL, 0.2)
                while True:
                    getattr(ros, spin)(node)
        finally:
            signal.signal(signal.SIGALRM, before)
        if raised.type is not TimeoutError:
            accept(raised.value)  # the handler ran in a binding of rclpy, which raises an error of its own

    @pytest.mark.parametrize("kind", [SingleThreadedExecutor, MultiThreadedExecutor])
    def test_a_shutdown_ends_a_loop_that_nothing_wakes(self, listener, node, kind):
        """As after a signal that finds it on its way to sleep."""
        executor = kind()
        executor.add_node(node)
        with spinning(executor):
            shut_down_at_sleep(queue_of(node))

    @pytest.mark.tf2
    def test_a_task_that_polls_runs(self, buffer, listener, executor, peer):
        turns = itertools.count()

        class Turn:
            def __await__(self):
                yield

        async def poll():
            while not buffer.can_transform("map", "robot", LATEST) or next(turns) < 5:
                await Turn()
            return "there"

        task = executor.create_task(poll())
        with sending(peer()):
            executor.spin_until_future_complete(task, timeout_sec=DEADLINE_S)
        assert task.result() == "there"
