# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Who runs a program's callbacks: the thread that inserts, or the executor that spins the node."""

import asyncio
import gc
import signal
import sys
import threading
from contextlib import ExitStack

import pytest
from rclpy.exceptions import InvalidHandle
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.time import Time
from spinning_nodes import EXECUTOR, spinning
from times_and_transforms import transform
from waiting import DEADLINE_S, errors_so_far, until

from tf2_ros import MessageFilter, TimeoutException
from tf2_ros._wait import call_queue
from tf2_ros._wait.call_queue import CallQueue
from tf2_ros._wait.call_runners import ExecutorRunner, Runner, call_queue_of
from tf2_ros._wait.futures import WakingFuture

HERE, CALLBACKS = "MainThread", "tf2_ros callbacks"


@pytest.fixture
def queue(node):
    return call_queue_of(node)


@pytest.fixture
def names():
    """The threads in which calls have run."""
    return []


@pytest.fixture
def note(names):
    return lambda *_: names.append(threading.current_thread().name)


def wait(buffer, *callbacks, **how):
    future = buffer.wait_for_transform_async("map", "robot", Time(seconds=1), **how)
    for callback in callbacks:
        future.add_done_callback(callback)
    return future


def fail(*_):
    raise ValueError("mine")


# What waits, what ends the wait, what its node is, and which thread runs the callbacks.
PLACES = [
    ("future filter changes", "insert", "spun", HERE),
    ("future filter changes", "insert", "unspun", HERE),
    ("future changes", "insert", "absent", HERE),
    ("future filter changes", "add", "spun", HERE),
    ("future", "cancel", "spun", HERE),
    ("future filter changes", "receive", "spun", EXECUTOR),
    ("future filter", "timeout", "spun", EXECUTOR),
    ("future filter", "timeout", "unspun", CALLBACKS),
    ("future", "timeout", "absent", CALLBACKS),
    ("future", "timeout", "destroyed", CALLBACKS),
    ("future", "timeout", "shut down", CALLBACKS),
]


class TestPlaces:
    def begin(self, kind, buffer, node, callbacks, timeout, at_end):
        """Wait, until the end of the test at the latest."""
        if kind == "future":
            return wait(buffer, *callbacks, timeout=timeout)
        if kind == "changes":
            for callback in callbacks:
                at_end.callback(buffer.on_change("map", "robot", callback).cancel)
            return None
        filter = at_end.enter_context(
            MessageFilter(None, buffer, "map", 1, node=node, buffer_timeout=timeout)
        )
        for callback in callbacks:
            filter.registerCallback(callback)
            filter.registerFailureCallback(callback)
        filter.add(transform("robot", "hand", 1))
        return None

    @pytest.mark.parametrize(
        ("kind", "end", "node_is", "place"),
        [(kind, *row) for kinds, *row in PLACES for kind in kinds.split()],
    )
    def test_each_has_its_thread_also_if_a_callback_raises(
        self, buffer, tf2_ros, ros, node, peer, names, note, capfd, kind, end, node_is, place
    ):
        robot = transform("map", "robot", 1)
        with ExitStack() as at_end:
            if node_is != "absent":
                at_end.callback(tf2_ros.TransformListener(buffer, node).unregister)
            if node_is == "spun":
                executor = SingleThreadedExecutor()
                executor.add_node(node)
                at_end.enter_context(spinning(executor))
            if end == "add":
                buffer.set_transform(robot, "me")
            callbacks = [note] if (kind, end) == ("future", "add") else [fail, note]
            future = self.begin(kind, buffer, node, callbacks, 1.0 if end == "timeout" else None, at_end)
            if node_is == "destroyed":
                node.destroy_node()
            if node_is == "shut down":
                ros.shutdown()
            if end == "insert":
                buffer.set_transform(robot, "me")
            elif end == "cancel":
                future.cancel()
            elif end == "receive":
                peer().send(("map", "robot", 10**9, 1))
            if place == HERE:
                assert names == [HERE]
            until(lambda: names)
        assert names == [place]
        until(lambda: errors_so_far().count("ValueError: mine") == len(callbacks) - 1)

    @pytest.mark.parametrize("end", ["insert", "cancel", "timeout"])
    def test_what_each_done_callback_raises_is_logged_with_its_traceback_each_time(
        self, buffer, recwarn, capfd, end
    ):
        """Python would show equal warnings of one place only once."""
        futures = [wait(buffer, fail, timeout=1 if end == "timeout" else None) for _ in range(3)]
        if end == "insert":
            buffer.set_transform(transform("map", "robot", 1), "me")
        elif end == "cancel":
            for future in futures:
                future.cancel()
        until(lambda: errors_so_far().count("ValueError: mine") == 3)
        assert errors_so_far().count("In a callback: Traceback (most recent call last)") == 3
        assert errors_so_far().count('test_callbacks.py", line') == 3
        assert not recwarn.list

    def test_a_callback_that_blocks_delays_no_timeout(self, buffer):
        goes_on, called = threading.Event(), []
        wait(buffer, lambda _: goes_on.wait(DEADLINE_S), timeout=0.01)
        others = [wait(buffer, timeout=0.01), wait(buffer, called.append, timeout=0.01)]
        until(others[0].done)
        assert called == []
        goes_on.set()
        until(lambda: called == [others[1]])

    def test_while_nobody_spins_they_wait_and_one_warning_says_so(
        self, buffer, listener, node, peer, names, note, monkeypatch, capfd
    ):
        monkeypatch.setattr(call_queue, "WARN_S", 0.5)
        future = wait(buffer, note)
        peer().send(("map", "robot", 10**9, 1))
        until(lambda: buffer.can_transform("map", "robot", Time(seconds=1)))
        until(lambda: "nobody spins the node [/" in errors_so_far())
        future.expire()  # as its timeout would
        assert (names, future.done(), repr(future)) == ([], False, "<TransformFuture: queued>")
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        until(lambda: names == [HERE], executor)
        assert future.result().child_frame_id == "robot"
        call_queue_of(node)._tf2_check()
        assert capfd.readouterr().err.count("nobody spins") == 1
        executor.shutdown()

    def test_of_two_listeners_that_which_received_it_runs_them(
        self, tf2_ros, buffer, listener, executor, new_node, peer, names
    ):
        ended = new_node("ended")
        later = tf2_ros.TransformListener(buffer, ended)
        ended.destroy_node()
        future = wait(buffer, names.append)
        peer().send(("map", "robot", 10**9, 1))
        until(lambda: names == [future], executor)
        assert future.exception() is None
        later.unregister()


class TestEndOfTheNode:
    @pytest.mark.parametrize(
        ("end", "text"),
        [
            ("destroyed", r"the node \[/dropped\] was destroyed"),
            ("shut down", r"the context of the node \[/dropped\] was shut down"),
            ("collected", r"the node \[/dropped\] was collected"),
        ],
    )
    def test_queued_futures_end_without_their_callbacks(
        self, tf2_ros, ros, buffer, peer, names, note, end, text
    ):
        node = ros.create_node("dropped")
        listener = tf2_ros.TransformListener(buffer, node)
        future = wait(buffer, note)
        peer().send(("map", "robot", 10**9, 1))
        until(lambda: repr(future) == "<TransformFuture: queued>")

        async def main():
            waiting = asyncio.ensure_future(await_it(future))
            await asyncio.sleep(0)
            return await asyncio.wait_for(waiting, DEADLINE_S)

        listener.unregister()
        if end == "destroyed":
            node.destroy_node()
        elif end == "shut down":
            ros.shutdown()
        else:
            del listener, node
            gc.collect()
        with pytest.raises(tf2_ros.TimeoutException, match=text):
            asyncio.run(main())
        assert names == []
        assert not buffer._tf2_kept

    def test_calls_that_are_put_afterwards_are_dropped(self, new_node, note, names):
        node = new_node("dropped")
        queue = CallQueue(node, ExecutorRunner(node))
        queue.put(note)
        queue.close("it has ended")
        queue.put(note)
        assert not queue.calls
        assert queue not in node.waitables
        assert names == []


async def await_it(future):
    return await future


def test_calls_are_dropped_also_if_their_runner_cannot_leave(node):
    """An executor that is shut down meanwhile raises when it is left."""

    class Stuck(Runner):
        def wake(self):
            """Never run anything."""

        def leave(self):
            raise RuntimeError("destroyed meanwhile")

    queue, future = CallQueue(node, Stuck()), WakingFuture()
    future.add_done_callback(print)
    queue.put(future.end_or_queue("an answer"))
    with pytest.raises(RuntimeError, match="destroyed meanwhile"):
        queue.close("the node [/mine] was destroyed")
    with pytest.raises(TimeoutException, match=r"dropped, because the node \[/mine\] was destroyed"):
        future.result()


def test_a_finalizer_of_a_dropped_callback_does_not_end_its_future_again():
    ended = []

    class Callback:
        def __call__(self, _):
            """Do nothing."""

        def __del__(self):
            ended.append((future.done(), future.cancel()))

    future = WakingFuture()
    future.add_done_callback(Callback())
    call = future.end_or_queue("an answer")
    call.drop("the node was destroyed")
    assert ended == [(True, None)]
    with pytest.raises(TimeoutException, match="dropped, because the node was destroyed"):
        future.result()


def test_a_finalizer_that_reads_what_a_future_waited_for_finds_it_or_nothing(buffer):
    """A name belongs to the wait of a future, whose end may be the end of the name."""
    seen = []

    class Name(str):
        __slots__ = ()

        def __del__(self):
            seen.append(future.wait)
            future.expire()

    future = buffer.wait_for_transform_async(Name("a"), "b", 0)
    future.cancel()
    assert future.cancelled()
    assert seen == [None]


class TestExecutors:
    @pytest.mark.parametrize("kind", [SingleThreadedExecutor, MultiThreadedExecutor])
    def test_one_runs_them_in_their_order_one_at_a_time(self, queue, node, kind):
        executor, order, running = kind(), [], threading.Lock()
        executor.add_node(node)

        def call(n):
            assert running.acquire(blocking=False), "two at once"
            order.append(n)
            running.release()

        with spinning(executor):
            for n in range(100):
                queue.put(lambda n=n: call(n))
            until(lambda: len(order) == 100)
        assert order == list(range(100))

    def test_an_events_executor_polls(self, queue, note, names, node):
        """A thread that wakes it from outside may hang: it waits for no guard condition."""
        executor = pytest.importorskip("rclpy.experimental").EventsExecutor()
        executor.add_node(node)
        putting = threading.Thread(target=lambda: [queue.put(lambda: 1 / 0), queue.put(note)])
        putting.start()
        putting.join(DEADLINE_S)
        until(lambda: names, executor)
        executor.remove_node(node)
        executor.spin_once(timeout_sec=0)
        ordinary = SingleThreadedExecutor()
        ordinary.add_node(node)
        queue.put(note)
        until(lambda: len(names) == 2, ordinary)
        assert names == [HERE] * 2
        # A round does not cause the next one.
        woken = []
        ordinary.wake = lambda: woken.append(1)
        assert not queue.runner.is_ready(object())
        assert woken == []
        ordinary.shutdown()
        executor.shutdown()


def test_what_calls_raise_is_logged_and_what_ends_a_program_ends_the_spin_of_the_main_thread(
    queue, note, names, node, capfd
):
    def put_all():
        for call in (lambda: 1 / 0, sys.exit, note):
            queue.put(call)

    executor = SingleThreadedExecutor()
    executor.add_node(node)
    put_all()
    with pytest.raises(SystemExit):
        until(lambda: False, executor)
    assert "ZeroDivisionError" in errors_so_far()
    until(lambda: names, executor)
    put_all()
    with spinning(executor):
        until(lambda: len(names) == 2)


def test_threads_signal_handlers_and_finalizers_may_put_and_each_call_is_run_once(queue, executor):
    done = []

    class Ends:
        def __del__(self):
            queue.put(lambda: done.append("finalizer"))

    def put():
        for _ in range(500):
            queue.put(lambda: done.append("thread"))
            Ends()

    threads = [threading.Thread(target=put) for _ in range(4)]
    before = signal.signal(signal.SIGUSR1, lambda *_: queue.put(lambda: done.append("handler")))
    try:
        for thread in threads:
            thread.start()
        for _ in range(20):
            signal.raise_signal(signal.SIGUSR1)
            executor.spin_once(0)
        until(lambda: len(done) == 4020, executor)
    finally:
        signal.signal(signal.SIGUSR1, before)
        for thread in threads:
            thread.join()
    assert (done.count("thread"), done.count("finalizer"), done.count("handler")) == (2000, 2000, 20)


class TestBadInput:
    def test_a_loop_that_was_closed_while_it_awaited(self, buffer):
        loop = asyncio.new_event_loop()
        future = wait(buffer)
        task = loop.create_task(await_it(future))
        loop.run_until_complete(asyncio.sleep(0))
        task._log_destroy_pending = False
        loop.close()
        until(lambda: not buffer._tf2_kept)
        buffer.set_transform(transform("map", "robot", 1), "me")
        assert future.result().child_frame_id == "robot"

    def test_a_node_that_was_destroyed(self, tf2_ros, node, buffer):
        node.destroy_node()
        for use in (
            lambda: call_queue_of(node),
            lambda: tf2_ros.MessageFilter(None, buffer, "map", 1, node=node),
            lambda: tf2_ros.BufferClient(node, "lookup"),
            lambda: tf2_ros.BufferServer(buffer, node, "lookup"),
            lambda: tf2_ros.TransformListener(buffer, node),
        ):
            with pytest.raises(InvalidHandle):
                use()
        future = wait(buffer, print, timeout=0.01)  # and the buffer is as good as new
        until(future.done)
        assert isinstance(future.exception(), tf2_ros.TimeoutException)
