# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Waiting without a node: with asyncio and in threads, in an environment with or without ROS."""

import asyncio
import gc
import threading

import pytest
from making_objects import S, insert
from waiting import once_waiting, until

import tf2_ros

pytestmark = pytest.mark.ours


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
