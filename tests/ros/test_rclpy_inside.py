# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What is assumed of rclpy's inside holds, where no other test would notice that it does not."""

import threading
import types

import pytest
from rclpy.executors import SingleThreadedExecutor
from waiting import until

from tf2_ros import _rclpy


def test_a_context_is_checked_without_its_lock(ros):
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


@types.coroutine
def _once():
    """Awaits one round of the executor."""
    yield
