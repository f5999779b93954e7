"""Messages that wait for their transforms."""

import asyncio
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from types import SimpleNamespace

import pytest
import rclpy
from geometry_msgs.msg import PointStamped
from making import S, at, transform
from processes import DEADLINE_S, start, until
from rclpy.duration import Duration, Infinite
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from sensor_msgs.msg import LaserScan
from spinning import spinning

pytestmark = pytest.mark.ours

NO_FAILURE = {"OUT_THE_BACK": 0, "EMPTY_FRAME_ID": 0, "NO_TRANSFORM_FOUND": 0, "QUEUE_FULL": 0, "TIMEOUT": 0}


def point(seconds=1.0, frame="lidar", ns=None):
    message = PointStamped()
    message.header.frame_id = frame
    message.header.stamp = at(seconds).to_msg() if ns is None else at(ns / S).to_msg()
    return message


def insert(buffer, seconds=1.0, parent="map", child="lidar", x=0.0):
    buffer.set_transform(transform(parent, child, seconds, (x, 0, 0)), "me")


class Watched:
    """A filter, what passed it, and what it dropped."""

    def __init__(self, make, executor, input=None, buffer=None, frames="map", queue_size=0, **options):
        self.passed, self.dropped, self.threads = [], [], set()
        self.executor = executor
        self.filter = make(input, buffer, frames, queue_size, **options)
        self.filter.registerCallback(self.take)
        self.filter.registerFailureCallback(lambda message, reason: self.dropped.append((message, reason)))

    def take(self, message):
        self.threads.add(threading.current_thread())
        self.passed.append(message)

    def seconds(self):
        """The stamps of what passed."""
        self.settle()
        return [m.header.stamp.sec + m.header.stamp.nanosec / 1e9 for m in self.passed]

    def reasons(self):
        self.settle()
        return [reason.name for _, reason in self.dropped]

    def settle(self):
        """Let everything that is due happen."""
        until(lambda: not self.filter._pending._outcomes, self.executor)


@pytest.fixture
def buffer(tf2_ros):
    return tf2_ros.Buffer(Duration(seconds=10))


@pytest.fixture
def make(tf2_ros, node, executor, buffer):
    made = []

    def make(**options):
        made.append(Watched(tf2_ros.MessageFilter, executor, buffer=buffer, node=node, **options))
        return made[-1]

    yield make
    for watched in made:
        counts = watched.filter.statistics()
        total = counts["passed"] + sum(counts["dropped"].values()) + counts["cleared"] + counts["waiting"]
        assert counts["received"] == total
        watched.filter.close()
    assert buffer.statistics()["waiters"] == 0, "somebody is left waiting"


@pytest.fixture
def watched(make):
    return make()


class TestPassing:
    def test_a_message_waits_for_its_transform(self, watched, buffer):
        message = point(2)
        watched.filter.add(message)
        insert(buffer, 1)
        assert watched.seconds() == []
        assert watched.filter.statistics()["waiting"] == 1
        insert(buffer, 3)
        assert watched.seconds() == [2]
        assert watched.passed[0] is message
        assert watched.filter.statistics() == {
            "received": 1,
            "passed": 1,
            "dropped": NO_FAILURE,
            "cleared": 0,
            "waiting": 0,
        }

    def test_one_that_waits_for_nothing_passes_too(self, watched, buffer):
        insert(buffer, 1)
        watched.filter.add(point(1))
        watched.filter.add(point(9, frame="map"))
        assert watched.seconds() == [1, 9]

    def test_a_leading_slash_is_stripped(self, make, buffer):
        watched = make(frames="/map")
        insert(buffer)
        watched.filter.add(point(frame="/lidar"))
        assert watched.seconds() == [1]

    def test_time_0_is_the_latest(self, make, buffer):
        watched = make(tolerance=Duration(seconds=1))
        watched.filter.add(point(0))
        insert(buffer, 5)
        assert watched.seconds() == [0]

    def test_they_pass_in_the_order_in_which_their_transforms_complete(self, watched, buffer):
        for seconds in (4, 2, 3, 1):
            watched.filter.add(point(seconds))
        watched.filter.add(point(1, frame="camera"))
        insert(buffer, 1)
        insert(buffer, 1, child="camera")
        insert(buffer, 3)
        insert(buffer, 5)
        assert watched.seconds() == [1, 1, 2, 3, 4]
        assert watched.passed[1].header.frame_id == "camera"

    def test_each_passes_once_however_often_its_transform_is_inserted(self, watched, buffer):
        watched.filter.add(point(1))
        for _ in range(3):
            insert(buffer, 1)
            insert(buffer, 2)
        assert watched.seconds() == [1]

    def test_a_message_added_twice_passes_twice(self, watched, buffer):
        message = point(1)
        watched.filter.add(message)
        watched.filter.add(message)
        insert(buffer, 1)
        assert watched.seconds() == [1, 1]

    def test_a_cleared_buffer_leaves_them_waiting(self, watched, buffer):
        watched.filter.add(point(2))
        insert(buffer, 1)
        buffer.clear()
        insert(buffer, 3)
        assert watched.seconds() == []
        insert(buffer, 2)
        assert watched.seconds() == [2]


class TestSeveralFrames:
    def test_all_of_them_are_needed(self, make, buffer):
        watched = make(frames=["map", "odom", "earth"])
        watched.filter.add(point())
        insert(buffer, 1, "map")
        insert(buffer, 1, "earth", "map")
        assert watched.seconds() == []
        insert(buffer, 1, "odom", "earth")
        assert watched.seconds() == [1]

    def test_what_was_found_and_lost_again_is_waited_for_anew(self, make, buffer):
        watched = make(frames=["map", "mirror"])
        watched.filter.add(point())
        insert(buffer, 1)
        buffer.clear()
        insert(buffer, 1, "lidar", "mirror")
        assert watched.seconds() == []
        insert(buffer, 1)
        assert watched.seconds() == [1]

    def test_they_can_be_changed_for_those_that_wait(self, watched, buffer):
        watched.filter.add(point())
        watched.filter.setTargetFrames(["odom"])
        insert(buffer, 1, "map")
        assert watched.seconds() == []
        insert(buffer, 1, "odom", "map")
        assert watched.seconds() == [1]

    def test_none_is_refused(self, watched):
        with pytest.raises(ValueError, match="target frame"):
            watched.filter.setTargetFrames([])

    @pytest.mark.parametrize(
        ("frames", "error"),
        [(5, TypeError), (["map", 5], TypeError), ("", ValueError), (["map", "/"], ValueError)],
    )
    def test_what_is_no_name_is_refused(self, watched, frames, error):
        with pytest.raises(error, match="target"):
            watched.filter.setTargetFrames(frames)


class TestTolerance:
    def test_the_transform_must_be_available_for_later_too(self, make, buffer):
        watched = make(tolerance=Duration(seconds=0.5))
        watched.filter.add(point(1))
        insert(buffer, 1)
        insert(buffer, 1.4)
        assert watched.seconds() == []
        insert(buffer, 1.5)
        assert watched.seconds() == [1]

    def test_it_can_be_changed_for_those_that_wait(self, make, buffer):
        watched = make(tolerance=Duration(seconds=5))
        watched.filter.add(point(1))
        insert(buffer, 1)
        watched.filter.setTolerance(Duration())
        assert watched.seconds() == [1]

    def test_a_negative_one_is_refused(self, watched):
        with pytest.raises(ValueError, match="tolerance"):
            watched.filter.setTolerance(Duration(seconds=-1))

    @pytest.mark.parametrize(
        "tolerance", [Infinite, Duration(seconds=9223372036), Duration(nanoseconds=2**62)]
    )
    def test_one_that_no_stamp_can_be_added_to_is_refused(self, make, watched, buffer, tolerance):
        with pytest.raises(ValueError, match="tolerance must be finite"):
            make(tolerance=tolerance)
        with pytest.raises(ValueError, match="tolerance must be finite"):
            watched.filter.setTolerance(tolerance)
        insert(buffer)
        watched.filter.add(point(1))
        assert watched.seconds() == [1], "the one before still holds"


class TestQueue:
    def test_one_too_many_drops_the_oldest(self, make, buffer):
        watched = make(queue_size=2)
        for seconds in (1, 2, 3, 4):
            watched.filter.add(point(seconds))
        assert watched.reasons() == ["QUEUE_FULL"] * 2
        assert [m.header.stamp.sec for m, _ in watched.dropped] == [1, 2]
        insert(buffer, 1)
        insert(buffer, 5)
        assert watched.seconds() == [3, 4]
        assert watched.filter.statistics()["dropped"] == {**NO_FAILURE, "QUEUE_FULL": 2}

    def test_one_that_need_not_wait_drops_no_other(self, make, buffer):
        watched = make(queue_size=1)
        watched.filter.add(point(9))
        insert(buffer, 1)
        watched.filter.add(point(1))
        watched.filter.add(point(1))
        assert watched.seconds() == [1, 1]
        assert watched.reasons() == []

    @pytest.mark.parametrize("step", ["report_if_long", "partial"])
    def test_one_whose_adding_a_signal_handler_interrupts_does_not_wait(
        self, watched, buffer, monkeypatch, step
    ):
        def interrupt(*_):
            raise KeyboardInterrupt

        with monkeypatch.context() as patched:
            patched.setattr(f"tf2_ros._wait.filter_queue.{step}", interrupt)
            with pytest.raises(KeyboardInterrupt):
                watched.filter.add(point(1))
        counts = watched.filter.statistics()
        assert (counts["received"], counts["waiting"]) == (0, 0)
        assert buffer.statistics()["waiters"] == 0
        watched.filter.add(point(2))
        insert(buffer, 1)
        insert(buffer, 5)
        assert watched.seconds() == [2]

    def test_zero_holds_any_number(self, make):
        watched = make(queue_size=0)
        for _ in range(1000):
            watched.filter.add(point())
        assert watched.filter.statistics()["waiting"] == 1000
        assert watched.reasons() == []

    def test_making_it_smaller_drops_the_oldest(self, watched):
        for seconds in (1, 2, 3):
            watched.filter.add(point(seconds))
        watched.filter.setQueueSize(1)
        assert watched.reasons() == ["QUEUE_FULL"] * 2
        assert [m.header.stamp.sec for m, _ in watched.dropped] == [1, 2]

    def test_a_negative_size_is_refused(self, make):
        with pytest.raises(ValueError, match="queue_size"):
            make(queue_size=-1)

    def test_clear_forgets_those_that_wait(self, watched, buffer):
        watched.filter.add(point(1))
        watched.filter.clear()
        insert(buffer, 1)
        assert watched.seconds() == []
        assert watched.reasons() == []
        assert watched.filter.statistics()["cleared"] == 1
        assert watched.filter.statistics()["waiting"] == 0

    def test_clear_removes_what_passed_and_was_not_delivered_yet(self, watched, buffer):
        insert(buffer, 1)
        watched.filter.add(point(1))
        watched.filter.clear()
        assert watched.seconds() == []
        assert watched.filter.statistics()["cleared"] == 1


class TestFailures:
    def test_an_empty_frame(self, watched):
        watched.filter.add(point(frame=""))
        watched.filter.add(point(frame="/"))
        assert watched.reasons() == ["EMPTY_FRAME_ID"] * 2

    def test_an_invalid_name(self, make):
        watched = make(frames=["map", "//odom"])
        watched.filter.add(point())
        watched.filter.add(point(frame="//lidar"))
        assert watched.reasons() == ["NO_TRANSFORM_FOUND"] * 2

    def test_an_infinite_timeout_never_passes(self, make, buffer):
        watched = make(buffer_timeout=Infinite)
        watched.filter.add(point(1))
        assert watched.reasons() == []
        insert(buffer, 1)
        assert watched.seconds() == [1]

    def test_a_timeout(self, make, buffer):
        watched = make(buffer_timeout=Duration(seconds=0.05))
        insert(buffer, 1)
        watched.filter.add(point(2))
        until(lambda: watched.dropped, watched.executor)
        assert watched.reasons() == ["TIMEOUT"]
        insert(buffer, 3)
        assert watched.seconds() == []

    def test_what_passed_has_no_timeout(self, make, buffer):
        watched = make(buffer_timeout=Duration(seconds=1))
        watched.filter.add(point(1))
        insert(buffer, 1)
        watched.filter.add(point(2))
        until(lambda: watched.dropped, watched.executor)
        assert watched.seconds() == [1]
        assert [m.header.stamp.sec for m, _ in watched.dropped] == [2]

    def test_not_to_be_waited_for(self, make, buffer):
        watched = make(buffer_timeout=Duration())
        watched.filter.add(point(1))
        insert(buffer, 1)
        watched.filter.add(point(1))
        assert watched.reasons() == ["NO_TRANSFORM_FOUND"]
        assert watched.seconds() == [1]

    def test_older_than_all_that_the_buffer_keeps(self, watched, buffer):
        insert(buffer, 20)
        insert(buffer, 21)
        watched.filter.add(point(10.9))
        assert watched.reasons() == ["OUT_THE_BACK"]
        watched.filter.add(point(11))
        assert watched.filter.statistics()["waiting"] == 1, "a transform of 11 s would still be taken"
        insert(buffer, 11)
        assert watched.seconds() == [11]

    def test_too_old_only_after_it_had_waited(self, watched, buffer):
        watched.filter.add(point(1))
        insert(buffer, 20)
        assert watched.reasons() == []
        watched.filter.add(point(20))
        assert watched.reasons() == ["OUT_THE_BACK"]
        assert watched.seconds() == [20]

    def test_nearly_all_dropped_is_warned_of_once(self, make, capfd):
        watched = make(queue_size=1)
        for i in range(100):
            watched.filter.add(point(i + 1))
        watched.settle()
        warnings = [
            line for line in capfd.readouterr().err.splitlines() if "MessageFilter [target=map]" in line
        ]
        assert len(warnings) == 1
        assert "20 of the last 20 messages were dropped" in warnings[0]
        assert "QUEUE_FULL" in warnings[0]
        assert "does not exist" in warnings[0]

    def test_what_does_not_print_is_escaped_in_the_warning(self, make, capfd):
        watched = make(queue_size=1, frames="map\x1b[31m")
        for i in range(100):
            watched.filter.add(point(i + 1, "lidar\nFrame"))
        watched.settle()
        warning = next(line for line in capfd.readouterr().err.splitlines() if "MessageFilter" in line)
        # rclpy colours a warning's line itself.
        assert r"[target=map\x1b[31m]" in warning
        assert r"[lidar\nFrame]" in warning

    def test_at_a_time_that_no_stamp_carries(self, make):
        watched = make(tolerance=Duration(seconds=1))
        message = point()
        message.header.stamp.sec, message.header.stamp.nanosec = 2**31 - 1, 10**9 - 1
        watched.filter.add(message)
        assert watched.reasons() == ["NO_TRANSFORM_FOUND"]

    def test_half_of_them_dropped_is_not_warned_of(self, make, buffer, capfd):
        watched = make()
        insert(buffer, 1)
        for _ in range(50):
            watched.filter.add(point(1))
            watched.filter.add(point(frame=""))
        watched.settle()
        assert len(watched.dropped) == 50
        assert "MessageFilter" not in capfd.readouterr().err

    def test_a_message_without_header_is_refused(self, watched, tf2_ros):
        with pytest.raises(TypeError, match="header"):
            watched.filter.add(tf2_ros.Header())


class TestCallbacks:
    @pytest.mark.parametrize("kind", [SingleThreadedExecutor, MultiThreadedExecutor])
    def test_they_run_in_the_executor_whichever_thread_inserts_and_adds(
        self, tf2_ros, new_node, buffer, kind
    ):
        node = new_node("filtering")
        executor = kind()
        executor.add_node(node)
        threads, passed = set(), []
        running = threading.Lock()

        def take(message):
            assert running.acquire(blocking=False), "two callbacks at once"
            threads.add(threading.current_thread())
            passed.append(message.header.stamp.nanosec)
            running.release()

        filter = tf2_ros.MessageFilter(None, buffer, "map", 0, node=node)
        filter.registerCallback(take)
        with spinning(executor):
            for i in range(500):
                filter.add(point(ns=S + i))
            insert(buffer, 1)
            insert(buffer, 2)
            for i in range(500, 1000):
                filter.add(point(ns=S + i))
            until(lambda: len(passed) == 1000)
        assert passed == list(range(1000))
        assert threading.current_thread() not in threads
        filter.close()

    def test_arguments_are_handed_on(self, watched, buffer):
        seen = []
        watched.filter.registerCallback(lambda *arguments: seen.append(arguments[1:]), 1, "two")
        watched.filter.registerFailureCallback(lambda *arguments: seen.append(arguments[2:]), 3)
        insert(buffer)
        watched.filter.add(point())
        watched.filter.add(point(frame=""))
        watched.settle()
        assert seen == [(1, "two"), (3,)]

    def test_one_can_be_taken_out(self, watched, buffer):
        seen = []
        connection = watched.filter.registerCallback(seen.append)
        watched.filter.callbacks.pop(connection)
        insert(buffer)
        watched.filter.add(point())
        assert watched.seconds() == [1]
        assert seen == []

    def test_one_that_raises_is_logged_and_does_not_lose_the_messages_behind(self, watched, buffer, capfd):
        raising = [RuntimeError("mine")]

        def fail(message):
            if raising:
                raise raising.pop()

        watched.filter.registerCallback(fail)
        insert(buffer)
        for _ in range(3):
            watched.filter.add(point())
        watched.settle()
        assert watched.seconds() == [1, 1, 1]
        assert "RuntimeError: mine" in capfd.readouterr().err

    def test_one_that_raises_does_not_keep_a_message_from_the_others(self, watched, buffer, capfd):
        seen = []
        watched.filter.registerCallback(lambda message: sys.exit("mine"))
        watched.filter.registerCallback(seen.append)
        insert(buffer)
        watched.filter.add(point())
        with pytest.raises(SystemExit, match="mine"):  # out of the spin of the main thread
            watched.settle()
        assert len(seen) == 1

    def test_one_may_use_the_filter_and_the_buffer(self, watched, buffer):
        def more(message):
            if message.header.stamp.sec < 5:
                insert(buffer, message.header.stamp.sec + 1)
                watched.filter.add(point(message.header.stamp.sec + 1))

        watched.filter.registerCallback(more)
        insert(buffer)
        watched.filter.add(point())
        assert watched.seconds() == [1, 2, 3, 4, 5]


class Subscriber:
    """The shape of a subscriber of message_filters, which is not on PyPI."""

    def __init__(self):
        self.callbacks = {}

    def registerCallback(self, callback, *arguments):
        self.callbacks[len(self.callbacks)] = (callback, arguments)
        return len(self.callbacks) - 1

    def signalMessage(self, *messages):
        for callback, arguments in self.callbacks.values():
            callback(*messages, *arguments)


class TestInput:
    def test_a_topic(self, make, node, executor, buffer):
        watched = make(input=(PointStamped, "points", 10))
        publisher = node.create_publisher(PointStamped, "points", 10)
        until(lambda: publisher.get_subscription_count() == 1)
        insert(buffer)
        publisher.publish(point())
        until(lambda: watched.passed, executor)
        assert watched.seconds() == [1]
        watched.filter.close()
        until(lambda: publisher.get_subscription_count() == 0, executor)

    @pytest.mark.parametrize("with_info", [False, True])
    def test_a_subscription_of_rclpy_keeps_its_own_callback(self, make, node, executor, buffer, with_info):
        seen = []
        theirs = (lambda message, info: seen.append(message)) if with_info else seen.append
        subscription = node.create_subscription(PointStamped, "points", theirs, 10)
        watched = make(input=subscription)
        publisher = node.create_publisher(PointStamped, "points", 10)
        until(lambda: publisher.get_subscription_count() == 1)
        insert(buffer)
        publisher.publish(point())
        until(lambda: watched.passed, executor)
        assert seen == watched.passed
        watched.filter.close()
        assert subscription.callback is theirs

    def test_a_filter(self, make, buffer):
        subscriber = Subscriber()
        watched = make(input=subscriber)
        insert(buffer)
        subscriber.signalMessage(point())
        assert watched.seconds() == [1]

    def test_another_input_takes_the_place_of_the_first(self, make, buffer):
        first, second = Subscriber(), Subscriber()
        watched = make(input=first)
        watched.filter.connectInput(second)
        insert(buffer)
        first.signalMessage(point())
        assert watched.seconds() == []
        second.signalMessage(point())
        assert watched.seconds() == [1]

    def test_a_filter_may_follow_another(self, make, buffer):
        first = make(frames="map")
        second = make(frames="odom", input=first.filter)
        first.filter.add(point())
        insert(buffer, 1)
        first.settle()
        assert second.filter.statistics()["received"] == 1
        assert second.seconds() == []
        insert(buffer, 1, "odom", "map")
        assert second.seconds() == [1]

    def test_it_is_an_input_of_a_time_synchronizer(self, make, buffer):
        message_filters = pytest.importorskip("message_filters", reason="it is not on PyPI")
        first, second = make(), make()
        pairs = []
        synchronizer = message_filters.TimeSynchronizer([first.filter, second.filter], 10)
        synchronizer.registerCallback(lambda *messages: pairs.append(messages))
        for seconds in (1, 2, 3):
            first.filter.add(point(seconds))
        second.filter.add(point(2))
        insert(buffer, 1)
        insert(buffer, 3)
        first.settle()
        second.settle()
        assert [[m.header.stamp.sec for m in pair] for pair in pairs] == [[2, 2]]

    @pytest.mark.parametrize("input", ["points", object(), (PointStamped, "points")])
    def test_anything_else_is_refused(self, make, input):
        with pytest.raises(TypeError, match="input"):
            make(input=input)

    def test_a_type_without_header_is_refused(self, make, tf2_ros):
        with pytest.raises(TypeError, match="header"):
            make(input=(tf2_ros.Header, "headers", 10))

    def test_anything_but_a_buffer_is_refused(self, tf2_ros, node):
        with pytest.raises(TypeError, match="buffer"):
            tf2_ros.MessageFilter(None, object(), "map", 0, node=node)


class TestAsync:
    def test_an_executor_iterates(self, make, buffer):
        watched = make()
        seen = []

        async def take():
            async for message, found in watched.filter:
                seen.append((message.header.stamp.sec, found.transform.translation.x))
                if len(seen) == 3:
                    watched.filter.close()

        task = watched.executor.create_task(take)
        for seconds in (1, 2, 3):
            watched.filter.add(point(seconds))
        watched.executor.spin_once(timeout_sec=1)
        for seconds in (1, 2, 3):
            insert(buffer, seconds, x=10 * seconds)
        until(task.done, watched.executor)
        assert seen == [(1, 10.0), (2, 20.0), (3, 30.0)]

    def test_plain_asyncio_iterates_beside_an_executor(self, make, buffer):
        watched = make(frames=["map", "odom"])
        insert(buffer, 1, "map")
        insert(buffer, 1, "odom", "map", x=5)

        async def take():
            seen = []
            iteration = watched.filter.__aiter__()
            for _ in range(100):
                watched.filter.add(point())
            async for message, found in iteration:
                assert found.header.frame_id == "map"
                seen.append(message)
                if len(seen) == 100:
                    watched.filter.close()
            return seen

        with spinning(watched.executor):
            assert len(asyncio.run(asyncio.wait_for(take(), DEADLINE_S))) == 100

    def test_closing_ends_it_after_what_has_passed(self, make, buffer):
        watched = make()
        iteration = watched.filter.__aiter__()
        insert(buffer)
        watched.filter.add(point(1))
        watched.filter.add(point(2))
        watched.settle()
        watched.filter.close()

        async def take(iteration):
            return [message.header.stamp.sec async for message, _ in iteration]

        assert asyncio.run(take(iteration)) == [1]
        assert asyncio.run(take(watched.filter)) == []

    def test_several_iterate_over_the_same(self, make, buffer):
        watched = make()
        iterations = [watched.filter.__aiter__(), watched.filter.__aiter__()]
        insert(buffer)
        watched.filter.add(point(1))
        watched.settle()
        watched.filter.close()

        async def take(iteration):
            return [message async for message, _ in iteration]

        assert [len(asyncio.run(take(iteration))) for iteration in iterations] == [1, 1]

    def test_a_cancelled_iteration_loses_nothing(self, make, buffer):
        watched = make()

        async def take():
            iteration = watched.filter.__aiter__()
            with pytest.raises(asyncio.TimeoutError):
                await asyncio.wait_for(iteration.__anext__(), 0.05)
            insert(buffer)
            watched.filter.add(point())
            return await asyncio.wait_for(iteration.__anext__(), DEADLINE_S)

        with spinning(watched.executor):
            assert asyncio.run(take())[0].header.stamp.sec == 1


def test_threads_that_add_insert_and_change_lose_nothing(tf2_ros, new_node, buffer):
    node = new_node("filtering")
    executor = MultiThreadedExecutor()
    executor.add_node(node)
    filter = tf2_ros.MessageFilter(None, buffer, ["map", "odom"], 0, node=node)
    passed, count = [], 3000
    filter.registerCallback(lambda message: passed.append(id(message)))
    messages = [[point(ns=S + 1000 * i) for i in range(count)] for _ in range(2)]

    def add(mine):
        for message in mine:
            filter.add(message)

    def insert_all():
        for i in range(count):
            buffer.set_transform(transform("map", "lidar", ns=S + 1000 * i), "me")
            buffer.set_transform(transform("odom", "map", ns=S + 1000 * i), "me")

    def change():
        while any(thread.is_alive() for thread in threads[:-1]):
            filter.setTargetFrames(["map"])
            filter.setTargetFrames(["odom", "map"])

    threads = [threading.Thread(target=add, args=(mine,)) for mine in messages]
    threads += [threading.Thread(target=insert_all), threading.Thread(target=change)]
    with spinning(executor):
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        until(lambda: len(passed) >= 2 * count)
        filter.close()
    assert sorted(passed) == sorted(id(message) for mine in messages for message in mine)
    assert buffer.statistics()["waiters"] == 0


def test_a_message_that_is_looked_up_again_keeps_its_deadline(watched, monkeypatch):
    watched.filter.add(point(1))
    queue, over = watched.filter._pending, []
    original = queue._lookups

    def lookups(pending):
        over.append(pending.over())
        return original(pending)

    monkeypatch.setattr(queue, "_lookups", lookups)
    watched.filter.setTargetFrames("odom")
    assert over == [False]


def test_no_message_passes_for_the_frames_before_the_change(make, buffer, monkeypatch):
    watched = make(frames="map")
    for i in range(100):
        watched.filter.add(point(ns=S + i))
    pending, inserted = watched.filter._pending, []
    original = pending._look_up

    def look_up(message):
        # The change has begun, and has not come to most messages.
        if not inserted:
            inserted.append(1)
            insert(buffer, 1)
            insert(buffer, 2)
        original(message)

    monkeypatch.setattr(pending, "_look_up", look_up)
    watched.filter.setTargetFrames(["odom"])
    assert watched.seconds() == []
    assert watched.filter.statistics()["waiting"] == 100
    insert(buffer, 1, "odom", "map")
    insert(buffer, 2, "odom", "map")
    assert len(watched.seconds()) == 100


def names_of_threads(filter):
    """A list that grows by the name of the thread in which a callback runs."""
    names = []
    filter.registerCallback(lambda _: names.append(threading.current_thread().name))
    return names


class TestWithoutExecutor:
    """A node that nobody spins."""

    @pytest.fixture
    def filter(self, tf2_ros, node, buffer):
        filter = tf2_ros.MessageFilter(None, buffer, "map", 0, node=node)
        yield filter
        filter.close()

    def test_callbacks_run_in_a_thread_of_their_own_one_after_the_other(self, filter, buffer):
        threads, seen, failed = set(), [], []
        running = threading.Lock()

        def take(message):
            assert running.acquire(blocking=False), "two callbacks at once"
            threads.add(threading.current_thread().name)
            seen.append(message.header.stamp.nanosec)
            running.release()

        filter.registerCallback(take)
        filter.registerFailureCallback(lambda _, reason: failed.append(reason.name))
        for i in range(500):
            filter.add(point(ns=S + i))
        insert(buffer, 1)
        insert(buffer, 2)
        for i in range(500, 1000):
            filter.add(point(ns=S + i))
        filter.add(point(frame=""))
        until(lambda: failed)
        assert seen == list(range(1000))
        assert failed == ["EMPTY_FRAME_ID"]
        assert threads == {"tf2_ros callbacks"}
        assert filter.statistics()["passed"] == 1000
        until(lambda: "tf2_ros callbacks" not in {thread.name for thread in threading.enumerate()})

    def test_asyncio_iterates(self, filter, buffer):
        async def take():
            iteration = filter.__aiter__()
            for seconds in (1, 2, 3):
                filter.add(point(seconds))
            asyncio.get_running_loop().call_later(0.05, insert, buffer, 1)
            asyncio.get_running_loop().call_later(0.05, insert, buffer, 3)
            seen = []
            async for message, found in iteration:
                assert found.header.frame_id == "map"
                seen.append(message.header.stamp.sec)
                if len(seen) == 3:
                    filter.close()
            return seen

        assert asyncio.run(asyncio.wait_for(take(), DEADLINE_S)) == [1, 2, 3]

    def test_one_that_raises_is_logged_and_does_not_lose_the_messages_behind(self, filter, buffer, capfd):
        seen = []

        def fail(message):
            seen.append(message.header.stamp.nanosec)
            if len(seen) == 1:
                raise RuntimeError("mine")

        filter.registerCallback(fail)
        insert(buffer)
        insert(buffer, 2)
        for i in range(3):
            filter.add(point(ns=S + i))
        until(lambda: len(seen) == 3)
        assert "RuntimeError: mine" in capfd.readouterr().err

    @pytest.mark.parametrize("kind", [SingleThreadedExecutor, MultiThreadedExecutor])
    def test_the_executor_takes_over_after_the_callback_that_runs(self, filter, node, buffer, kind):
        begun, go_on, running = threading.Event(), threading.Event(), threading.Lock()
        seen = []

        def take(message):
            assert running.acquire(blocking=False), "two callbacks at once"
            seen.append((message.header.stamp.nanosec, threading.current_thread().name))
            begun.set()
            go_on.wait(DEADLINE_S)
            running.release()

        filter.registerCallback(take)
        insert(buffer)
        insert(buffer, 2)
        filter.add(point(ns=S))
        assert begun.wait(DEADLINE_S)
        executor = kind()
        executor.add_node(node)
        for i in range(1, 10):
            filter.add(point(ns=S + i))
        for _ in range(10):
            executor.spin_once(timeout_sec=0.01)
        assert len(seen) == 1
        go_on.set()
        until(lambda: len(seen) == 10, executor)
        assert [nanosec for nanosec, _ in seen] == list(range(10))
        assert [name == "tf2_ros callbacks" for _, name in seen] == [True] + [False] * 9
        # The next executor is waited for.
        executor.remove_node(node)
        filter.add(point(ns=S))
        assert len(seen) == 10
        executor.add_node(node)
        until(lambda: len(seen) == 11, executor)
        executor.shutdown()

    def test_a_node_that_was_spun_before_is_one_that_nobody_spins(self, tf2_ros, node, buffer):
        executor = SingleThreadedExecutor()
        rclpy.spin_once(node, executor=executor, timeout_sec=0)
        assert node.executor is executor
        with tf2_ros.MessageFilter(None, buffer, "map", 0, node=node) as filter:
            threads = names_of_threads(filter)
            insert(buffer)
            filter.add(point())
            until(lambda: threads == ["tf2_ros callbacks"])
        executor.shutdown()

    @pytest.mark.parametrize("begin", ["add", "spin"])
    def test_the_thread_takes_over_when_the_executor_has_gone(self, filter, node, buffer, monkeypatch, begin):
        monkeypatch.setattr("tf2_ros._wait.callbacks.PATIENCE_S", 0.2)
        executor = SingleThreadedExecutor()
        threads = names_of_threads(filter)
        insert(buffer)
        executor.add_node(node)
        if begin == "add":
            filter.add(point())  # that nobody ever takes
            executor.remove_node(node)
        else:
            executor.spin_once(timeout_sec=0)
            executor.remove_node(node)
            filter.add(point())
        until(lambda: threads == ["tf2_ros callbacks"])
        executor.add_node(node)
        filter.add(point())
        until(lambda: len(threads) == 2, executor)
        assert threads[1] == threading.current_thread().name
        executor.shutdown()

    def test_an_executor_that_is_shut_down_has_gone(self, filter, node, buffer, monkeypatch):
        monkeypatch.setattr("tf2_ros._wait.callbacks.PATIENCE_S", 0.2)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        threads = names_of_threads(filter)
        insert(buffer)
        filter.add(point())
        executor.shutdown()
        until(lambda: threads == ["tf2_ros callbacks"])

    def test_no_thread_interferes_where_a_program_spins_in_each_of_its_steps(self, filter, node, buffer):
        executor = SingleThreadedExecutor()
        threads = names_of_threads(filter)
        insert(buffer)
        rclpy.spin_once(node, executor=executor, timeout_sec=0)
        for _ in range(50):
            filter.add(point())
            rclpy.spin_once(node, executor=executor, timeout_sec=0)
            # Between the steps nobody has the node.
            assert node not in executor.get_nodes()
        end = time.monotonic() + DEADLINE_S
        while len(threads) < 50 and time.monotonic() < end:
            rclpy.spin_once(node, executor=executor, timeout_sec=0.01)
        assert threads == [threading.current_thread().name] * 50
        executor.shutdown()

    def test_a_full_queue_of_dropped_messages_ends_with_the_node(self, tf2_ros, new_node, buffer):
        node = new_node("filtering")
        filter = tf2_ros.MessageFilter(None, buffer, "map", 0, node=node)
        filter.registerCallback(print)
        node.destroy_node()
        insert(buffer)
        filter.add(point())
        assert filter._pending.next_outcome() is None
        filter.close()


class TestUnspunNode:
    """The warning that a subscription is not served."""

    SENTENCE = "A MessageFilter gets no messages of [/points], because nobody spins the node [/listening]. "
    SENTENCE += "Spin it in a thread, for example with rclpy.spin(node)."
    INPUT = (PointStamped, "points", 10)

    @pytest.fixture(autouse=True)
    def impatient(self, monkeypatch):
        monkeypatch.setattr("tf2_ros._wait.callbacks.PATIENCE_S", 0.2)

    @pytest.fixture
    def filter(self, tf2_ros, node, buffer):
        filter = tf2_ros.MessageFilter(self.INPUT, buffer, "map", 0, node=node)
        yield filter
        filter.close()

    def warnings(self, capfd, seconds=0.5):
        """How many there are after a while that is longer than any patience."""
        end = time.monotonic() + seconds
        until(lambda: time.monotonic() > end)
        errors = capfd.readouterr().err
        assert "Traceback" not in errors
        return errors.count(self.SENTENCE)

    def is_warned_of_once(self, capfd):
        errors = []
        until(lambda: errors.append(capfd.readouterr().err) or self.SENTENCE in "".join(errors))
        return "".join(errors).count(self.SENTENCE) == 1 and self.warnings(capfd) == 0

    def test_one_that_calls_back_is_warned_of_once(self, filter, capfd):
        filter.registerCallback(print)
        filter.registerFailureCallback(print)
        filter.__aiter__()
        assert self.is_warned_of_once(capfd)
        filter.registerCallback(print)
        assert self.warnings(capfd) == 0

    def test_one_that_is_iterated_over_is_warned_of(self, filter, capfd):
        async def take():
            with pytest.raises(asyncio.TimeoutError):
                await asyncio.wait_for(filter.__aiter__().__anext__(), 0.5)

        asyncio.run(take())
        assert self.is_warned_of_once(capfd)

    def test_a_subscription_of_the_node_is_warned_of(self, tf2_ros, node, buffer, capfd):
        subscription = node.create_subscription(PointStamped, "points", lambda _: None, 10)
        filter = tf2_ros.MessageFilter(subscription, buffer, "map", 0, node=node)
        filter.registerCallback(print)
        assert self.is_warned_of_once(capfd)
        filter.close()

    def test_one_that_nobody_relies_on_is_not(self, filter, capfd):
        assert self.warnings(capfd) == 0

    @pytest.mark.parametrize("when", ["before", "after"])
    def test_a_node_that_was_spun_once_is(self, tf2_ros, node, buffer, capfd, when):
        executor = SingleThreadedExecutor()
        if when == "before":
            rclpy.spin_once(node, executor=executor, timeout_sec=0)
        with tf2_ros.MessageFilter(self.INPUT, buffer, "map", 0, node=node) as filter:
            filter.registerCallback(print)
            if when == "after":
                rclpy.spin_once(node, executor=executor, timeout_sec=0)
            assert node.executor is executor
            assert self.is_warned_of_once(capfd)
        executor.shutdown()

    def test_a_node_whose_executor_nobody_spins_is(self, filter, executor, capfd):
        filter.registerCallback(print)
        assert self.is_warned_of_once(capfd)

    @pytest.mark.parametrize("kind", [SingleThreadedExecutor, MultiThreadedExecutor])
    def test_a_node_that_is_spun_is_not_until_that_ends(self, filter, node, capfd, kind):
        filter.registerCallback(print)
        executor = kind()
        executor.add_node(node)
        with spinning(executor):
            assert self.warnings(capfd, 1) == 0
            assert repr(filter).endswith(" 0 dropped>")
        assert self.is_warned_of_once(capfd)

    def test_a_node_that_is_spun_is_not_while_another_callback_runs_for_long(self, filter, node, capfd):
        begun, go_on = threading.Event(), threading.Event()

        def work():
            timer.cancel()
            begun.set()
            go_on.wait(DEADLINE_S)

        timer = node.create_timer(0.0, work)
        filter.registerCallback(print)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        with spinning(executor):
            assert begun.wait(DEADLINE_S)
            assert self.warnings(capfd, 1) == 0
            go_on.set()

    def test_a_node_that_is_spun_in_each_step_of_a_program_is_not(self, filter, node, capfd, monkeypatch):
        monkeypatch.setattr("tf2_ros._wait.callbacks.PATIENCE_S", 1)
        filter.registerCallback(print)
        executor = SingleThreadedExecutor()
        end = time.monotonic() + 2
        while time.monotonic() < end:
            rclpy.spin_once(node, executor=executor, timeout_sec=0.05)
        executor.shutdown()
        assert self.warnings(capfd, 0) == 0

    def test_one_whose_messages_are_added_is_not(self, tf2_ros, node, buffer, capfd):
        filter = tf2_ros.MessageFilter(None, buffer, "map", 0, node=node)
        filter.registerCallback(print)
        assert self.warnings(capfd) == 0
        filter.close()

    @pytest.mark.parametrize("how", ["close", "another input", "node", "shutdown"])
    def test_one_that_has_ended_is_not(self, filter, node, ros, capfd, how):
        filter.registerCallback(print)
        if how == "close":
            filter.close()
        elif how == "another input":
            filter.connectInput(Subscriber())
        elif how == "node":
            node.destroy_node()
        else:
            ros.shutdown()
        assert self.warnings(capfd) == 0


def test_a_program_has_seconds_to_spin_its_node():
    from tf2_ros._wait import callbacks

    assert callbacks.PATIENCE_S >= 5


class TestEnd:
    def test_close_ends_everything(self, watched, buffer):
        watched.filter.add(point(1))
        watched.filter.close()
        watched.filter.close()
        watched.filter.add(point(2))
        assert buffer.statistics()["waiters"] == 0
        insert(buffer)
        assert watched.passed == []
        counts = watched.filter.statistics()
        assert (counts["received"], counts["cleared"], counts["waiting"]) == (1, 1, 0)

    @pytest.mark.parametrize("how", ["shutdown", "node", "close", "nothing"])
    def test_a_process_ends_with_a_full_queue(self, how):
        process = start("full_queue.py", how, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        try:
            out, err = process.communicate(timeout=DEADLINE_S)
        finally:
            process.kill()
        assert (out, err, process.returncode) == ("at the end\n", "", 0)


@contextmanager
def lidar(scans, transforms):
    process = start("lidar.py", str(scans), str(transforms), stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        yield process
        process.communicate("\n", timeout=DEADLINE_S)
        assert process.returncode == 0
    finally:
        process.kill()


def run_lidar(process):
    assert process.stdout.readline() == "begins\n"
    process.stdin.write("\n")
    process.stdin.flush()
    assert process.stdout.readline() == "done\n"


@pytest.mark.parametrize("kind", [SingleThreadedExecutor, MultiThreadedExecutor])
class TestLidar:
    """A lidar in another process: 100 scans a second, transforms 50 ms late."""

    @pytest.fixture
    def filtering(self, tf2_ros, new_node, kind, buffer):
        node = new_node("filtering")
        executor = kind()
        executor.add_node(node)
        listener = tf2_ros.TransformListener(buffer, node)
        # The lidar's first scan needs what was before it.
        buffer.set_transform(transform("map", "lidar", 0.5), "me")
        filters = []

        def make(queue_size, **options):
            topic = (LaserScan, "scan", 1000)
            filter = tf2_ros.MessageFilter(topic, buffer, "map", queue_size, node=node, **options)
            filters.append(filter)
            filter.passed, filter.dropped = [], []
            filter.registerCallback(lambda m: filter.passed.append(m.header.stamp))
            filter.registerFailureCallback(lambda m, reason: filter.dropped.append(reason.name))
            return filter

        with spinning(executor):
            yield make
            for filter in filters:
                filter.close()
            listener.unregister()
        assert buffer.statistics()["waiters"] == 0

    def numbers(self, filter):
        """Which scans passed, in the order they did."""
        return [round((stamp.sec * S + stamp.nanosec - S) / 10_000_000) for stamp in filter.passed]

    def test_every_message_passes_exactly_once(self, filtering):
        filter = filtering(0)
        with lidar(300, 300) as process:
            run_lidar(process)
            until(lambda: filter.statistics()["passed"] == 300)
        assert self.numbers(filter) == list(range(300))
        assert filter.statistics()["dropped"] == NO_FAILURE

    def test_without_transforms_they_time_out(self, filtering):
        # Long enough for a transform on a busy machine.
        filter = filtering(0, buffer_timeout=Duration(seconds=3))
        with lidar(100, 40) as process:
            run_lidar(process)
            until(lambda: filter.statistics()["waiting"] == 0 and len(filter.dropped) == 60)
        assert self.numbers(filter) == list(range(40))
        assert filter.dropped == ["TIMEOUT"] * 60
        counts = filter.statistics()
        assert (counts["received"], counts["passed"]) == (100, 40)
        assert counts["dropped"] == {**NO_FAILURE, "TIMEOUT": 60}

    def test_without_transforms_the_queue_overflows(self, filtering):
        # Enough for seconds of scans: on a busy machine transforms arrive later than they should.
        filter = filtering(200)
        with lidar(250, 40) as process:
            run_lidar(process)
            until(lambda: filter.statistics()["received"] == 250 and len(filter.dropped) == 10)
        assert self.numbers(filter) == list(range(40))
        counts = filter.statistics()
        assert counts["dropped"] == {**NO_FAILURE, "QUEUE_FULL": 10}
        assert counts["waiting"] == 200


class TestAtAPrompt:
    def test_the_end_of_a_with_block_closes_it(self, tf2_ros, node, buffer):
        before = len(list(node.subscriptions))
        with tf2_ros.MessageFilter((PointStamped, "points", 10), buffer, "map", 0, node=node) as filter:
            assert len(list(node.subscriptions)) == before + 1
            filter.add(point(1))
            assert filter.statistics()["waiting"] == 1
        assert len(list(node.subscriptions)) == before
        assert filter.statistics()["waiting"] == buffer.statistics()["waiters"] == 0
        filter.add(point(1))
        assert filter.statistics()["received"] == 1

    def test_an_error_in_a_with_block_is_raised_and_closes_it(self, tf2_ros, node, buffer):
        with pytest.raises(ZeroDivisionError):
            with tf2_ros.MessageFilter(None, buffer, "map", 0, node=node) as filter:
                filter.add(point(1))
                raise ZeroDivisionError
        assert buffer.statistics()["waiters"] == 0

    def test_the_repr_tells_what_it_waits_for_and_what_it_did(self, make, buffer):
        watched = make(frames=["map", "odom\n"], queue_size=1)
        name = "tf2_ros.MessageFilter: into map and odom\\n"
        assert repr(watched.filter) == f"<{name}: 0 waiting, 0 passed, 0 dropped, node not spun>"
        watched.filter.add(point(1))
        watched.filter.add(point(2))
        watched.settle()
        assert repr(watched.filter) == f"<{name}: 1 waiting, 0 passed, 1 dropped>"
        watched.filter.close()
        assert repr(watched.filter) == f"<{name}: 0 waiting, 0 passed, 1 dropped, closed>"

    def test_the_repr_tells_that_nobody_spins_the_node(self, tf2_ros, node, buffer):
        executor = SingleThreadedExecutor()
        rclpy.spin_once(node, executor=executor, timeout_sec=0)
        with tf2_ros.MessageFilter(None, buffer, "map", 0, node=node) as filter:
            assert repr(filter).endswith(" 0 dropped, node not spun>")
            with spinning(executor):
                executor.add_node(node)
                until(lambda: repr(filter).endswith(" 0 dropped>"))
        assert repr(filter).endswith(" 0 dropped, closed>")

    def test_the_repr_shows_a_subclass_and_one_that_was_not_initialised(self, tf2_ros):
        class Own(tf2_ros.MessageFilter):
            pass

        assert repr(Own.__new__(Own)).endswith(".Own: not initialised>")


def test_other_inserts_do_not_examine_ten_thousand_messages(watched, buffer):
    count = 10_000
    insert(buffer, 1)
    messages = [point(ns=S + 1 + i) for i in range(count)]
    for message in messages:
        watched.filter.add(message)
    assert buffer.statistics()["waiters"] == count
    insert(buffer, 2, child="camera")
    insert(buffer, 3, child="camera")
    assert watched.filter.statistics()["waiting"] == count
    insert(buffer, 2)
    watched.settle()
    assert watched.passed == messages
    assert watched.filter.statistics()["waiting"] == 0


class TestProgramsCode:
    """Code of a program runs with no lock of a filter held, and cannot spoil its counts."""

    @pytest.fixture
    def filter(self, tf2_ros, node, buffer):
        with tf2_ros.MessageFilter(None, buffer, "map", 0, node=node) as filter:
            yield filter

    def elsewhere(self, work):
        """Do something in another thread, and wait for its end."""
        thread = threading.Thread(target=work, daemon=True)
        thread.start()
        thread.join(DEADLINE_S)
        assert not thread.is_alive(), "it waits for a lock that is held"

    def test_a_property_of_a_message_may_wait_for_another_thread(self, filter):
        elsewhere = self.elsewhere

        class Lazy:
            @property
            def header(self):
                elsewhere(lambda: filter.add(point()))
                return point().header

        filter.add(Lazy())
        assert filter.statistics()["waiting"] >= 2

    def test_a_method_of_a_buffer_may_wait_for_another_thread(self, tf2_ros, node):
        elsewhere, busy = self.elsewhere, []

        class Locked(tf2_ros.Buffer):
            def get_latest_common_time(self, *arguments):
                if not busy:
                    busy.append(1)
                    elsewhere(lambda: filter.add(point()))
                return super().get_latest_common_time(*arguments)

        buffer = Locked()
        insert(buffer)
        with tf2_ros.MessageFilter(None, buffer, "map", 0, node=node) as filter:
            filter.add(point(2))
            assert filter.statistics()["waiting"] >= 1

    @pytest.mark.parametrize(
        "header", [None, SimpleNamespace(frame_id="a", stamp=None), SimpleNamespace(frame_id=7, stamp=3)]
    )
    def test_what_is_refused_is_not_counted(self, filter, header):
        with pytest.raises(TypeError):
            filter.add(SimpleNamespace(header=header))
        assert filter.statistics()["received"] == 0

    def test_iterations_may_begin_while_messages_are_delivered(self, tf2_ros, node, buffer):
        insert(buffer)
        passed, kept, ending = [], [], threading.Event()
        interval = sys.getswitchinterval()
        sys.setswitchinterval(1e-6)
        try:
            with tf2_ros.MessageFilter(None, buffer, "map", 0, node=node) as filter:
                filter.registerCallback(passed.append)

                def iterate():
                    while not ending.is_set():
                        kept.append(filter.__aiter__())
                        del kept[:-20]

                thread = threading.Thread(target=iterate)
                thread.start()
                for _ in range(2000):
                    filter.add(point())
                until(lambda: len(passed) == 2000)
                ending.set()
                thread.join()
                assert filter.statistics()["passed"] == 2000
        finally:
            ending.set()
            sys.setswitchinterval(interval)
