"""What is assumed of rclpy's inside holds, and the ordinary way is taken where it does not."""

import re
import sys
import threading
import types
from pathlib import Path

import pytest
from processes import until
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from rclpy.waitable import NumberOfEntities, Waitable
from spinning import spinning

from tf2_msgs.msg import TFMessage
from tf2_ros import _rclpy
from tf2_ros._wait import endings, rounds


def ignore(message):
    """A callback. Not a builtin: in Python 3.10 these have no signature, which rclpy reads."""


pytestmark = pytest.mark.ours


class Probe(Waitable):
    """What an executor calls in its rounds."""

    def __enter__(self):
        return self

    def __exit__(self, *_):
        return None

    def get_num_entities(self):
        return NumberOfEntities()

    def add_to_wait_set(self, wait_set):
        return None

    def is_ready(self, wait_set):
        return False


class TestHandles:
    def test_a_handle_has_the_address_of_its_rcl_struct(self, node):
        parts = [node, node.create_timer(1.0, print), node.create_publisher(TFMessage, "somewhere", 1)]
        pointers = {part.handle.pointer for part in parts}
        assert 0 not in pointers and len(pointers) == len(parts)

    def test_a_handle_in_use_is_destroyed_afterwards(self, node):
        handle = node.create_guard_condition(None).handle
        assert _rclpy.handle_exists(handle)
        with handle:
            handle.destroy_when_not_in_use()
            handle.trigger_guard_condition()
        assert not _rclpy.handle_exists(handle)

    def test_a_context_is_checked_without_its_lock(self, ros):
        context = ros.Context()
        assert not _rclpy.context_was_shut_down(context)
        context.init(args=[])
        checked = []
        with context._lock:
            thread = threading.Thread(target=lambda: checked.append(_rclpy.context_was_shut_down(context)))
            thread.start()
            until(lambda: checked)
        assert checked == [False]
        context.shutdown()
        assert _rclpy.context_was_shut_down(context)


class TestExecutors:
    @pytest.fixture
    def executor(self, ros):
        executor = SingleThreadedExecutor()
        yield executor
        executor.shutdown()

    def test_one_that_is_marked_ends_its_spin(self, executor):
        with spinning(executor):
            assert not _rclpy.is_shut_down(executor)
            _rclpy.mark_shut_down(executor)
        assert _rclpy.is_shut_down(executor)
        executor.shutdown()
        _rclpy.wake(executor)

    def test_one_that_gave_a_node_away_remains_its_attribute(self, node, executor):
        assert not _rclpy.is_in_executor(node)
        executor.add_node(node)
        assert _rclpy.is_in_executor(node)
        executor.remove_node(node)
        assert node.executor is executor
        assert not _rclpy.is_in_executor(node)

    def test_a_task_is_known_until_it_is_done(self, executor):
        assert not _rclpy.has_tasks(None)
        assert not _rclpy.has_tasks(executor)
        ending = []

        async def polls():
            while not ending:
                await _once()

        task = executor.create_task(polls)
        executor.spin_once(timeout_sec=0.1)
        assert _rclpy.has_tasks(executor)
        ending.append(True)
        until(lambda: task.done() and not _rclpy.has_tasks(executor), executor)
        assert _rclpy.has_tasks(object())


class TestRounds:
    """What tf2_ros._wait.rounds assumes."""

    @pytest.mark.parametrize(
        ("spin", "own"),
        [("spin", True), ("spin_until_future_complete", True), ("rclpy.spin", True), ("spin_once", False)],
    )
    def test_an_executors_own_loops_are_on_the_stack(self, ros, node, spin, own):
        executor, found = SingleThreadedExecutor(), []

        class Observing(Probe):
            def add_to_wait_set(self, wait_set):
                # The waitable of a receiver is compiled, so it has no frame.
                found.append(rounds.is_below_own_loop(sys._getframe(1)))

        def end():
            raise KeyboardInterrupt

        node.add_waitable(Observing(ReentrantCallbackGroup()))
        node.create_timer(0.01, end)
        executor.add_node(node)
        ways = {
            "spin": executor.spin,
            "spin_until_future_complete": lambda: executor.spin_until_future_complete(Future()),
            "rclpy.spin": lambda: ros.spin(node, executor),
            "spin_once": lambda: until(lambda: False, executor),
        }
        with pytest.raises(KeyboardInterrupt):
            ways[spin]()
        assert set(found) == {own}
        executor.shutdown()


class TestTasksAndFutures:
    def test_a_step_is_on_the_stack_with_its_task(self, ros, executor):
        found = []

        async def step():
            found.append(_rclpy.running_task())

        task = executor.create_task(step)
        until(task.done, executor)
        assert found == [task]
        assert _rclpy.task_executor(task) is executor

    def test_other_threads_can_see_that_a_task_is_in_its_step(self, executor):
        seen = []

        def step():
            seen.append(_rclpy.is_in_step(task))

        task = executor.create_task(step)
        until(task.done, executor)
        assert seen == [True]
        assert not _rclpy.is_in_step(task)

    def test_what_an_executor_adds_to_a_future_only_wakes_it(self, ros, node, monkeypatch):
        added = []

        class Watching(Future):
            def add_done_callback(self, callback):
                added.append(callback)
                super().add_done_callback(callback)

        ros.spin_until_future_complete(node, Watching(), timeout_sec=0.01)
        assert added
        assert all(endings.only_wakes(callback) for callback in added)
        assert not endings.only_wakes(print)


def test_only_one_module_reads_rclpys_inside():
    names = r"\._(is_shutdown|sigint_gc|executor\(|task_lock|get_result)"
    package = Path(_rclpy.__file__).parent
    readers = [path.name for path in package.rglob("*.py") if re.search(names, path.read_text())]
    assert readers == ["_rclpy.py"]


@types.coroutine
def _once():
    """Awaits one round of the executor."""
    yield
