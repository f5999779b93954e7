"""Waiting without a node: with asyncio and in threads, in an environment with or without ROS."""

import asyncio
import copy
import gc
import pickle
import threading
import time
import types
import weakref
from unittest import mock

import pytest

import tf2_ros

pytestmark = pytest.mark.ours

DEADLINE_S = 60.0
S = 10**9


def transform(parent, child, ns=0, x=0.0):
    made = tf2_ros.TransformStamped(child_frame_id=child)
    made.header.frame_id = parent
    made.header.stamp.sec, made.header.stamp.nanosec = divmod(ns, S)
    made.transform.translation.x = float(x)
    return made


def insert(buffer, ns, x=0.0):
    buffer.set_transform(transform("map", "base", ns, x), "test")


def until(condition):
    deadline = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.001)


def once_waiting(buffer, call):
    """Call in a thread, once a wait is pending."""

    def run():
        until(lambda: buffer.statistics()["waiters"])
        call()

    thread = threading.Thread(target=run)
    thread.start()
    return thread


class TestAwaiting:
    def test_a_transform_from_another_thread(self):
        buffer = tf2_ros.Buffer()
        thread = once_waiting(buffer, lambda: insert(buffer, 5, 2.0))
        found = asyncio.run(buffer.lookup_transform_async("map", "base", 0))
        thread.join()
        assert found.transform.translation.x == 2.0

    def test_full_lookups(self):
        buffer = tf2_ros.Buffer()
        thread = once_waiting(buffer, lambda: insert(buffer, 5))
        found = asyncio.run(buffer.lookup_transform_full_async("map", 5, "base", 5, "map"))
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
                seen.append(found.transform.translation.x)
                if len(seen) == 3:
                    return
                insert(buffer, 10 + len(seen), len(seen))

        insert(buffer, 10)
        asyncio.run(follow())
        assert seen == [0.0, 1.0, 2.0]

    def test_a_coroutine_of_no_loop(self):
        """Whatever has begun it resumes it."""
        buffer = tf2_ros.Buffer()
        coroutine = buffer.lookup_transform_async("map", "base", 0)
        for _ in range(3):
            assert coroutine.send(None) is None
        insert(buffer, 5)
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
        insert(buffer, 5)
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
        subscription = buffer.on_change("map", "base", lambda one: called.append(one.transform.translation.x))
        insert(buffer, 5, 1.0)
        insert(buffer, 6, 2.0)
        subscription.cancel()
        insert(buffer, 7, 3.0)
        assert called == [1.0, 2.0]


ENDED = r"^the robot has ended \(it was closed\), which ended the wait for the transform after \d+(\.\d+)? s$"


class TestSources:
    """Something of the program fills the buffer, and says when it does no more."""

    @pytest.fixture
    def buffer(self):
        return tf2_ros.Buffer()

    @pytest.fixture
    def source(self, buffer):
        return buffer.add_source("the robot")

    def test_a_blocked_lookup_ends(self, buffer, source):
        thread = once_waiting(buffer, lambda: source.end("it was closed"))
        with pytest.raises(tf2_ros.LookupException, match=ENDED):
            buffer.lookup_transform("map", "base", 0, timeout=DEADLINE_S)
        thread.join()

    def test_an_await_ends(self, buffer, source):
        thread = once_waiting(buffer, lambda: source.end("it was closed"))
        with pytest.raises(tf2_ros.TimeoutException, match=ENDED):
            asyncio.run(buffer.lookup_transform_async("map", "base", 0))
        thread.join()

    def test_the_iteration_over_changes_ends(self, buffer, source):
        async def follow():
            return [one async for one in buffer.changes("map", "base")]

        thread = once_waiting(buffer, source.end)
        assert asyncio.run(follow()) == []
        thread.join()

    def test_waits_that_begin_afterwards_end_and_what_is_there_is_found(self, buffer, source):
        insert(buffer, 5)
        source.end("it was closed")
        source.end("again")
        with pytest.raises(tf2_ros.ExtrapolationException, match=ENDED):
            buffer.lookup_transform("map", "base", 6, timeout=DEADLINE_S)
        assert buffer.lookup_transform("map", "base", 5, timeout=DEADLINE_S).child_frame_id == "base"
        assert repr(source) == "<BufferSource 'the robot': the robot has ended (it was closed)>"

    def test_the_wait_goes_on_while_another_fills_the_buffer(self, buffer, source):
        other = buffer.add_source("another")
        source.end()
        thread = once_waiting(buffer, lambda: insert(buffer, 5))
        assert buffer.lookup_transform("map", "base", 0, timeout=DEADLINE_S).child_frame_id == "base"
        thread.join()
        thread = once_waiting(buffer, other.end)
        with pytest.raises(tf2_ros.ExtrapolationException, match="^another has ended, which ended the wait"):
            buffer.lookup_transform("map", "base", 6, timeout=DEADLINE_S)
        thread.join()

    def test_a_new_one_takes_the_place_of_one_that_has_ended(self, buffer, source):
        source.end()
        buffer.add_source("another")
        thread = once_waiting(buffer, lambda: insert(buffer, 5))
        assert buffer.lookup_transform("map", "base", 0, timeout=DEADLINE_S).child_frame_id == "base"
        thread.join()

    def test_copies_have_no_source(self, buffer, source):
        source.end()
        for copied in (copy.copy(buffer), pickle.loads(pickle.dumps(buffer))):
            thread = once_waiting(copied, lambda one=copied: insert(one, 5))
            assert copied.lookup_transform("map", "base", 0, timeout=DEADLINE_S).child_frame_id == "base"
            thread.join()

    def test_errors_say_what_is_silent(self, buffer):
        asked = []

        def silence(with_static):
            asked.append(with_static)
            return "nothing has been received on /tf for 3 s"

        source = buffer.add_source("the robot", silence)
        with pytest.raises(
            tf2_ros.LookupException, match=r"empty: nothing has been received on /tf for 3 s$"
        ):
            buffer.lookup_transform("map", "base", 0)
        insert(buffer, 5)
        with pytest.raises(
            tf2_ros.ExtrapolationException, match=r"; nothing has been received on /tf for 3 s$"
        ):
            buffer.lookup_transform("map", "base", 6)
        assert {*asked} == {True, False}
        source.end()
        with pytest.raises(tf2_ros.ExtrapolationException, match=r"is 0\.000000001 s away$"):
            buffer.lookup_transform("map", "base", 6)

    def test_of_several_all_say_it(self, buffer):
        buffer.add_source("one", lambda _: "nothing has been received on /one")
        buffer.add_source("two", lambda _: "")
        buffer.add_source("three", lambda _: "nothing has been received on /three")
        said = "empty: nothing has been received on /one and nothing has been received on /three$"
        with pytest.raises(tf2_ros.LookupException, match=said):
            buffer.lookup_transform("map", "base", 0)

    def test_the_buffer_keeps_no_source_that_has_ended(self, buffer):
        class Connection:
            def silence(self, _):
                return ""

        connections = [Connection() for _ in range(3)]
        alive = [weakref.ref(one) for one in connections]
        for one in connections:
            buffer.add_source("one", one.silence).end()
        del one, connections
        buffer.add_source("last").end()
        gc.collect()
        assert [one() for one in alive] == [None] * 3

    @pytest.mark.parametrize(
        ("arguments", "said"),
        [
            ((5,), "name: expected a str, got int"),
            (("the robot", 5), "add_source: expected a function, got int"),
        ],
    )
    def test_wrong_arguments(self, buffer, arguments, said):
        with pytest.raises(TypeError, match=said):
            buffer.add_source(*arguments)


class TestClocks:
    """A program's own clock, of any class."""

    class Clock:
        ns = 100 * S

        def now(self):
            return self.ns

    @pytest.fixture
    def buffer(self):
        made = tf2_ros.Buffer()
        made.clock = self.Clock()
        return made

    def test_ages_are_counted_by_it(self, buffer):
        insert(buffer, 99 * S)
        assert buffer.ages("map", "base") == {"base": 1.0}
        assert buffer.can_transform("map", "base", 0, max_age=1)
        assert not buffer.can_transform("map", "base", 0, max_age=0.5)

    def test_a_jump_back_clears(self, buffer):
        insert(buffer, 99 * S)
        buffer.ages("map", "base")
        buffer.clock.ns = 99 * S + 1
        assert buffer.ages("map", "base")
        buffer.clock.ns = 98 * S
        with pytest.raises(tf2_ros.TransformException):
            buffer.ages("map", "base")
        insert(buffer, 97 * S)
        assert buffer.ages("map", "base") == {"base": 1.0}

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
        insert(buffer, 99 * S)
        assert buffer.ages("map", "base") == {"base": 1.0}
        assert not buffer.can_transform("map", "base", 0, max_age=0.5)

    def test_a_clock_may_begin_below_0(self, buffer):
        insert(buffer, 1 * S)
        buffer.clock.ns = -5 * S
        buffer.ages("map", "base")
        buffer.clock.ns = 2 * S
        assert buffer.ages("map", "base") == {"base": 1.0}

    @pytest.mark.parametrize("overtaken_by", [30, 80])
    def test_a_reading_that_another_thread_overtakes_is_not_a_jump(self, buffer, overtaken_by):
        insert(buffer, 9 * S)
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
                insert(buffer, 50 * S)
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
            insert(buffer, 99 * S)
        until(future.done)
        with pytest.raises(ZeroDivisionError):
            future.result()
        assert buffer.statistics()["waiters"] == 0

    def test_one_that_shows_no_time(self, buffer):
        buffer.clock.now = lambda: "noon"
        insert(buffer, 99 * S)
        with pytest.raises(TypeError, match="the time of the buffer's clock"):
            buffer.ages("map", "base")

    def test_without_one_there_is_the_system_time(self):
        buffer = tf2_ros.Buffer()
        insert(buffer, time.time_ns())
        assert 0 <= buffer.ages("map", "base")["base"] < DEADLINE_S
        assert buffer.clock.now() is not None
