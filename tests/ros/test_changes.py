"""Following a transform: `async for` in asyncio and in executors, and callbacks."""

import asyncio
import gc
import weakref
from functools import partial

import pytest
from making_objects import S, at_ns, stamp_ns, transform
from waiting import until

pytestmark = pytest.mark.ours


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
