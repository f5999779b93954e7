"""Who runs a program's callbacks: the thread that inserts, or the executor that spins the node."""

import asyncio
import gc
import signal
import sys
import threading
import warnings
from contextlib import ExitStack

import pytest
from making import transform
from processes import DEADLINE_S, errors_so_far, until
from rclpy.exceptions import InvalidHandle
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.time import Time
from spinning import EXECUTOR, spinning

from tf2_ros._wait import callbacks
from tf2_ros._wait.callbacks import CallbackQueue, callback_queue

pytestmark = pytest.mark.ours

HERE, DEADLINES = "MainThread", "tf2_ros deadlines"


@pytest.fixture
def queue(node):
    return callback_queue(node)


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


def fail(_):
    raise ValueError("mine")


def known(buffer):
    until(lambda: buffer.can_transform("map", "robot", Time(seconds=1)))


class TestPlaces:
    """What ends the wait, whether its node is spun, and which thread runs the callbacks."""

    @pytest.mark.parametrize(
        ("end", "node_is", "place"),
        [
            ("insert", "absent", HERE),
            ("insert", "unspun", HERE),
            ("insert", "spun", HERE),
            ("cancel", "spun", HERE),
            ("add", "spun", HERE),
            ("receive", "spun", EXECUTOR),
            ("timeout", "spun", EXECUTOR),
            ("timeout", "unspun", DEADLINES),
            ("timeout", "absent", DEADLINES),
        ],
    )
    def test_each_has_its_thread_also_if_a_callback_raises(
        self, tf2_ros, node, peer, names, note, end, node_is, place
    ):
        buffer = tf2_ros.Buffer()
        with ExitStack() as at_end, warnings.catch_warnings(record=True) as warned:
            if node_is != "absent":
                at_end.callback(tf2_ros.TransformListener(buffer, node).unregister)
            if node_is == "spun":
                executor = SingleThreadedExecutor()
                executor.add_node(node)
                at_end.enter_context(spinning(executor))
            if end == "add":
                buffer.set_transform(transform("map", "robot", 1), "me")
                future = wait(buffer, note)
            else:
                future = wait(buffer, fail, note, timeout=0.05 if end == "timeout" else None)
            if end == "insert":
                buffer.set_transform(transform("map", "robot", 1), "me")
            elif end == "cancel":
                future.cancel()
            elif end == "receive":
                peer().send(("map", "robot", 10**9, 1))
            if place == HERE:
                assert names == [HERE]
            until(lambda: names)
        assert names == [place]
        assert [str(one.message) for one in warned if "mine" in str(one.message)] == (
            [] if end == "add" else ["Unhandled exception in done callback: mine"]
        )
        assert future.cancelled() == (end == "cancel")
        assert (future.exception() is not None) == (end == "timeout")

    def test_spinning_another_node_until_such_a_future_is_complete(self, ros, tf2_ros, node, new_node, names):
        """With the program's own insert, as in tests of node classes that nobody spins."""
        buffer, other = tf2_ros.Buffer(), new_node("other")
        listener = tf2_ros.TransformListener(buffer, node)
        future = wait(buffer, names.append)
        other.create_timer(0.01, lambda: buffer.set_transform(transform("map", "robot", 1), "me"))
        ros.spin_until_future_complete(other, future, timeout_sec=DEADLINE_S)
        assert names == [future]
        listener.unregister()

    def test_while_nobody_spins_they_wait_and_one_warning_says_so(
        self, tf2_ros, node, peer, names, note, monkeypatch, capfd
    ):
        monkeypatch.setattr(callbacks, "WARN_S", 0.5)
        buffer, publisher = tf2_ros.Buffer(), peer()
        listener = tf2_ros.TransformListener(buffer, node)
        future = wait(buffer, note)
        publisher.send(("map", "robot", 10**9, 1))
        known(buffer)
        until(lambda: "nobody spins the node [/" in errors_so_far())
        future.expire()  # as its timeout would
        assert (names, future.done(), repr(future)) == ([], False, "<TransformFuture: queued>")
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        until(lambda: names == [HERE], executor)
        assert future.result().child_frame_id == "robot"
        callback_queue(node)._tf2_check()
        assert capfd.readouterr().err.count("nobody spins") == 1
        listener.unregister()
        executor.shutdown()

    def test_of_two_listeners_that_which_received_it_runs_them(self, tf2_ros, new_node, peer, names):
        buffer, ended, spun = tf2_ros.Buffer(), new_node("ended"), new_node("spun")
        listeners = [tf2_ros.TransformListener(buffer, node) for node in (spun, ended)]
        ended.destroy_node()
        future = wait(buffer, names.append)
        peer().send(("map", "robot", 10**9, 1))
        executor = SingleThreadedExecutor()
        executor.add_node(spun)
        until(lambda: names == [future], executor)
        assert future.exception() is None
        for listener in listeners:
            listener.unregister()
        executor.shutdown()


class TestEndOfTheNode:
    @pytest.mark.parametrize(
        ("end", "text"),
        [
            ("destroyed", r"the node \[/dropped\] was destroyed"),
            ("shut down", r"the context of the node \[/dropped\] was shut down"),
            ("collected", r"the node \[/dropped\] was collected"),
        ],
    )
    @pytest.mark.parametrize("awaited", [True, False])
    def test_queued_futures_end_without_their_callbacks(
        self, tf2_ros, ros, peer, names, note, end, text, awaited
    ):
        context = ros.Context()
        context.init(domain_id=ros.get_default_context().get_domain_id())
        node = ros.create_node("dropped", context=context)
        buffer = tf2_ros.Buffer()
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
            context.shutdown()
        else:
            del listener, node
            gc.collect()
        with pytest.raises(tf2_ros.TimeoutException, match=text):
            asyncio.run(main()) if awaited else until(future.done) and future.result()
        assert names == []
        assert not buffer._tf2_kept
        context.try_shutdown()

    @pytest.mark.parametrize("end", ["destroyed", "shut down"])
    def test_a_timeout_ends_a_wait_whose_listener_an_executor_served(self, tf2_ros, ros, names, note, end):
        class Logging(tf2_ros.Buffer):
            def set_transform(self, *arguments):
                super().set_transform(*arguments)

        context = ros.Context()
        context.init(domain_id=ros.get_default_context().get_domain_id())
        node, buffer = ros.create_node("served", context=context), Logging()
        listener = tf2_ros.TransformListener(buffer, node)
        future = wait(buffer, note, timeout=0.1)
        node.destroy_node() if end == "destroyed" else context.shutdown()
        until(lambda: names)
        assert isinstance(future.exception(), tf2_ros.TimeoutException)
        listener.unregister()
        context.try_shutdown()

    def test_calls_that_are_put_afterwards_are_dropped(self, new_node, note, names):
        node = new_node("dropped")
        queue = CallbackQueue(node)
        queue.put(note)
        queue.close("it has ended")
        queue.put(note)
        assert not queue.calls
        assert queue not in node.waitables
        assert names == []


async def await_it(future):
    return await future


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

    def test_none_runs_beside_a_callback_of_the_node(self, queue, node):
        executor, begun, go_on, order = SingleThreadedExecutor(), threading.Event(), threading.Event(), []

        def work():
            timer.cancel()
            begun.set()
            go_on.wait(DEADLINE_S)
            order.append("callback ends")

        timer = node.create_timer(0.0, work)
        executor.add_node(node)
        with spinning(executor):
            assert begun.wait(DEADLINE_S)
            queue.put(lambda: order.append("call"))
            go_on.set()
            until(lambda: len(order) == 2)
        assert order == ["callback ends", "call"]

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
        ordinary.shutdown()
        executor.shutdown()


class TestRaisingCalls:
    def test_what_one_raises_is_logged_and_the_rest_are_run(self, queue, note, names, executor):
        queue.put(lambda: 1 / 0)
        queue.put(note)
        until(lambda: names, executor)
        until(lambda: "ZeroDivisionError" in errors_so_far())

    def test_what_ends_a_program_ends_the_spin_of_the_main_thread(self, queue, note, names, executor):
        queue.put(sys.exit)
        queue.put(note)
        with pytest.raises(SystemExit):
            until(lambda: False, executor)
        until(lambda: names, executor)

    def test_in_another_thread_it_is_logged(self, queue, note, names, node):
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        queue.put(sys.exit)
        queue.put(note)
        with spinning(executor):
            until(lambda: names)


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
    def test_a_loop_that_was_closed_while_it_awaited(self, tf2_ros):
        buffer, loop = tf2_ros.Buffer(), asyncio.new_event_loop()
        future = wait(buffer)
        task = loop.create_task(await_it(future))
        loop.run_until_complete(asyncio.sleep(0))
        task._log_destroy_pending = False
        loop.close()
        buffer.set_transform(transform("map", "robot", 1), "me")
        assert future.result().child_frame_id == "robot"

    def test_a_node_that_was_destroyed(self, tf2_ros, new_node):
        node, buffer = new_node("destroyed"), tf2_ros.Buffer()
        node.destroy_node()
        for use in (
            lambda: callback_queue(node),
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
