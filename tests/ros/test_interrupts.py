"""A signal handler that raises at a random moment, as Ctrl-C does, leaves nothing that hangs."""

import asyncio
import linecache
import signal
import subprocess
import sys
import threading
from contextlib import contextmanager
from types import SimpleNamespace

import pytest
from geometry_msgs.msg import PointStamped
from making import at, transform
from processes import DEADLINE_S, start, until
from rclpy.executors import SingleThreadedExecutor
from rclpy.time import Time
from spinning import spinning

import tf2_py
import tf2_ros

pytestmark = pytest.mark.ours

AT = Time(seconds=3)
PACKAGES = (*tf2_py.__path__, *tf2_ros.__path__)  # installed, they are not beside the tests


class Interrupt(BaseException):
    """What the handler raises."""


def _raise():
    raise Interrupt


@contextmanager
def interrupted(line, handler=_raise):
    """Call a handler once, before the line with this number, from 1, of those that the packages run."""
    count = SimpleNamespace(left=line, reached=False)

    def trace(frame, event, _):
        code = frame.f_code
        if not code.co_filename.startswith(PACKAGES):
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


@pytest.mark.parametrize("how", [[], ["switch"], ["collector", "finalizer"]], ids=lambda how: "-".join(how))
def test_chance_finds_nothing_that_hangs(how):
    """For minutes by hand: ``PYTHONPATH=tests/support python tests/support/programs/interrupted.py 600``."""
    program = start("interrupted.py", "3", *how, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    output, _ = program.communicate(timeout=8 * DEADLINE_S)
    assert program.returncode == 0, output
    assert "[]" in output


def test_a_program_ends_after_ctrl_c_while_threads_wait():
    program = start("waits_in_two_threads.py", stdout=subprocess.PIPE)
    assert program.stdout.readline() == "ready\n"
    program.send_signal(signal.SIGINT)
    program.wait(DEADLINE_S)


def test_awaits_that_are_cancelled_leave_nothing_on_the_future(tf2_ros):
    buffer = tf2_ros.Buffer()

    async def main():
        future = buffer.wait_for_transform_async("map", "base", AT)

        async def one():
            return await future

        for _ in range(100):
            task = asyncio.ensure_future(one())
            await asyncio.sleep(0)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task
        assert future.done_callbacks == []
        future.cancel()

    asyncio.run(main())


def point(seconds):
    message = PointStamped()
    message.header.frame_id, message.header.stamp = "robot", at(seconds).to_msg()
    return message


class TestEachLine:
    """A handler that raises before any of the lines that an insert runs ends only that insert."""

    def rounds(self, buffer):
        """
        Yield a second, and a function that inserts the transform of that second, until no line is left.

        The insert of each round is interrupted one line later than the one before.
        """
        self.reached = True
        second = 0
        while self.reached:
            second += 1

            def insert(second=second):
                message = transform("map", "robot", second)
                with interrupted(second) as count:
                    buffer.set_transform(message, "x")
                self.reached = count.reached

            yield second, insert
        assert second > 1, "nothing was interrupted"

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

    def test_a_task_of_asyncio_goes_on(self, buffer):
        async def main():
            for second, insert in self.rounds(buffer):
                task = asyncio.ensure_future(buffer.lookup_transform_async("map", "robot", at(second)))
                await asyncio.sleep(0)
                insert()
                await asyncio.wait_for(task, DEADLINE_S)

        asyncio.run(main())

    def test_a_task_of_an_executor_goes_on(self, buffer, node):
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        with spinning(executor):
            for second, insert in self.rounds(buffer):
                began = threading.Event()

                async def follow(second=second, began=began):
                    future = buffer.wait_for_transform_async("map", "robot", at(second))
                    began.set()
                    await future

                task = executor.create_task(follow)
                assert began.wait(DEADLINE_S)
                insert()
                until(task.done)

    @pytest.mark.parametrize("frames", ["map", ("map", "base")])
    def test_a_filter_passes_its_message(self, buffer, tf2_ros, node, frames):
        executor, passed = SingleThreadedExecutor(), []
        executor.add_node(node)
        buffer.set_transform_static(transform("map", "base"), "x")
        with tf2_ros.MessageFilter(None, buffer, frames, 10, node=node) as filter, spinning(executor):
            filter.registerCallback(lambda message: passed.append(message.header.stamp.sec))
            for second, insert in self.rounds(buffer):
                filter.add(point(second))
                insert()
                until(lambda second=second: passed == [second])
                passed.clear()
            assert filter.statistics()["received"] == filter.statistics()["passed"] == second

    def test_an_interrupted_add_leaves_no_message(self, buffer, tf2_ros, node):
        with tf2_ros.MessageFilter(None, buffer, "map", 10, node=node) as filter:
            line, reached = 0, True
            while reached:
                line += 1
                with interrupted(line) as count:
                    filter.add(point(line))
                reached = count.reached
                assert filter.statistics()["waiting"] == (0 if reached else 1)
            assert line > 1, "nothing was interrupted"


def test_a_filter_may_be_closed_at_each_line_of_an_add(tf2_ros, node):
    buffer, line, reached = tf2_ros.Buffer(), 0, True
    while reached:
        line += 1
        with tf2_ros.MessageFilter(None, buffer, "map", 10, node=node) as filter:
            with interrupted(line, filter.close) as count:
                filter.add(point(1))
            reached = count.reached
            assert filter.statistics()["waiting"] == (0 if reached else 1)
    assert line > 1, "nothing was interrupted"


def test_a_signal_handler_may_insert_what_is_being_added_to_a_filter(tf2_ros, node, executor):
    buffer, passed = tf2_ros.Buffer(cache_time=1e6), []
    with tf2_ros.MessageFilter(None, buffer, ("map", "base"), 0, node=node) as filter:
        filter.registerCallback(lambda message: passed.append(message.header.stamp.sec))
        buffer.set_transform_static(transform("map", "base"), "x")
        line = 0
        while line is not None:
            line += 1
            message = transform("map", "robot", line)
            with interrupted(line, lambda message=message: buffer.set_transform(message, "x")) as count:
                filter.add(point(line))
            buffer.set_transform(message, "x")
            until(lambda line=line: passed == [line], executor)
            passed.clear()
            if not count.reached:
                break
        assert line > 10
