"""A forked child of a process with listeners: what it has of them, and that nothing in it hangs."""

import asyncio
import gc
import json
import subprocess
import threading
import weakref

import pytest
from forking import CHILD_S, in_a_child
from making import transform
from processes import start, until
from rclpy.duration import Duration
from rclpy.time import Time
from repetitions import times

pytestmark = pytest.mark.ours

LATEST = Time()


@pytest.fixture
def buffer(tf2_ros):
    return tf2_ros.Buffer()


def statuses_of_children(what, count, rate=0):
    """How the children of `programs/forks.py` end, where so many messages a second arrive."""
    flood = start("flood.py", str(rate), "20", "0", stdout=subprocess.DEVNULL) if rate else None
    program = start("forks.py", what, str(count), str(rate), stdout=subprocess.PIPE)
    try:
        return json.loads(program.communicate(timeout=8 * CHILD_S)[0])
    finally:
        for process in filter(None, (program, flood)):
            process.kill()
            process.wait()


@pytest.mark.parametrize("what", ["use", "drop", "exit", "multiprocessing"])
class TestChildren:
    def test_of_a_process_that_rests(self, what):
        assert statuses_of_children(what, 3) == [0] * 3

    def test_of_a_process_whose_every_thread_is_busy(self, what):
        """In an insert, a vector lookup, a listing, a wait, a callback, the receiver and an executor."""
        count = times(40, 200) if what == "drop" else 20
        assert statuses_of_children(what, count, rate=500) == [0] * count


def test_no_first_use_of_a_buffer_imports_anything():
    """A child that is forked while another thread imports a module waits forever if it needs that module."""
    program = start("first_uses.py", stdout=subprocess.PIPE)
    try:
        assert json.loads(program.communicate(timeout=CHILD_S)[0]) == []
        assert program.returncode == 0
    finally:
        program.kill()


class TestWaitsOfTheParent:
    def test_their_timeouts_pass_in_the_parent_alone(self, buffer):
        ended = []
        future = buffer.wait_for_transform_async("map", "robot", LATEST, timeout=Duration(seconds=0.5))
        future.add_done_callback(ended.append)

        def wait_longer():
            other = buffer.wait_for_transform_async("map", "arm", LATEST, timeout=Duration(seconds=0.7))
            until(other.done)
            assert not ended

        assert in_a_child(wait_longer) == 0
        until(lambda: ended)

    def test_a_future_is_dead_in_a_child_and_says_so(self, buffer):
        future = buffer.wait_for_transform_async("map", "robot", LATEST)
        called = []
        future.add_done_callback(called.append)

        async def wait():
            return await future

        def insert():
            buffer.set_transform(transform("map", "robot", 1), "child")
            assert not called
            assert repr(future) == "<TransformFuture: dead in this forked process>"
            with pytest.raises(RuntimeError, match="dead in this forked process"):
                asyncio.run(wait())
            assert buffer.wait_for_transform_async("map", "robot", LATEST).done()

        assert repr(future) == "<TransformFuture: pending>"
        assert in_a_child(insert) == 0
        buffer.set_transform(transform("map", "robot", 1), "parent")
        assert called == [future]
        assert repr(future) == "<TransformFuture: done>"

    def test_a_filter_and_its_iterations_are_dead_in_a_child(self, tf2_ros, node, buffer):
        message = transform("robot", "arm", 1)
        with tf2_ros.MessageFilter(None, buffer, "map", 10, node=node) as message_filter:
            passed, stream = [], message_filter.__aiter__()
            message_filter.registerCallback(passed.append)
            message_filter.add(message)

            async def take():
                return [item async for item in stream]

            def use():
                message_filter.add(message)
                buffer.set_transform(transform("map", "robot", 1), "child")
                assert repr(message_filter).endswith("dead in this forked process>")
                assert asyncio.run(take()) == []
                message_filter.close()
                assert passed == []

            assert in_a_child(use) == 0

    def test_a_lock_of_a_thread_that_is_not_in_the_child_is_free_there(self, tf2_ros, node, buffer):
        """Threads of the parent are in the middle of each of these when the child is made."""
        broadcaster = tf2_ros.StaticTransformBroadcaster(node)
        message_filter = tf2_ros.MessageFilter(None, buffer, "map", 10, node=node)
        locks = [
            broadcaster._tf2_sending,
            message_filter._counts_lock,
            message_filter._pending._lock,
        ]
        held, ending = threading.Event(), threading.Event()

        def hold():
            for lock in locks:
                lock.acquire()
            held.set()
            ending.wait()
            for lock in locks:
                lock.release()

        def use():
            message = transform("map", "robot", 1)
            message_filter.add(message)
            message_filter.setQueueSize(5)
            assert message_filter.statistics()["received"] == 0
            message_filter.close()
            with broadcaster._tf2_sending:
                pass

        thread = threading.Thread(target=hold)
        thread.start()
        try:
            assert held.wait(CHILD_S)
            assert in_a_child(use) == 0
        finally:
            ending.set()
            thread.join()


class TestListenerOfTheParent:
    def test_it_is_dead_and_its_buffer_is_freed(self, tf2_ros, node):
        buffer = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(buffer, node)

        def drop():
            nonlocal buffer, listener
            assert not listener.receives
            freed = weakref.ref(buffer)
            listener.unregister()
            listener.buffer = None
            buffer = None
            gc.collect()
            assert freed() is None

        try:
            assert in_a_child(drop) == 0
            assert listener.receives
        finally:
            listener.unregister()

    def test_a_context_manager_ends_in_the_child_without_effect(self, tf2_ros, node, buffer):
        with tf2_ros.TransformListener(buffer, node) as listener:
            assert in_a_child(lambda: listener.__exit__(None, None, None)) == 0
            assert listener.receives

    def test_one_that_spins_the_node_is_dead_too(self, tf2_ros, buffer, ros):
        listener = tf2_ros.TransformListener(buffer, None)

        def drop():
            listener.unregister()
            listener.__del__()
            assert not listener.dedicated_listener_thread.is_alive()

        try:
            assert in_a_child(drop) == 0
            assert listener.dedicated_listener_thread.is_alive()
        finally:
            listener.__del__()


def test_a_child_whose_parent_had_no_ros_has_all_of_it():
    """As with multiprocessing in a program that only imports this."""
    program = start("forks_first.py", stdout=subprocess.PIPE)
    try:
        assert program.communicate(timeout=CHILD_S)[0] == "True\n"
        assert program.returncode == 0
    finally:
        program.kill()
