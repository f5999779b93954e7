# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Following a transform: `async for` in asyncio and in executors, and callbacks."""

import asyncio
import gc
import threading
import weakref
from functools import partial
from types import SimpleNamespace

import pytest
from simulated_clock import simulate
from times_and_transforms import S, at, at_ns, stamp_ns, transform
from waiting import until

from tf2_ros._wait.call_runners import call_queue_of


def insert(buffer, *seconds, child="base"):
    for one in seconds:
        buffer.set_transform(transform("map", child, one), "x")


async def take(buffer, count, after_each=lambda: None):
    seen = []
    async for one in buffer.changes("map", "base"):
        seen.append(stamp_ns(one) / S)
        if len(seen) == count:
            return seen
        after_each()


class TestIterator:
    def test_it_begins_with_the_present_one_and_a_slow_reader_gets_the_latest(self, buffer):
        batches = iter(((2, 3, 4), (5, 6)))
        insert(buffer, 1)
        assert asyncio.run(take(buffer, 3, lambda: insert(buffer, *next(batches)))) == [1, 4, 6]

    def test_an_executor_runs_it(self, buffer, listener, executor, peer):
        other, seconds = peer(), iter((2, 3))
        task = executor.create_task(
            take(buffer, 3, lambda: other.send(("map", "base", next(seconds) * S, 1.0)))
        )
        other.send(("map", "base", S, 1.0))
        until(task.done, executor)
        assert task.result() == [1, 2, 3]

    def test_replacing_samples_is_a_change_if_the_latest_one_differs(self, buffer):
        seen = []
        insert(buffer, 1, 2, 3)
        with_x = [transform("map", "base", one, (9, 0, 0)) for one in (2, 3)]
        subscription = buffer.on_change("map", "base", lambda one: seen.append(one.transform.translation.x))

        async def follow():
            changes = buffer.changes("map", "base")
            await changes.__anext__()
            buffer.set_transform(with_x[0], "slam", replace=True)
            step = asyncio.ensure_future(changes.__anext__())
            await asyncio.sleep(0)
            assert not step.done()
            buffer.set_transforms(with_x, "slam", replace=True)
            buffer.set_transforms(with_x, "slam", replace=True)
            return (await step).transform.translation.x

        assert asyncio.run(follow()) == 9.0
        assert seen == [0.0, 9.0]
        subscription.cancel()

    @pytest.mark.parametrize("is_available", [False, True])
    def test_a_cancelled_step_leaves_nothing_behind_and_loses_nothing(self, buffer, is_available):
        insert(buffer, 1)

        async def follow():
            changes = buffer.changes("map", "base")
            assert stamp_ns(await changes.__anext__()) == S
            step = asyncio.ensure_future(changes.__anext__())
            await asyncio.sleep(0)
            if is_available:
                insert(buffer, 2)
            step.cancel()
            with pytest.raises(asyncio.CancelledError):
                await step
            assert buffer.statistics()["waiters"] == 0
            insert(buffer, 2)
            return stamp_ns(await changes.__anext__())

        assert asyncio.run(follow()) == 2 * S

    def test_it_ends_with_the_context(self, ros, tf2_ros, node):
        buffer, seen = tf2_ros.Buffer(node=node), []

        async def follow():
            insert(buffer, 1)
            async for one in buffer.changes("map", "base"):
                seen.append(stamp_ns(one))
                ros.shutdown()

        asyncio.run(follow())
        assert seen == [S]


class TestCallbacks:
    def test_one_that_raises_at_its_first_call_is_called_again(self, buffer, capfd):
        calls = []

        def fail(_):
            calls.append(1)
            raise ValueError("mine")

        insert(buffer, 1)
        subscription = buffer.on_change("map", "base", fail)
        insert(buffer, 2)
        subscription.cancel()
        assert len(calls) == 2
        assert capfd.readouterr().err.count("ValueError: mine") == 2

    def test_an_interrupt_at_the_first_call_ends_it(self, buffer):
        """The program gets nothing to cancel it with."""
        calls = []

        def interrupt(_):
            calls.append(1)
            raise KeyboardInterrupt

        insert(buffer, 1)
        with pytest.raises(KeyboardInterrupt):
            buffer.on_change("map", "base", interrupt)
        insert(buffer, 2)
        assert (calls, buffer.statistics()["waiters"]) == ([1], 0)

    def test_wrong_arguments_are_refused(self, tf2_ros, buffer):
        with pytest.raises(TypeError, match="on_change: expected a function, got int"):
            buffer.on_change("map", "base", 3)
        with pytest.raises(tf2_ros.InvalidArgumentException):
            buffer.on_change("map", "/base", print)

    def test_the_present_and_each_new_transform_is_passed_on(self, buffer):
        seen = []
        insert(buffer, 1)
        subscription = buffer.on_change("map", "base", lambda one: seen.append(stamp_ns(one) / S))
        assert seen == [1]
        insert(buffer, 5, child="other")
        insert(buffer, 2, 3)
        assert seen == [1, 2, 3]
        subscription.cancel()
        insert(buffer, 4)
        assert seen == [1, 2, 3]
        assert buffer.statistics()["waiters"] == 0

    def test_an_executor_does_other_work_after_one_that_is_slower_than_the_changes(
        self, buffer, listener, node, executor, peer
    ):
        sender, order = peer(), []

        def call(one):
            order.append("change")
            for _ in range(2):
                later_ns = buffer.get_latest_common_time("map", "base").nanoseconds + S
                sender.send(("map", "base", later_ns, 1.0))
                until(partial(buffer.can_transform, "map", "base", at_ns(later_ns)))

        node.create_timer(0.0, lambda: order.append("timer"))
        subscription = buffer.on_change("map", "base", call)
        sender.send(("map", "base", S, 1.0))
        until(lambda: order.count("change") == 5, executor)
        assert "change change" not in " ".join(order)
        subscription.cancel()

    def test_one_that_inserts_what_it_follows_is_called_again_and_not_within(self, buffer):
        seen, depth = [], []

        def on_change(one):
            assert not depth
            depth.append(1)
            seen.append(stamp_ns(one) // S)
            if len(seen) < 50:
                insert(buffer, seen[-1] + 1)
            depth.pop()

        subscription = buffer.on_change("map", "base", on_change)
        insert(buffer, 1)
        until(lambda: len(seen) == 50)
        assert seen == list(range(1, 51))
        subscription.cancel()

    def test_the_buffer_exists_until_it_is_cancelled(self, tf2_ros):
        buffer = tf2_ros.Buffer()
        reference = weakref.ref(buffer)
        subscription = buffer.on_change("map", "base", print)
        del buffer
        gc.collect()
        assert reference() is not None
        subscription.cancel()
        del subscription
        gc.collect()
        assert reference() is None


def show(buffer, seconds):
    """Replace the buffer's clock by one that stands at these seconds."""
    buffer.clock = SimpleNamespace(now=lambda: at(seconds))


class TestLimits:
    """What violates `max_age` or `max_gap` is skipped."""

    def test_a_clock_that_is_set_back_is_noticed(self, buffer):
        seen = []
        show(buffer, 200)
        buffer.on_change("map", "base", lambda one: seen.append(stamp_ns(one) / S), max_age=0.5)
        insert(buffer, 100)
        assert seen == []
        show(buffer, 100)
        until(lambda: seen)
        assert seen == [100]

    def test_a_change_during_a_call_is_not_lost_to_a_thread_that_delivers_the_former_one_late(self, buffer):
        seen, reads, caller = [], [], threading.get_ident()
        delivers, goes_on = threading.Event(), threading.Event()
        thread = threading.Thread(target=insert, args=(buffer, 1))

        def now():
            if threading.current_thread() is thread:
                delivers.set()
                goes_on.wait()
            elif threading.get_ident() == caller:
                reads.append(1)
                if len(reads) == 2:  # after the wait has begun
                    thread.start()
                    delivers.wait()
            return at(2)

        def call(one):
            seen.append(stamp_ns(one) / S)
            if len(seen) == 1:
                insert(buffer, 2)
                goes_on.set()
                thread.join()

        buffer.clock = SimpleNamespace(now=now)
        subscription = buffer.on_change("map", "base", call, max_age=1000)
        assert seen == [1, 2]
        subscription.cancel()

    def test_a_gap_is_skipped_until_it_is_filled(self, buffer):
        seen = []
        buffer.on_change("map", "base", lambda one: seen.append(stamp_ns(one) / S), max_gap=2)
        for parent, child, second, expected in (
            ("map", "odom", 1, []),
            ("map", "odom", 5, []),
            ("odom", "base", 3, []),  # the common time, between 1 and 5
            ("map", "odom", 2.5, []),
            ("map", "odom", 4.5, [3]),
            ("odom", "base", 9, [3, 5]),  # the common time, at a sample of both
        ):
            buffer.set_transform(transform(parent, child, second), "x")
            if second == 9:
                buffer.set_transform(transform("odom", "base", 5), "x")
            assert seen == expected

    def test_an_iteration_skips_what_becomes_too_old_before_it_goes_on(self, buffer):
        async def follow():
            show(buffer, 10)
            changes = buffer.changes("map", "base", max_age=0.5)
            step = asyncio.ensure_future(changes.__anext__())
            await asyncio.sleep(0)
            insert(buffer, 10)
            show(buffer, 20)
            for _ in range(5):
                await asyncio.sleep(0)
            assert not step.done()
            insert(buffer, 19, 19.75)
            return stamp_ns(await step) / S, stamp_ns(await asyncio.wait_for(insert_next(changes), 60)) / S

        async def insert_next(changes):
            step = asyncio.ensure_future(changes.__anext__())
            await asyncio.sleep(0)
            show(buffer, 31)
            insert(buffer, 30, 30.75)
            return await step

        assert asyncio.run(follow()) == (19.75, 30.75)
        assert buffer.statistics()["waiters"] == 0

    def test_an_iteration_gets_what_another_process_sends_fresh(self, buffer, listener, executor, peer, node):
        async def follow():
            found = await buffer.changes("map", "base", max_age=1000.0).__anext__()
            return found.transform.translation.x

        sender, task = peer(), executor.create_task(follow())
        now_ns = node.get_clock().now().nanoseconds
        sender.send(("map", "base", now_ns - 2000 * S, 1.0))
        until(lambda: buffer.can_transform("map", "base", at(0)), executor)
        assert not task.done()
        sender.send(("map", "base", now_ns, 2.0))
        until(task.done, executor)
        assert task.result() == 2.0

    def test_a_callback_is_not_called_late(self, tf2_ros, node, executor, peer):
        """What has arrived becomes too old before the executor spins."""
        simulate(node, seconds=100)
        buffer, sender, seen = tf2_ros.Buffer(node=node), peer(), []
        listener = tf2_ros.TransformListener(buffer, node)
        buffer.on_change("map", "base", lambda one: seen.append(stamp_ns(one) / S), max_age=1)
        sender.send(("map", "base", 100 * S, 1.0))
        until(lambda: call_queue_of(node).calls)
        simulate(node, seconds=102)
        until(lambda: not call_queue_of(node).calls, executor)
        assert seen == []
        sender.send(("map", "base", 102 * S, 1.0))
        until(lambda: seen, executor)
        assert seen == [102]
        listener.unregister()

    @pytest.mark.parametrize(
        ("limits", "error", "text"),
        [
            ({"max_age": -1}, ValueError, r"max_age must not be negative, got -1\.0"),
            ({"max_age": {"base": "1"}}, TypeError, r"max_age\['base'\]: expected a duration"),
            ({"max_gap": {"base": 1}}, TypeError, "max_gap: expected a duration"),
            ({"tolerance": 1}, TypeError, "unexpected keyword argument 'tolerance'"),
            ({"timeout": 1}, TypeError, "unexpected keyword argument 'timeout'"),
        ],
        ids=str,
    )
    def test_wrong_ones_are_refused(self, buffer, limits, error, text):
        for call, more in ((buffer.changes, ()), (buffer.on_change, (print,))):
            with pytest.raises(error, match=text):
                call("map", "base", *more, **limits)

    def test_one_that_could_never_apply_is_an_error(self, buffer, capfd):
        limits, text = {"max_age": {"bas": 1}}, r"limit for \[bas\], which does not exist.*\[base\]"
        subscription = buffer.on_change("map", "base", print, **limits)
        insert(buffer, 1)  # which raises nothing, and ends it
        assert "An on_change ends" in capfd.readouterr().err
        assert buffer.statistics()["waiters"] == 0
        subscription.cancel()
        with pytest.raises(ValueError, match=text):
            buffer.on_change("map", "base", print, **limits)
        with pytest.raises(ValueError, match=text):
            asyncio.run(anext(buffer.changes("map", "base", **limits)))

    def test_a_frame_of_a_limit_that_is_forgotten_ends_it_and_fails_no_insert(self, buffer, capfd):
        seen = []
        show(buffer, 1)
        insert(buffer, 1, child="arm")
        buffer.on_change("map", "base", seen.append, max_age={"arm": 1})
        insert(buffer, 1)
        buffer.forget("arm")
        insert(buffer, 2)
        assert len(seen) == 1
        assert "limit for [arm], which does not exist" in capfd.readouterr().err
        assert buffer.statistics()["waiters"] == 0
