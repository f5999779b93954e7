# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What runs the coroutines of programs: executors, asyncio loops, and one inside the other."""

import asyncio
import sys
import threading
from contextlib import contextmanager

import pytest
from async_node_standin import AsyncNode
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from spinning_nodes import spinning
from waiting import DEADLINE_S, until

from tf2_ros._rclpy import RESUMES_TASKS

# Each is a context manager. It takes a node, and gives a function that starts a function of a coroutine.


@contextmanager
def _executor(kind, node):
    executor = kind()
    executor.add_node(node)
    with spinning(executor):
        yield executor.create_task


def single_threaded(node):
    return _executor(SingleThreadedExecutor, node)


def multi_threaded(node):
    return _executor(MultiThreadedExecutor, node)


@contextmanager
def events(node):
    if not RESUMES_TASKS:
        pytest.skip("the EventsExecutor of this rclpy hangs when another thread publishes")
    executor = pytest.importorskip("rclpy.experimental").EventsExecutor()
    executor.add_node(node)
    thread = threading.Thread(target=executor.spin)
    thread.start()
    try:
        yield executor.create_task
    finally:
        executor.shutdown()
        thread.join(DEADLINE_S)
    assert not thread.is_alive()


@contextmanager
def _thread_of_loop(main):
    """A thread runs a coroutine, which is given an event of asyncio that ends it, in a loop."""
    begun = []

    async def run():
        begun.append((asyncio.get_running_loop(), ending := asyncio.Event()))
        await main(ending)

    thread = threading.Thread(target=lambda: asyncio.run(run()))
    thread.start()
    until(lambda: begun)
    loop, ending = begun[0]
    try:
        yield loop
    finally:
        loop.call_soon_threadsafe(ending.set)
        thread.join(DEADLINE_S)
    assert not thread.is_alive()


@contextmanager
def loop(_):
    with _thread_of_loop(asyncio.Event.wait) as running:
        yield lambda work: asyncio.run_coroutine_threadsafe(work(), running)


@contextmanager
def executor_in_loop(node):
    """A coroutine of a loop spins an executor, which has the task."""
    executor = SingleThreadedExecutor()
    executor.add_node(node)

    async def spin(ending):
        while not ending.is_set():
            executor.spin_once(timeout_sec=0.2)
            await asyncio.sleep(0)

    with _thread_of_loop(spin):
        yield executor.create_task
    executor.shutdown()


@contextmanager
def loop_in_task(node):
    """A task of an executor runs a loop."""
    with _executor(SingleThreadedExecutor, node) as create_task:
        yield lambda work: create_task(lambda: asyncio.run(work()))


@contextmanager
def async_node(_):
    """A coroutine beside a node that the loop runs."""
    if sys.version_info < (3, 11):
        pytest.skip("asyncio has no TaskGroup")

    async def run(ending):
        async with AsyncNode("beside"):
            await ending.wait()

    with _thread_of_loop(run) as running:
        yield lambda work: asyncio.run_coroutine_threadsafe(work(), running)


ALL = (
    single_threaded,
    multi_threaded,
    events,
    loop,
    executor_in_loop,
    loop_in_task,
    async_node,
)
