"""Following a transform: `async for` in asyncio and in executors, and callbacks."""

import asyncio
import gc
import weakref

import pytest
from making import S, stamp_ns, transform
from processes import until

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
    def test_it_begins_with_the_present_one_and_yields_each_new_one(self, tf2_ros):
        buffer, times = tf2_ros.Buffer(), iter((2, 3, 5))
        insert(buffer, 1)
        assert asyncio.run(take(buffer, 4, lambda: insert(buffer, next(times)))) == [1, 2, 3, 5]

    def test_a_slow_reader_gets_the_latest(self, tf2_ros):
        buffer, batches = tf2_ros.Buffer(), iter(((2, 3, 4), (5, 6)))
        insert(buffer, 1)
        assert asyncio.run(take(buffer, 3, lambda: insert(buffer, *next(batches)))) == [1, 4, 6]

    def test_an_executor_runs_it(self, tf2_ros, node, executor, peer):
        buffer = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(buffer, node)
        other, seconds = peer(), iter((2, 3))
        task = executor.create_task(
            take(buffer, 3, lambda: other.send(("map", "base", next(seconds) * S, 1.0)))
        )
        other.send(("map", "base", S, 1.0))
        until(task.done, executor)
        assert task.result() == [1, 2, 3]
        listener.unregister()

    @pytest.mark.parametrize("is_available", [False, True])
    def test_a_cancelled_step_leaves_nothing_behind_and_loses_nothing(self, tf2_ros, is_available):
        buffer = tf2_ros.Buffer()
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

    def test_it_ends_with_the_context(self, ros, tf2_ros):
        context = ros.Context()
        ros.init(context=context)
        node = ros.create_node("followed", context=context)
        buffer, seen = tf2_ros.Buffer(node=node), []

        async def follow():
            insert(buffer, 1)
            async for one in buffer.changes("map", "base"):
                seen.append(stamp_ns(one))
                context.shutdown()

        asyncio.run(follow())
        assert seen == [S]
        node.destroy_node()


class TestCallbacks:
    @pytest.mark.parametrize("spun", [True, False])
    def test_one_that_raises_at_its_first_call_is_called_again_like_all_others(self, tf2_ros, node, spun):
        buffer, seen, calls = tf2_ros.Buffer(), [], []
        listener = tf2_ros.TransformListener(buffer, node if spun else None, spin_thread=spun)

        def fail(_):
            calls.append(1)
            raise ValueError("mine")

        insert(buffer, 1)
        subscriptions = [buffer.on_change("map", "base", fail), buffer.on_change("map", "base", seen.append)]
        until(lambda: calls and seen)
        with pytest.warns(UserWarning, match="mine"):
            insert(buffer, 2)
        assert (len(calls), len(seen)) == (2, 2)
        assert listener._tf2_spinner is None or listener._tf2_spinner.thread.is_alive()
        for subscription in subscriptions:
            subscription.cancel()
        listener.unregister()

    def test_an_interrupt_at_the_first_call_ends_it(self, tf2_ros):
        """The program gets nothing to cancel it with."""
        buffer, calls = tf2_ros.Buffer(), []

        def interrupt(_):
            calls.append(1)
            raise KeyboardInterrupt

        insert(buffer, 1)
        with pytest.raises(KeyboardInterrupt):
            buffer.on_change("map", "base", interrupt)
        insert(buffer, 2)
        assert (calls, buffer.statistics()["waiters"]) == ([1], 0)

    def test_it_must_be_a_function(self, tf2_ros):
        with pytest.raises(TypeError, match="on_change: expected a function, got int"):
            tf2_ros.Buffer().on_change("map", "base", 3)

    def test_the_present_and_each_new_transform_is_passed_on(self, tf2_ros):
        buffer, seen = tf2_ros.Buffer(), []
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
        self, tf2_ros, node, executor, peer
    ):
        buffer, sender, order = tf2_ros.Buffer(), peer(), []
        listener = tf2_ros.TransformListener(buffer, node)

        def call(one):
            order.append("change")
            sender.send(("map", "base", stamp_ns(one) + S, 1.0))
            until(lambda: buffer.get_latest_common_time("map", "base").nanoseconds > stamp_ns(one))

        node.create_timer(0.0, lambda: order.append("timer"))
        subscription = buffer.on_change("map", "base", call)
        sender.send(("map", "base", S, 1.0))
        until(lambda: order.count("change") == 5, executor)
        assert "change change" not in " ".join(order)
        subscription.cancel()
        listener.unregister()

    def test_one_that_inserts_what_it_follows_is_called_again_and_not_within(self, tf2_ros):
        buffer, seen, depth = tf2_ros.Buffer(), [], []

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

    def test_an_invalid_name_is_raised(self, tf2_ros):
        with pytest.raises(tf2_ros.InvalidArgumentException):
            tf2_ros.Buffer().on_change("map", "/base", print)

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
