# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A signal handler that raises at a random moment, as Ctrl-C does, leaves nothing that hangs."""

import asyncio
import itertools
import linecache
import sys
import threading
import time
from _thread import start_new_thread
from contextlib import contextmanager
from functools import partial
from types import SimpleNamespace

import pytest
from geometry_msgs.msg import PointStamped
from paths import PROGRAMS
from processes import output_of
from rclpy.time import Time
from spinning_nodes import spinning
from times_and_transforms import at, transform
from waiting import DEADLINE_S, until

import tf2_py
import tf2_ros
from tf2_ros._calls.call_queue import CallQueue
from tf2_ros._calls.call_runners import Runner
from tf2_ros._live_objects import LiveObjects
from tf2_ros._process import threads
from tf2_ros._process.background import Background
from tf2_ros._receive.inbox import Inboxes
from tf2_ros._wait.pending import Waker

pytestmark = pytest.mark.ours

PACKAGES = (*tf2_py.__path__, *tf2_ros.__path__)  # installed, they are not beside the tests


class Interrupt(BaseException):
    """What the handler raises."""


def _raise():
    raise Interrupt


@contextmanager
def interrupted(line, handler=_raise, files=PACKAGES):
    """Call a handler once, before the line with this number, from 1, of those that these files run."""
    count = SimpleNamespace(left=line, reached=False)

    def trace(frame, event, _):
        code = frame.f_code
        if not code.co_filename.startswith(files):
            return None
        # A `with` is traced a second time before its end, where no signal is handled.
        text = linecache.getline(code.co_filename, frame.f_lineno)
        if event == "line" and not text.lstrip().startswith("with "):
            count.left -= 1
            if count.left == 0:
                count.reached = True
                sys.settrace(None)
                handler()
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        yield count
    except Interrupt:
        pass
    finally:
        sys.settrace(before)


def each_line():
    """Yield 1, 2, … and `interrupted` with that line, until a block under it has fewer lines."""
    counts = []

    @contextmanager
    def begin(line, *handler):
        with interrupted(line, *handler) as count:
            counts.append(count)
            yield count

    for line in itertools.count(1):
        yield line, partial(begin, line)
        if not counts[-1].reached:
            break
    assert line > 1, "nothing was interrupted"


@pytest.mark.skipif(
    sys.version_info >= (3, 14), reason="CPython 3.14 leaves a lock locked if a signal raises in its `with`"
)
@pytest.mark.parametrize("how", [[], ["switch"], ["collector", "finalizer"]], ids=lambda how: "-".join(how))
def test_chance_finds_nothing_that_hangs(how):
    """By hand for minutes: ``cd tests/support; PYTHONPATH=. python programs/interrupts_at_random.py 60``."""
    assert "[]" in output_of(PROGRAMS / "interrupts_at_random.py", 3, *how)


def point(seconds):
    message = PointStamped()
    message.header.frame_id, message.header.stamp = "robot", at(seconds).to_msg()
    return message


def test_the_end_of_a_live_object_runs_no_line_of_python():
    """Python would drop what a handler raises in the callback of a weak reference."""
    objects, one = LiveObjects(), Interrupt()
    objects.add(one)
    with interrupted(1) as count:
        del one
    assert not count.reached
    assert not objects._references


class TestEachLine:
    """A handler that raises before any of the lines of an insert, or of an addition, ends only that one."""

    def test_ending_a_future_and_following_changes_run_no_line_of_python(self, buffer):
        called, changes = [], []
        future = buffer.wait_for_transform_async("map", "robot", at(1), timeout=DEADLINE_S)
        future.add_done_callback(called.append)
        subscription = buffer.on_change("map", "robot", changes.append)
        with interrupted(1) as count:
            buffer.set_transform(transform("map", "robot", 1), "x")
            buffer.set_transform(transform("map", "robot", 2), "x")
        assert (called, len(changes)) == ([future], 2)
        assert not count.reached
        subscription.cancel()
        assert buffer.statistics()["waiters"] == 0

    def test_all_but_one_task_of_asyncio_go_on(self, buffer):
        async def two_are_done(tasks):
            while sum(task.done() for task in tasks) < 2:
                await asyncio.sleep(0.005)

        async def main():
            for second, interrupt_at_each_line in each_line():
                awaits = [buffer.lookup_transform_async("map", "robot", at(second)) for _ in range(3)]
                tasks = [asyncio.ensure_future(one) for one in awaits]
                await asyncio.sleep(0)
                with interrupt_at_each_line():
                    buffer.set_transform(transform("map", "robot", second), "x")
                await asyncio.wait_for(two_are_done(tasks), DEADLINE_S)

        asyncio.run(main())

    def test_all_but_one_task_of_an_executor_go_on(self, buffer, executor):
        with spinning(executor):
            for second, interrupt_at_each_line in each_line():
                futures = [buffer.wait_for_transform_async("map", "robot", at(second)) for _ in range(3)]
                began = []

                async def follow(future, began=began):
                    began.append(future)
                    await future

                tasks = [executor.create_task(follow, future) for future in futures]
                until(lambda began=began: len(began) == 3)
                with interrupt_at_each_line():
                    buffer.set_transform(transform("map", "robot", second), "x")
                until(lambda tasks=tasks: sum(task.done() for task in tasks) >= 2)

    @pytest.mark.parametrize("closes", [False, True])
    def test_an_addition_that_is_interrupted_or_closed_leaves_no_message(self, buffer, tf2_ros, node, closes):
        for _, interrupt_at_each_line in each_line():
            with tf2_ros.MessageFilter(None, buffer, "map", 10, node=node) as filter:
                with interrupt_at_each_line(*[filter.close] * closes) as count:
                    filter.add(point(1))
                assert filter.statistics()["waiting"] == (0 if count.reached else 1)

    def test_a_handler_may_insert_what_is_being_added_to_a_filter(self, tf2_ros, node, executor):
        buffer, passed = tf2_ros.Buffer(cache_time=1e6), []
        with tf2_ros.MessageFilter(None, buffer, ("map", "base"), 0, node=node) as filter:
            filter.registerCallback(lambda message: passed.append(message.header.stamp.sec))
            buffer.set_transform_static(transform("map", "base"), "x")
            for line, interrupt_at_each_line in each_line():
                message = transform("map", "robot", line)
                with interrupt_at_each_line(lambda message=message: buffer.set_transform(message, "x")):
                    filter.add(point(line))
                buffer.set_transform(message, "x")
                until(lambda line=line: passed == [line], executor)
                passed.clear()
            assert line > 10


@pytest.fixture
def background():
    """One of a test, whose thread has not begun."""
    inboxes = Inboxes()
    yield Background(inboxes)
    inboxes.stop()


def surplus_threads():
    """Background threads that run beside the one that is registered, or that are about to end."""
    alive = [thread for thread in threading.enumerate() if thread.name == "tf2_ros background"]
    return [thread for thread in alive if thread not in threads.running.values()]


class Expires:
    def __init__(self):
        self.expired = threading.Event()
        self.over, self.expire = self.expired.is_set, self.expired.set


def test_a_timeout_starts_its_thread_without_a_line_of_python():
    """In a line of `Thread.start`, what a handler raises would become an error of a lock."""
    for line in range(1, 60):  # the lines of `threading` run in a `Thread.start` are fewer
        inboxes, wait = Inboxes(), Expires()
        with interrupted(line, files=(threading.__file__,)) as count:
            Background(inboxes).expire_at(0, wait)
        assert not count.reached
        assert wait.expired.wait(DEADLINE_S)
        inboxes.stop()


def test_an_interrupt_just_after_the_start_of_the_background_thread_leaves_one(monkeypatch, background):
    def interrupted_start(*arguments):
        start_new_thread(*arguments)
        raise Interrupt

    later, now = Expires(), Expires()
    with monkeypatch.context() as patch:
        patch.setattr(threads, "start_new_thread", interrupted_start)
        with pytest.raises(Interrupt):
            background.expire_at(time.monotonic_ns() + 10**15, later)
    background.expire_at(0, now)
    assert now.expired.wait(DEADLINE_S)
    until(lambda: not surplus_threads())


def test_a_call_that_is_put_stays_although_a_signal_handler_raises(node):
    call_queue = CallQueue(node, Runner())
    call_queue.runner.wake = lambda: None
    for line, interrupt_at_each_line in each_line():
        with interrupt_at_each_line():
            call_queue.put(line)
        assert call_queue.calls.pop() == line


def test_calls_that_a_signal_handler_keeps_from_being_dropped_are_dropped_later(tf2_ros, buffer, node):
    class Interrupted(Waker):
        def __call__(self, _):
            raise Interrupt

    call_queue = CallQueue(node, Runner())
    call_queue.runner.wake = lambda: None
    futures = [buffer.wait_for_transform_async("map", "robot", Time()) for _ in range(3)]
    for future in futures:
        future.add_done_callback(print)
        future.add_done_callback(Interrupted())
        call_queue.calls.append(future.end_or_queue(None))
    with pytest.raises(Interrupt):
        call_queue.close("the test drops them")
    for _ in range(2):
        with pytest.raises(Interrupt):
            call_queue._tf2_check()
    assert all("the test drops them" in str(future.exception()) for future in futures)


def test_a_thread_whose_start_is_interrupted_ends(tf2_ros, node, buffer, monkeypatch):
    """Most of `Thread.start` is a wait, until the new thread runs."""
    start = threading.Thread.start

    def interrupted_start(thread):
        start(thread)
        if thread.name == "tf2_ros listener":
            raise Interrupt

    monkeypatch.setattr(threading.Thread, "start", interrupted_start)
    with pytest.raises(Interrupt):
        tf2_ros.TransformListener(buffer, node, spin_thread=True)
    monkeypatch.undo()
    until(lambda: "tf2_ros listener" not in [thread.name for thread in threading.enumerate()])
