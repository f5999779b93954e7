# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""An executor that spins until a future of a buffer has ended, and sleeps meanwhile, wakes at its end."""

import threading
from contextlib import suppress

import pytest
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor, SingleThreadedExecutor
from rclpy.time import Time
from spinning_nodes import Observer
from times_and_transforms import transform
from waiting import DEADLINE_S, until

from tf2_ros import _rclpy

LONG_S = 100 * DEADLINE_S
ROBOT = transform("map", "robot", 1.0)


def wait(buffer, **how):
    return buffer.wait_for_transform_async("map", "robot", Time(), **how)


class Rounds(Observer):
    """Notes that the executor of a node goes to sleep."""

    def __init__(self, node):
        super().__init__()
        self.began = threading.Event()
        node.add_waitable(self)

    def add_to_wait_set(self, _):
        self.began.set()


@pytest.fixture(params=["the global executor", "one given", "SingleThreaded", "MultiThreaded"])
def spin(request, ros, node):
    """Spins `node` until a future has ended, for at most so many seconds."""
    kind = MultiThreadedExecutor if request.param == "MultiThreaded" else SingleThreadedExecutor
    executor = kind()
    if request.param == "the global executor":
        yield lambda future, timeout: ros.spin_until_future_complete(node, future, timeout_sec=timeout)
    elif request.param == "one given":
        yield lambda future, timeout: ros.spin_until_future_complete(node, future, executor, timeout)
    else:
        executor.add_node(node)
        yield executor.spin_until_future_complete
    executor.shutdown()


@pytest.fixture(params=[None, LONG_S], ids=["without timeout", "with timeout"])
def spun(request, ros, node, spin):
    """
    Has a thread spin until a future has ended, and calls a function once the executor sleeps.

    It fails if the executor sleeps on after the end.
    """

    def spun(future, end):
        rounds = Rounds(node)

        def run():
            with suppress(ExternalShutdownException):
                spin(future, request.param)

        thread = threading.Thread(target=run)
        thread.start()
        # On a busy machine, a timeout may end the future before the thread spins.
        until(lambda: rounds.began.is_set() or not thread.is_alive())
        end()
        thread.join(DEADLINE_S)
        sleeps = thread.is_alive()
        if sleeps:
            ros.shutdown()  # which ends the spin
            thread.join(DEADLINE_S)
        assert not sleeps
        return future

    return spun


def test_a_transform_that_the_program_inserts(buffer, spun):
    future = spun(wait(buffer), lambda: buffer.set_transform(ROBOT, "me"))
    assert future.result().child_frame_id == "robot"


@pytest.mark.parametrize("has_callback", [False, True])
def test_a_transform_that_a_listener_of_another_node_receives(tf2_ros, buffer, new_node, spun, has_callback):
    called = []
    listener = tf2_ros.TransformListener(buffer, new_node("receiving"), spin_thread=True)
    broadcaster = tf2_ros.StaticTransformBroadcaster(new_node("sending"))
    future = wait(buffer)
    if has_callback:
        future.add_done_callback(called.append)
    spun(future, lambda: broadcaster.sendTransform(ROBOT))
    assert future.result().child_frame_id == "robot" and called == [future] * has_callback
    listener.unregister()


def test_a_transform_that_a_listener_of_the_node_receives(tf2_ros, buffer, listener, new_node, spun):
    broadcaster = tf2_ros.StaticTransformBroadcaster(new_node("sending"))
    future = spun(wait(buffer), lambda: broadcaster.sendTransform(ROBOT))
    assert future.result().child_frame_id == "robot"


def test_a_timeout(buffer, tf2_py, spun):
    future = spun(wait(buffer, timeout=Duration(seconds=0.1)), lambda: None)
    assert isinstance(future.exception(), tf2_py.TimeoutException)


def test_an_outcome_that_the_program_sets(buffer, spun):
    future = wait(buffer)
    assert spun(future, lambda: future.set_result("mine")).result() == "mine"
    future = wait(buffer)
    assert isinstance(spun(future, lambda: future.set_exception(KeyError())).exception(), KeyError)


@pytest.mark.skipif(_rclpy.HEEDS_FUTURES, reason="rclpy's executors sleep on, also with rclpy's own futures")
def test_a_cancellation(buffer, spun):
    future = wait(buffer)
    assert spun(future, future.cancel).cancelled()


def test_a_shutdown_of_the_context(ros, buffer, spun):
    assert not spun(wait(buffer), ros.shutdown).done()


def test_an_end_by_a_signal_handler_that_interrupts_the_taking_of_a_task(buffer, ros):
    """It does not wait for the lock that the interrupted code holds."""
    executor = SingleThreadedExecutor()
    future = wait(buffer)
    executor.spin_until_future_complete(future, 0)
    with executor._tasks_lock:
        future.set_result(None)
    if not _rclpy.HEEDS_FUTURES:
        until(lambda: _rclpy.has_tasks(executor))
    executor.shutdown()


class TestTasks:
    """How many tasks an executor gets at the end of a future."""

    @pytest.fixture
    def executor(self, ros, monkeypatch):
        executor = SingleThreadedExecutor()
        create_task, self.created = executor.create_task, []
        monkeypatch.setattr(
            executor, "create_task", lambda *given: (self.created.append(given), create_task(*given))[1]
        )
        yield executor
        executor.shutdown()

    def test_one_for_many_spins(self, buffer, executor):
        future = wait(buffer)
        for _ in range(20):
            executor.spin_until_future_complete(future, 0)
        buffer.set_transform(ROBOT, "me")
        assert len(self.created) == (not _rclpy.HEEDS_FUTURES)

    def test_none_for_a_coroutine_that_awaits_it(self, buffer, executor):
        steps = []

        class Counted:
            def __await__(self):
                for yielded in wait(buffer).__await__():
                    steps.append(yielded)
                    yield yielded

        async def look_up():
            await Counted()

        task = executor.create_task(look_up)
        until(lambda: steps, executor)
        self.created.clear()
        buffer.set_transform(ROBOT, "me")
        # Some releases step the coroutine by a task of rclpy; none is ours.
        assert [call for call, *_ in self.created if call.__module__ == _rclpy.__name__] == []
        until(task.done, executor)
        assert len(steps) == 1 or not _rclpy.RESUMES_TASKS
