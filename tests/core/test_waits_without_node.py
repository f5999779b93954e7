# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Waiting without a node: blocked, with asyncio and in callbacks, in an environment with or without ROS."""

import asyncio
import gc
import signal
import threading
import time
from types import SimpleNamespace

import pytest
from times_and_transforms import S, insert
from waiting import DEADLINE_S, PROMPT_S, once_waiting, until

import tf2_ros
from tf2_ros._wait import lookup_or_wait


class TestBlocking:
    def test_one_ends_when_another_thread_inserts(self):
        buffer = tf2_ros.Buffer()
        one, two = ("map", "base", 5 * S), ("base", 5 * S, "base", 5 * S, "map")
        for wait, arguments in (
            (buffer.lookup_transform, one),
            (buffer.can_transform, one),
            (buffer.lookup_transform_full, two),
            (buffer.can_transform_full, two),
        ):
            buffer.clear()
            thread = once_waiting(buffer, lambda: insert(buffer, "map", "base", 5))
            begin = time.monotonic()
            assert wait(*arguments, DEADLINE_S)
            assert time.monotonic() - begin < PROMPT_S
            thread.join()

    @pytest.mark.parametrize("timeout", [0.05, SimpleNamespace(sec=0, nanosec=50_000_000)])
    def test_one_in_vain_says_how_long_it_was(self, timeout):
        buffer = tf2_ros.Buffer()
        insert(buffer, "map", "base", 5)
        begin = time.monotonic()
        with pytest.raises(tf2_ros.ExtrapolationException, match=r"\. Waited 0\.05 s$"):
            buffer.lookup_transform("map", "base", 6 * S, timeout)
        assert time.monotonic() - begin >= 0.05
        can, reason = buffer.can_transform("map", "base", 6 * S, timeout=timeout, return_debug_tuple=True)
        assert not can and reason.endswith(". Waited 0.05 s")

    def test_control_c_ends_one(self):
        buffer, main = tf2_ros.Buffer(), threading.main_thread().ident
        thread = once_waiting(buffer, lambda: signal.pthread_kill(main, signal.SIGINT))
        begin = time.monotonic()
        with pytest.raises(KeyboardInterrupt):
            buffer.lookup_transform("map", "base", 0, timeout=DEADLINE_S)
        assert time.monotonic() - begin < PROMPT_S
        thread.join()

    def test_one_in_an_asyncio_loop_says_once_that_the_loop_stands_still(self, monkeypatch):
        buffer, said = tf2_ros.Buffer(), []
        warns = SimpleNamespace(logger=lambda _: SimpleNamespace(warning=said.append))
        monkeypatch.setattr(lookup_or_wait, "log", warns)
        lookup_or_wait._warn_of_stalled_loop.cache_clear()

        async def block(target, timeout):
            return buffer.can_transform(target, "base", 0, timeout=timeout)

        assert not buffer.can_transform("map", "base", 0, timeout=0.01)
        insert(buffer, "map", "base", 5)
        assert asyncio.run(block("map", DEADLINE_S))  # available: nothing waits
        assert not asyncio.run(block("elsewhere", 0))
        assert said == []
        for _ in range(2):
            assert not asyncio.run(block("elsewhere", 0.01))
        [warning] = said
        assert warning.startswith("A lookup blocks the thread of an asyncio loop")
        assert "Await lookup_transform_async" in warning


class TestAwaiting:
    def test_a_transform_from_another_thread(self):
        buffer = tf2_ros.Buffer()
        thread = once_waiting(buffer, lambda: insert(buffer, "map", "base", 5))
        found = asyncio.run(buffer.lookup_transform_async("map", "base", 0))
        thread.join()
        assert found.header.stamp.sec == 5

    def test_full_lookups(self):
        buffer = tf2_ros.Buffer()
        thread = once_waiting(buffer, lambda: insert(buffer, "map", "base", 5))
        found = asyncio.run(buffer.lookup_transform_full_async("map", 5 * S, "base", 5 * S, "map"))
        thread.join()
        assert found.child_frame_id == "base"

    def test_a_timeout_says_what_is_missing(self):
        buffer = tf2_ros.Buffer()
        with pytest.raises(
            tf2_ros.TimeoutException, match=r'^Waited 0\.01 s for the transform: "map" passed'
        ):
            asyncio.run(buffer.lookup_transform_async("map", "base", 0, timeout=0.01))

    def test_what_is_cancelled_waits_no_more(self):
        buffer = tf2_ros.Buffer()

        async def cancel():
            task = asyncio.ensure_future(buffer.lookup_transform_async("map", "base", 0))
            while not buffer.statistics()["waiters"]:
                await asyncio.sleep(0)
            task.cancel()
            with pytest.raises(asyncio.CancelledError):
                await task

        asyncio.run(cancel())
        gc.collect()
        assert buffer.statistics()["waiters"] == 0

    def test_changes(self):
        buffer = tf2_ros.Buffer()
        seen = []

        async def follow():
            async for found in buffer.changes("map", "base"):
                seen.append(found.header.stamp.sec)
                if len(seen) == 3:
                    return
                insert(buffer, "map", "base", 10 + len(seen))

        insert(buffer, "map", "base", 10)
        asyncio.run(follow())
        assert seen == [10, 11, 12]

    def test_a_coroutine_of_no_loop(self):
        """Whatever has begun it resumes it."""
        buffer = tf2_ros.Buffer()
        coroutine = buffer.lookup_transform_async("map", "base", 0)
        for _ in range(3):
            assert coroutine.send(None) is None
        insert(buffer, "map", "base", 5)
        with pytest.raises(StopIteration) as ended:
            coroutine.send(None)
        assert ended.value.value.child_frame_id == "base"


class TestFutures:
    def test_a_callback_runs_in_the_thread_that_inserts(self):
        buffer = tf2_ros.Buffer()
        called = []
        future = buffer.wait_for_transform_async("map", "base", 0)
        future.add_done_callback(
            lambda one: called.append((one.result().child_frame_id, threading.get_ident()))
        )
        insert(buffer, "map", "base", 5)
        assert called == [("base", threading.get_ident())]
        assert future.done() and not future.cancelled()

    def test_a_callback_is_called_at_the_timeout(self):
        buffer = tf2_ros.Buffer()
        called = []
        future = buffer.wait_for_transform_async("map", "base", 0, timeout=0.01)
        future.add_done_callback(called.append)
        until(lambda: called)
        assert isinstance(future.exception(), tf2_ros.TimeoutException)

    def test_on_change(self):
        buffer = tf2_ros.Buffer()
        called = []
        subscription = buffer.on_change("map", "base", lambda one: called.append(one.header.stamp.sec))
        insert(buffer, "map", "base", 5)
        insert(buffer, "map", "base", 6)
        subscription.cancel()
        insert(buffer, "map", "base", 7)
        assert called == [5, 6]
