# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Futures of transforms: what completes them, what ends them, and that nothing is left behind."""

import asyncio
import gc
import re
import signal
import subprocess
import sys
import threading
import time
import weakref
from contextlib import nullcontext

import pytest
from calls_in_threads import at_once
from helper_threads import let_helper_threads_finish
from processes import output_of, run, start
from rclpy.duration import Duration, Infinite
from rclpy.executors import MultiThreadedExecutor
from rclpy.time import Time
from spinning_nodes import spinning
from times_and_transforms import at, transform
from waiting import DEADLINE_S, errors_so_far, until

from tf2_ros._process.background import background

LATEST = Time()
SHORT = Duration(seconds=0.05)
LONGER = Duration(seconds=1)  # than a busy machine needs for what a test does before its end
LEFT_TO_THE_EXIT = """
import atexit, threading, time

def names():
    return sorted(one.name for one in threading.enumerate())

atexit.register(lambda: print(names()))  # after all others

import rclpy
from tf2_ros import Buffer
from tf2_ros._process import threads

rclpy.init()
buffer = Buffer()
future = buffer.wait_for_transform_async("map", "robot", 0, timeout=3600.0)
while not threads.running:  # a thread that has only just begun is not waited for
    time.sleep(0.01)
"""
WITHOUT_A_THREAD = """
import threading, time
from tf2_ros import Buffer

buffer = Buffer()
size = threading.stack_size(1 << 46)  # no machine has memory for such a stack
try:
    buffer.wait_for_transform_async("map", "robot", 0, timeout=0.01)
except RuntimeError as error:
    print(error)
threading.stack_size(size)
future = buffer.wait_for_transform_async("map", "robot", 0, timeout=0.01)
while not future.done():
    time.sleep(0.01)
print("ended")
"""
# What `logging` keeps, keeps the names of the program until Python has cleared those of other modules.
DROPS_AN_ERROR_LATE = """
import logging, time
from tf2_ros import Buffer

make = logging.getLogRecordFactory()
logging.setLogRecordFactory(lambda *about: make(*about))
future = Buffer().wait_for_transform_async("map", "robot", 0, timeout=0.01)
while not future.done():
    time.sleep(0.01)
"""
ENDED = r"The context was shut down, which ended the wait for the transform after [\d.]+ s"


@pytest.fixture
def buffer(tf2_ros):
    buffer = tf2_ros.Buffer()
    yield buffer
    if hasattr(buffer, "statistics"):
        gc.collect()
        let_helper_threads_finish()
        assert buffer.statistics()["waiters"] == 0, "somebody is left waiting"


def wait(buffer, time=LATEST, **how):
    return buffer.wait_for_transform_async("map", "robot", time, **how)


def insert(buffer, seconds=1.0, child="robot", parent="map", x=0.0):
    buffer.set_transform(transform(parent, child, seconds, (x, 0, 0)), "me")


class TestCompletion:
    @pytest.mark.parametrize("error", [asyncio.CancelledError, SystemExit, KeyboardInterrupt])
    def test_a_callback_that_raises_more_than_an_exception_delays_no_other_future(self, buffer, error):
        def fail(_):
            raise error("mine")

        first, second, called = wait(buffer), wait(buffer), []
        first.add_done_callback(fail)
        second.add_done_callback(called.append)
        with pytest.raises(error):
            insert(buffer)
        assert first.done()
        assert called == [second]

    @pytest.mark.parametrize("raises", [False, True])
    def test_it_is_done_when_its_callbacks_begin_and_awaits_wake_when_they_have_run(self, buffer, raises):
        future, within, may_end, seen = wait(buffer), threading.Event(), threading.Event(), []

        def call_back(done):
            seen.append(done.result().child_frame_id)
            within.set()
            may_end.wait(DEADLINE_S)
            seen.append("called back")
            if raises:
                raise SystemExit

        def insert_from_thread():
            with pytest.raises(SystemExit) if raises else nullcontext():
                insert(buffer)

        async def from_outside():
            task = asyncio.ensure_future(await_it(future))
            await asyncio.sleep(0)  # it awaits before the callback is added
            future.add_done_callback(call_back)
            inserting = threading.Thread(target=insert_from_thread)
            inserting.start()
            await asyncio.to_thread(within.wait, DEADLINE_S)
            # As a program does whose callback sets an event for another thread.
            assert future.done() and future.result().child_frame_id == "robot"
            assert not task.done()
            may_end.set()
            await task
            assert seen == ["robot", "called back"]
            inserting.join()

        asyncio.run(from_outside())


def test_a_name_that_can_never_be_found_ends_it_at_once(buffer, tf2_py):
    future = buffer.wait_for_transform_async("", "robot", LATEST)
    assert future.done()
    with pytest.raises(tf2_py.InvalidArgumentException, match="cannot be empty"):
        future.result()


class TestTimeout:
    def test_its_text_has_the_time_and_the_reason(self, buffer, tf2_py):
        future, longer = wait(buffer, timeout=SHORT), wait(buffer, timeout=LONGER)
        assert has_deadline(longer)
        until(future.done)
        with pytest.raises(
            tf2_py.TimeoutException,
            match=r"^Waited 0\.05 s for .*does not exist\. The buffer is empty: it has ",
        ):
            future.result()

    def test_its_text_says_that_a_wait_for_the_past_is_no_use(self, buffer, tf2_py):
        insert(buffer, 9.0)
        future = wait(buffer, Time(seconds=5), timeout=SHORT)
        until(future.done)
        with pytest.raises(tf2_py.TimeoutException, match="a wait brings newer transforms, not older ones$"):
            future.result()
        future = wait(buffer, Time(seconds=10), timeout=SHORT)
        until(future.done)
        assert "not older ones" not in str(future.exception())

    def test_what_an_insert_has_answered_counts_although_it_was_not_tried_yet(self, buffer, tf2_py):
        # An insert tries its waiters in steps; between two of them, a timeout may come first.
        insert(buffer)
        first = time.monotonic() + 0.4
        futures = [
            wait(buffer, Time(seconds=5), timeout=Duration(seconds=first + i * 12e-6 - time.monotonic()))
            for i in range(4000)
        ]
        until(lambda: futures[400].done())
        insert(buffer, 9.0)
        until(lambda: all(future.done() for future in futures))
        errors = [str(future.exception()) for future in futures if future.exception()]
        assert [error for error in errors if "extrapolation" not in error] == []

    def test_none_at_all_ends_it_at_once(self, buffer, tf2_py):
        for timeout in (Duration(), Long(float("-inf"))):
            future = wait(buffer, timeout=timeout)
            until(future.done)
            assert type(future.exception()) is tf2_py.TimeoutException
            assert str(future.exception()).startswith("Waited 0 s for the transform: ")

    def test_after_a_shutdown_its_text_says_that_instead(self, ros, tf2_ros, buffer):
        future = wait(buffer, timeout=Duration(seconds=DEADLINE_S))
        ros.shutdown()
        future.expire()  # as its timeout would
        assert type(future.exception()) is tf2_ros.TimeoutException
        assert re.fullmatch(ENDED, str(future.exception()))

    def test_it_is_no_timeout_of_python(self, tf2_py):
        # Which is an OSError, and what asyncio.timeout and futures raise: programs distinguish these.
        assert not issubclass(tf2_py.TimeoutException, OSError)

    def test_its_thread_ends_with_the_interpreter(self):
        """What waits for threads at exit comes first."""
        assert output_of("-c", LEFT_TO_THE_EXIT) == "['MainThread']\n"

    def test_a_thread_that_cannot_be_started_is_tried_again(self):
        assert output_of("-c", WITHOUT_A_THREAD) == "can't start new thread\nended\n"

    def test_one_that_cannot_say_whether_it_is_over_ends_no_other(self, buffer, capfd):
        """Nor do many, when ended ones are removed."""
        broken = [Broken() for _ in range(200)]
        future = wait(buffer, timeout=SHORT)
        for one in broken:
            background.expire_at(0, one)
        until(future.done)
        assert future.exception() is not None
        assert "ValueError: not known" in errors_so_far()

    def test_waits_that_ended_leave_nothing_until_their_deadline(self, buffer):
        for _ in range(5000):
            wait(buffer, timeout=Duration(seconds=3)).cancel()
        until(lambda: len(background.entries) < 500)


class Broken:
    """What has a deadline, and fails."""

    def over(self):
        raise ValueError("not known")


class Long:
    """A duration that no Duration can be."""

    def __init__(self, nanoseconds):
        self.nanoseconds = nanoseconds


@pytest.mark.parametrize(
    "timeout", [Infinite, Long(2**63), Long(float("inf"))], ids=["Infinite", "long", "inf"]
)
def test_an_infinite_timeout_is_none(buffer, timeout):
    future = wait(buffer, at(1), timeout=timeout)
    assert not has_deadline(future)

    def insert_for_both():
        until(lambda: buffer.statistics()["waiters"] == 2)
        insert(buffer)

    found, _ = at_once(lambda: buffer.lookup_transform("map", "robot", LATEST, timeout), insert_for_both)
    assert found.child_frame_id == future.result().child_frame_id == "robot"


def has_deadline(future):
    return any(entry[2]() is future for entry in background.entries)


class TestEndOfTheWait:
    def test_a_result_from_elsewhere_ends_it(self, buffer):
        for end in (lambda f: f.set_result("mine"), lambda f: f.set_exception(KeyError("mine"))):
            future = wait(buffer, at(5))
            end(future)
            assert buffer.statistics()["waiters"] == 0
            assert future.exception() is not None or future.result() == "mine"

    def test_a_removed_callback_keeps_it_no_more(self, buffer):
        future = wait(buffer)
        callbacks = [lambda _: None, lambda _: None]
        for callback in callbacks:
            future.add_done_callback(callback)
        assert future.remove_done_callback(callbacks[0])
        assert not future.remove_done_callback(callbacks[0])
        reference = weakref.ref(future)
        del future
        gc.collect()
        assert reference() is not None
        assert reference().remove_done_callback(callbacks[1])
        gc.collect()
        assert reference() is None

    def test_an_executor_that_gave_up_does_not_keep_it(self, buffer, ros, node):
        ros.spin_until_future_complete(node, wait(buffer), timeout_sec=0.05)
        ros.spin_once(node, timeout_sec=0)  # rclpy remembers the last future it spun for
        gc.collect()
        assert buffer.statistics()["waiters"] == 0

    def test_its_error_is_not_reported_if_the_coroutine_that_awaits_it_is_cancelled(self, buffer, capfd):
        async def main():
            future = wait(buffer)

            async def work():
                await future

            task = asyncio.ensure_future(work())
            await asyncio.sleep(0)
            future.set_exception(KeyError("late"))
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task

        asyncio.run(main())
        gc.collect()
        assert "never retrieved" not in capfd.readouterr().err

    def test_an_error_that_python_drops_at_its_very_end_is_printed(self):
        done = run(sys.executable, "-c", DROPS_AN_ERROR_LATE)
        [line] = done.stderr.splitlines()
        assert done.returncode == 0
        assert line.startswith("The following exception was never retrieved: Waited 0.01 s for the transform")

    def test_a_completed_future_does_not_keep_the_buffer(self, tf2_ros):
        buffer = tf2_ros.Buffer()
        future = wait(buffer)
        insert(buffer)
        reference = weakref.ref(buffer)
        del buffer
        assert reference() is None
        assert future.result() is not None


class TestShutdown:
    @pytest.mark.parametrize("in_a_callback", [False, True])
    @pytest.mark.parametrize("full", [False, True])
    def test_asyncio_awaits_no_longer(self, ros, tf2_ros, node, executor, full, in_a_callback):
        buffer = tf2_ros.Buffer(node=node)
        names = ("map", at(2), "robot", at(1), "odom") if full else ("map", "robot", at(1))

        async def main():
            look_up = buffer.lookup_transform_full_async if full else buffer.lookup_transform_async
            awaiting = [asyncio.ensure_future(look_up(*names)) for _ in range(3)]
            await asyncio.sleep(0)
            ros.shutdown()
            errors = await asyncio.wait_for(asyncio.gather(*awaiting, return_exceptions=True), DEADLINE_S)
            # One that begins later ends at once, too.
            with pytest.raises(tf2_ros.TimeoutException, match=ENDED):
                await asyncio.wait_for(look_up(*names), DEADLINE_S)
            return errors

        if in_a_callback:
            task = executor.create_task(lambda: asyncio.run(main()))
            executor.spin_once()
        errors = task.result() if in_a_callback else asyncio.run(main())
        assert [type(error) for error in errors] == [tf2_ros.TimeoutException] * 3
        assert all(re.fullmatch(ENDED, str(error)) for error in errors)
        assert buffer.statistics()["waiters"] == 0

    def test_a_signal_that_shuts_the_context_down_ends_it(self):
        program = start("waits_until_signal.py", "await", stdout=subprocess.PIPE)
        assert program.stdout.readline() == "waiting\n"
        program.send_signal(signal.SIGTERM)
        text, _ = program.communicate(timeout=DEADLINE_S)
        assert re.fullmatch(ENDED, text.strip())

    def test_an_answer_is_awaited_afterwards_if_it_is_available(self, ros, buffer):
        insert(buffer)
        ros.shutdown()
        assert asyncio.run(buffer.lookup_transform_async("map", "robot", at(1))).child_frame_id == "robot"

    def test_what_nobody_awaits_goes_on_waiting(self, ros, buffer):
        future, called = wait(buffer), []
        future.add_done_callback(called.append)
        ros.shutdown()
        late = wait(buffer)
        assert not future.done()
        assert not late.done()
        insert(buffer)
        assert called == [future]
        assert late.done()


async def await_it(future):
    return await future


class TestAwaiting:
    def test_it_ends_while_a_task_falls_asleep(self, buffer, ros):
        """Between deciding to sleep and sleeping, the task is still executed, and every executor skips it."""
        falling_asleep, has_ended = threading.Event(), threading.Event()
        future = wait(buffer)

        class Slowly:
            def __await__(self):
                for yielded in future.__await__():
                    falling_asleep.set()
                    has_ended.wait(DEADLINE_S)
                    yield yielded

        async def look_up():
            await Slowly()

        executor = MultiThreadedExecutor(2)
        with spinning(executor):
            task = executor.create_task(look_up)
            assert falling_asleep.wait(DEADLINE_S)
            insert(buffer)
            has_ended.set()
            until(task.done)

    def test_one_that_is_cancelled_leaves_nothing_on_the_future(self, buffer):
        future = wait(buffer)

        async def main():
            task = asyncio.ensure_future(await_it(future))
            await asyncio.sleep(0)
            assert future.wakers and buffer._tf2_kept
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task

        asyncio.run(main())
        assert not future.wakers and not buffer._tf2_kept

    @pytest.mark.parametrize("how", ["task", "wait_for", "timeout", "group", "closed"])
    @pytest.mark.parametrize("held", [False, True])
    def test_one_that_is_cancelled_ends_the_wait_at_once_and_silently(self, buffer, how, held, capfd):
        async def look_up():
            if not held:
                return await buffer.lookup_transform_async("map", "robot", at(1), timeout=DEADLINE_S)
            future = wait(buffer, at(1), timeout=DEADLINE_S)
            return await future

        async def interrupted():
            if how == "wait_for":
                await asyncio.wait_for(look_up(), 0.01)
            elif how == "timeout":
                async with asyncio.timeout(0.01):
                    await look_up()
            elif how == "group":
                async with asyncio.TaskGroup() as group:
                    group.create_task(look_up())
                    await asyncio.sleep(0)
                    raise KeyError
            else:
                await look_up()

        async def main():
            task = asyncio.ensure_future(interrupted())
            await asyncio.sleep(0)
            if how == "task":
                task.cancel()
            with pytest.raises(BaseException) as kept:
                await task
            assert type(kept.value).__name__ in ("CancelledError", "TimeoutError", "ExceptionGroup")
            assert buffer.statistics()["waiters"] == 0
            return task, kept

        if how in ("timeout", "group") and sys.version_info < (3, 11):
            pytest.skip("asyncio lacks it")
        if how == "closed":
            coroutine = look_up()
            coroutine.send(None)
            assert buffer.statistics()["waiters"] == 1
            coroutine.close()
            assert buffer.statistics()["waiters"] == 0
        else:
            asyncio.run(main())
        gc.collect()
        assert capfd.readouterr().err == ""

    @pytest.mark.parametrize("also", ["another task", "a callback"])
    def test_one_that_is_cancelled_leaves_the_wait_to_others(self, buffer, also):
        future = wait(buffer)

        async def main():
            count = 2 if also == "another task" else 1
            tasks = [asyncio.ensure_future(await_it(future)) for _ in range(count)]
            if also == "a callback":
                future.add_done_callback(lambda _: None)
            await asyncio.sleep(0)
            tasks[0].cancel()
            await asyncio.sleep(0)
            assert not future.cancelled()
            insert(buffer)
            return await (tasks[1] if also == "another task" else future)

        assert asyncio.run(main()).child_frame_id == "robot"

    def test_a_task_of_asyncio_that_nobody_refers_to_goes_on(self, buffer):
        done = []

        async def follow():
            done.append(await buffer.lookup_transform_async("map", "robot", at(1)))

        async def main():
            asyncio.create_task(follow())
            await asyncio.sleep(0)
            gc.collect()
            insert(buffer)
            while not done:
                await asyncio.sleep(0)

        asyncio.run(asyncio.wait_for(main(), DEADLINE_S))

    def test_what_awaits_or_has_callbacks_goes_with_its_buffer(self, tf2_ros, node):
        buffer = tf2_ros.Buffer()
        node.listener = tf2_ros.TransformListener(buffer, node)
        buffer.node = node  # buffer, wait, callback, node, listener, and the buffer again

        future = wait(buffer, at(1))
        future.add_done_callback(lambda _, node=node: node)
        ended = [weakref.ref(future), weakref.ref(buffer)]
        node.listener.unregister()
        del future, buffer, node.listener
        gc.collect()
        assert [one() for one in ended] == [None, None]
