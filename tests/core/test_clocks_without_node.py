# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A program's clock of a buffer without a node: ages and jumps; with or without ROS."""

import asyncio
import copy
import threading
import time
import types
from unittest import mock

import pytest
from times_and_transforms import S, insert, transform
from waiting import DEADLINE_S, once_waiting, until

import tf2_ros


class TestClocks:
    """A program's own clock, of any class."""

    class Clock:
        ns = 100 * S

        def now(self):
            return self.ns

    @pytest.fixture
    def buffer(self):
        made = tf2_ros.Buffer()
        made.add_source("this test")
        made.clock = self.Clock()
        return made

    def test_ages_are_counted_by_it(self, buffer):
        insert(buffer, "map", "base", 99)
        assert buffer.ages("map", "base") == {"base": 1.0}
        assert buffer.can_transform("map", "base", 0, max_age=1)
        assert not buffer.can_transform("map", "base", 0, max_age=0.5)

    def test_a_jump_back_clears(self, buffer):
        insert(buffer, "map", "base", 99)
        buffer.ages("map", "base")
        buffer.clock.ns = 99 * S + 1
        assert buffer.ages("map", "base")
        buffer.clock.ns = 98 * S
        with pytest.raises(tf2_ros.TransformException):
            buffer.ages("map", "base")
        insert(buffer, "map", "base", 97)
        assert buffer.ages("map", "base") == {"base": 1.0}

    @pytest.mark.parametrize("overrides", [None, "time_jump_callback", "clear"])
    def test_a_jump_back_that_the_background_thread_notices_runs_nothing_there(self, overrides):
        may_go_on, calls = threading.Event(), []

        def called(buffer):
            calls.append((threading.current_thread().name, buffer.statistics()["samples"]))
            may_go_on.wait(DEADLINE_S)

        class Mine(tf2_ros.Buffer):
            if overrides == "time_jump_callback":

                def time_jump_callback(self, time_jump):
                    called(self)
                    super().time_jump_callback(time_jump)

            if overrides == "clear":

                def clear(self):
                    called(self)

        buffer = Mine()
        buffer.add_source("this test")
        buffer.clock = self.Clock()
        insert(buffer, "map", "base", 99)
        buffer.ages("map", "base")
        for name in ("odom", "x", "y"):  # a loop, which the end of the dynamic transform opens
            buffer.set_transform_static(transform("map" if name == "odom" else "odom", name), "test")
        buffer.set_transform(transform("odom", "map", 99), "test")
        loop = buffer.wait_for_transform_async("x", "y", 99 * S)
        loop.add_done_callback(lambda _: calls.append((threading.current_thread().name, None)))
        subscription = buffer.on_change("map", "other", calls.append, max_age=1)
        buffer.clock.ns = 90 * S
        until(lambda: "base" not in buffer.histories())
        until(lambda: any(count is not None for _, count in calls) if overrides else loop.done())
        if overrides:
            insert(buffer, "map", "base", 89)
        # No timeout is late.
        future = tf2_ros.Buffer().wait_for_transform_async("map", "base", 0, timeout=0.01)
        until(future.done)
        assert isinstance(future.exception(), tf2_ros.TimeoutException)
        may_go_on.set()
        if overrides:
            assert buffer.ages("map", "base") == {"base": 1.0}  # what came after the jump stays
        until(loop.done)
        assert {name for name, _ in calls} == {"tf2_ros callbacks"}
        subscription.cancel()

    @pytest.mark.parametrize("how", ["filled by the program", "copied"])
    def test_a_jump_back_clears_only_what_a_source_fills(self, buffer, how):
        if how == "copied":
            insert(buffer, "map", "base", 99)
        kept = copy.copy(buffer) if how == "copied" else tf2_ros.Buffer()
        kept.clock = self.Clock()
        insert(kept, "map", "base", 99)
        assert kept.ages("map", "base") == {"base": 1.0}
        kept.clock.ns = 50 * S
        assert kept.ages("map", "base") == {"base": -49.0}

    @pytest.mark.parametrize(
        "new_clock",
        [
            lambda: types.SimpleNamespace(now=lambda: 100 * S),
            lambda: mock.Mock(now=lambda: 100 * S),
            lambda: type("Class", (), {"now": classmethod(lambda _: 100 * S)}),
            lambda: type("Proxy", (), {"__getattr__": lambda _, name: lambda: 100 * S})(),
        ],
    )
    def test_it_may_be_any_object_that_has_now(self, buffer, new_clock):
        buffer.clock = new_clock()
        insert(buffer, "map", "base", 99)
        assert buffer.ages("map", "base") == {"base": 1.0}
        assert not buffer.can_transform("map", "base", 0, max_age=0.5)

    def test_a_jump_back_is_noticed_also_by_a_call_that_raises(self, buffer):
        insert(buffer, "map", "base", 99)
        buffer.ages("map", "base")
        buffer.clock.ns = 50 * S
        with pytest.raises(tf2_ros.LookupException, match="nowhere"):
            buffer.ages("map", "nowhere")
        insert(buffer, "map", "base", 49)
        assert buffer.ages("map", "base") == {"base": 1.0}

    def test_a_clock_may_begin_below_0(self, buffer):
        insert(buffer, "map", "base", 1)
        buffer.clock.ns = -5 * S
        buffer.ages("map", "base")
        buffer.clock.ns = 2 * S
        assert buffer.ages("map", "base") == {"base": 1.0}

    @pytest.mark.parametrize("overtaken_by", [30, 80])
    def test_a_reading_that_another_thread_overtakes_is_not_a_jump(self, buffer, overtaken_by):
        insert(buffer, "map", "base", 9)
        is_read, may_return = threading.Event(), threading.Event()

        def read_slowly():
            buffer.clock.now = lambda: overtaken_by * S
            is_read.set()
            may_return.wait(DEADLINE_S)
            return 20 * S

        buffer.clock.now = lambda: 10 * S
        buffer.ages("map", "base")
        buffer.clock.now = read_slowly
        slow = threading.Thread(target=buffer.ages, args=("map", "base"))
        slow.start()
        assert is_read.wait(DEADLINE_S)
        assert buffer.ages("map", "base") == {"base": overtaken_by - 9}
        may_return.set()
        slow.join()
        assert buffer.ages("map", "base") == {"base": overtaken_by - 9}
        # The latest reading counts, not the one that came last.
        buffer.clock.now = lambda: (overtaken_by - 1) * S
        with pytest.raises(tf2_ros.TransformException):
            buffer.ages("map", "base")

    @pytest.mark.parametrize("how", ["future", "await", "block"])
    def test_a_wait_notices_that_it_was_set_back(self, buffer, how):
        def set_back():
            buffer.clock.ns = 50 * S
            deadline = time.monotonic() + DEADLINE_S
            # The buffer is cleared when the step is noticed, also of what has just arrived.
            while buffer.statistics()["waiters"] and time.monotonic() < deadline:
                insert(buffer, "map", "base", 50)
                time.sleep(0.001)

        thread = once_waiting(buffer, set_back)
        if how == "future":
            future = buffer.wait_for_transform_async("map", "base", 0, max_age=3.0)
            until(future.done)
            found = future.result()
        elif how == "await":
            found = asyncio.run(buffer.lookup_transform_async("map", "base", 0, max_age=3.0))
        else:
            found = buffer.lookup_transform("map", "base", 0, timeout=DEADLINE_S, max_age=3.0)
        thread.join()
        assert found.header.stamp.sec == 50

    @pytest.mark.parametrize("ends", ["by a check", "by an insert"])
    def test_a_wait_ends_with_what_it_raises(self, buffer, ends):
        future = buffer.wait_for_transform_async("map", "base", 0, max_age=3.0, timeout=DEADLINE_S)
        buffer.clock.now = lambda: 1 // 0
        if ends == "by an insert":
            insert(buffer, "map", "base", 99)
        until(future.done)
        with pytest.raises(ZeroDivisionError):
            future.result()
        assert buffer.statistics()["waiters"] == 0

    def test_one_that_shows_no_time(self, buffer):
        buffer.clock.now = lambda: "noon"
        insert(buffer, "map", "base", 99)
        with pytest.raises(TypeError, match="the time of the buffer's clock"):
            buffer.ages("map", "base")

    def test_without_one_there_is_the_system_time(self):
        buffer = tf2_ros.Buffer()
        buffer.set_transform(transform("map", "base", ns=time.time_ns()), "x")
        assert 0 <= buffer.ages("map", "base")["base"] < DEADLINE_S
        assert buffer.clock.now() is not None

    def test_one_that_raises_replaces_the_error_of_a_lookup(self, buffer):
        insert(buffer, "map", "base", 99)
        buffer.clock.now = lambda: 1 // 0
        with pytest.raises(ZeroDivisionError):
            buffer.lookup_transform("map", "base", 200 * S)

    def test_one_that_is_a_mock_does_without_a_sentence(self, buffer):
        buffer.clock = mock.MagicMock()
        insert(buffer, "map", "base", 99)
        with pytest.raises(tf2_ros.ExtrapolationException):
            buffer.lookup_transform("map", "base", 200 * S)

    def test_one_that_exits_in_another_thread_ends_the_wait(self, buffer):
        in_main_thread = threading.current_thread()

        def now():
            if threading.current_thread() is not in_main_thread:
                raise SystemExit
            return 100 * S

        buffer.clock.now = now
        future = buffer.wait_for_transform_async("map", "base", 0, timeout=0.3, max_age=1.0)
        until(future.done)
        assert isinstance(future.exception(), SystemExit)
