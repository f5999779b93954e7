# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A program's sources of a buffer without a node, and waits at their end; with or without ROS."""

import asyncio
import copy
import gc
import pickle
import threading
import weakref

import pytest
from times_and_transforms import S, insert
from waiting import DEADLINE_S, once_waiting, until

import tf2_ros

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
        insert(buffer, "map", "base", 5)
        source.end("it was closed")
        source.end("again")
        with pytest.raises(tf2_ros.ExtrapolationException, match=ENDED):
            buffer.lookup_transform("map", "base", 6 * S, timeout=DEADLINE_S)
        assert buffer.lookup_transform("map", "base", 5 * S, timeout=DEADLINE_S).child_frame_id == "base"
        assert repr(source) == "<BufferSource 'the robot': the robot has ended (it was closed)>"

    def test_the_wait_goes_on_while_another_fills_the_buffer(self, buffer, source):
        other = buffer.add_source("another")
        source.end()
        thread = once_waiting(buffer, lambda: insert(buffer, "map", "base", 5))
        assert buffer.lookup_transform("map", "base", 0, timeout=DEADLINE_S).child_frame_id == "base"
        thread.join()
        thread = once_waiting(buffer, other.end)
        with pytest.raises(tf2_ros.ExtrapolationException, match="^another has ended, which ended the wait"):
            buffer.lookup_transform("map", "base", 6 * S, timeout=DEADLINE_S)
        thread.join()

    def test_a_new_one_takes_the_place_of_one_that_has_ended(self, buffer, source):
        source.end()
        buffer.add_source("another")
        thread = once_waiting(buffer, lambda: insert(buffer, "map", "base", 5))
        assert buffer.lookup_transform("map", "base", 0, timeout=DEADLINE_S).child_frame_id == "base"
        thread.join()

    def test_copies_have_no_source(self, buffer, source):
        source.end()
        for copied in (copy.copy(buffer), pickle.loads(pickle.dumps(buffer))):
            thread = once_waiting(copied, lambda one=copied: insert(one, "map", "base", 5))
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
        insert(buffer, "map", "base", 5)
        with pytest.raises(
            tf2_ros.ExtrapolationException, match=r"; nothing has been received on /tf for 3 s$"
        ):
            buffer.lookup_transform("map", "base", 6 * S)
        assert {*asked} == {True, False}
        source.end()
        with pytest.raises(tf2_ros.ExtrapolationException, match=r"is 1\.000000000 s too old$"):
            buffer.lookup_transform("map", "base", 6 * S)

    def test_what_a_source_says_at_a_timeout_delays_no_other_timeout(self, buffer):
        may_go_on, threads = threading.Event(), []

        def silence(_):
            threads.append(threading.current_thread().name)
            may_go_on.wait(DEADLINE_S)
            return "it sleeps"

        buffer.add_source("the arm", silence)
        slow = buffer.wait_for_transform_async("map", "arm", 0, timeout=0.01)
        until(lambda: threads)
        future = tf2_ros.Buffer().wait_for_transform_async("map", "base", 0, timeout=0.01)
        until(future.done)
        may_go_on.set()
        until(slow.done)
        assert isinstance(future.exception(), tf2_ros.TimeoutException)
        assert "it sleeps" in str(slow.exception())
        assert {*threads} == {"tf2_ros callbacks"}

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
