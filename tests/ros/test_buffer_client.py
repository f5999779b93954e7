# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The client of a buffer that another node serves."""

import asyncio
import re
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import partial

import pytest
import reference
from interposed_libraries import output_with_library
from paths import PROGRAMS
from processes import Peer, killed, run, start
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.task import Future
from rclpy.time import Time
from simulated_clock import simulate
from spinning_nodes import shut_down_at_sleep, shut_down_quietly, spun_node
from times_and_transforms import S, at, stamp_ns, transform, translation
from waiting import DEADLINE_S, PROMPT_S, until

from tf2_msgs.action import LookupTransform
from tf2_msgs.msg import TF2Error

LATEST = Time()
LONG = Duration(seconds=DEADLINE_S)
SHORT = Duration(seconds=0.2)
ENDED = r"^The context was shut down, which ended the wait for the transform after [\d.]+ s$"
if hasattr(Context, "track_node"):  # a context first destroys its nodes
    ENDED += r"|^The buffer client was destroyed. Waited [\d.]+ s$"


class Server:
    """A buffer server that does what the target frame of a goal orders."""

    def __init__(self, node, action):
        self.is_asked = threading.Event()  # for an answer that it never gives
        self.stamps_ns = []  # of its answers to "aged"; the last one is repeated
        self.cancelled = Future()
        self.server = ActionServer(
            node,
            LookupTransform,
            action,
            self.execute,
            goal_callback=self.judge,
            cancel_callback=self.cancel,
        )

    def judge(self, goal):
        return GoalResponse.REJECT if goal.target_frame == "rejected" else GoalResponse.ACCEPT

    def cancel(self, _):
        self.cancelled.set_result(True)
        return CancelResponse.ACCEPT

    async def execute(self, handle):
        goal, result = handle.request, LookupTransform.Result()
        if goal.target_frame == "silent":
            self.is_asked.set()
            await self.cancelled
            handle.canceled() if handle.is_cancel_requested else handle.abort()
        elif goal.target_frame == "too late":
            handle.abort()
        elif goal.target_frame == "empty":
            handle.succeed()
        elif goal.target_frame.endswith("_ERROR"):
            result.error.error = getattr(TF2Error, goal.target_frame)
            result.error.error_string = f"this is a {goal.target_frame}"
            # As the reference: at once it is a success, after waiting an abortion.
            handle.abort() if goal.timeout.sec else handle.succeed()
        else:
            source = " ".join(filter(None, [goal.source_frame, goal.fixed_frame]))
            stamp = Time.from_msg(goal.target_time if goal.advanced else goal.source_time)
            if goal.target_frame == "aged":
                stamp = Time(nanoseconds=self.stamps_ns.pop(0) if self.stamps_ns[1:] else self.stamps_ns[0])
            times = Time.from_msg(goal.source_time), Duration.from_msg(goal.timeout)
            numbers = [time.nanoseconds / S for time in times]
            result.transform = transform(goal.target_frame, source, xyz=(*numbers, 0), ns=stamp.nanoseconds)
            handle.succeed()
        return result


@contextmanager
def serving(action):
    with spun_node("serving") as node:
        server = Server(node, action)
        try:
            yield server
        finally:
            # In the thread that spins the node: rclpy's executors may fail if another one does this.
            until(node.executor.create_task(server.server.destroy).done)


def send_in_executor(client, executor):
    """Let rclpy's client send in the thread that receives; otherwise, it may lose an early response."""

    def in_executor(send, *arguments):
        task = executor.create_task(send, *arguments)
        until(task.done)
        return task.result()

    for name in ("send_goal_async", "_get_result_async"):
        setattr(client, name, partial(in_executor, getattr(client, name)))


@pytest.fixture(scope="module")
def server():
    with serving("lookup") as server:
        yield server


@pytest.fixture(scope="module")
def client(tf2_ros, server):
    """A client that has found the server: that takes longer than all the rest, so they share it."""
    with spun_node("asking") as node:
        client = tf2_ros.BufferClient(node, "lookup", timeout_padding=LONG)
        if reference.release is not None:
            send_in_executor(client.action_client, node.executor)
        assert client.action_client.wait_for_server(DEADLINE_S)
        yield client
        client.destroy()


@pytest.fixture
def lonely(tf2_ros):
    """A client without a server."""
    with spun_node("asking") as node:
        client = tf2_ros.BufferClient(node, "late_lookup")
        yield client
        client.destroy()


class TestLookup:
    @pytest.mark.parametrize("awaited", [False, True])
    def test_full_sends_all_of_it_with_the_timeout_that_is_left(self, client, awaited):
        arguments = ("map", at(2.5), "robot", at(1.5), "odom")
        if awaited:
            task = client.node.executor.create_task(client.lookup_transform_full_async(*arguments))
            until(task.done)
            found, least, most = task.result(), 2**30, 2**31 - 1
        else:
            found, least, most = client.lookup_transform_full(*arguments, Duration(seconds=3)), 0, 3
        assert (found.header.frame_id, found.child_frame_id) == ("map", "robot odom")
        assert stamp_ns(found) == 2_500_000_000
        x, timeout, _ = translation(found)
        assert x == 1.5
        assert least < timeout < most

    @pytest.mark.parametrize(
        ("arguments", "error", "text"),
        [
            (("map", "robot", 1.5), TypeError, r"^time: expected .*got float: use Time\(seconds="),
            (("map", "robot", 2**62), OverflowError, "does not fit into the stamp of a message"),
            (("map", "robot", at(1.5), "1"), TypeError, r"^timeout: expected .*use Duration\(seconds="),
            ((None, "robot", LATEST), TypeError, "target_frame"),
            (("map", b"robot", LATEST), TypeError, "source_frame"),
            (("map", "\ud800", LATEST), UnicodeEncodeError, None),
            (("map", "a\0b", LATEST), ValueError, None),
            (("map", 1.5, "robot", LATEST, "odom"), TypeError, "^target_time: expected "),
            (("map", LATEST, "robot", 1.5, "odom"), TypeError, "^source_time: expected "),
            (("map", LATEST, "robot", LATEST, None), TypeError, "fixed_frame"),
        ],
    )
    def test_a_wrong_argument_is_refused_and_ends_no_other_lookup(self, client, arguments, error, text):
        look_up = client.lookup_transform if len(arguments) < 5 else client.lookup_transform_full
        with pytest.raises(error, match=text):
            look_up(*arguments)
        assert client.lookup_transform("map", "robot", LATEST, LONG).child_frame_id == "robot"


class TestAge:
    """Of the answer, by its stamp."""

    @pytest.fixture(scope="class")
    def remote(self, tf2_ros):
        """A client, the server in another process, and a third one that publishes."""
        peer = Peer()
        with spun_node("asking") as node, killed(start("serves_lookups.py", "ages")):
            client = tf2_ros.BufferClient(node, "ages", timeout_padding=LONG)
            peer.send(("map", "robot", S, 0.0), static=False)
            peer.send(("robot", "camera", S, 1.0), static=True)
            assert client.can_transform("map", "camera", LATEST, LONG)
            yield client, peer
            client.destroy()
            peer.end()

    def test_a_stale_answer_is_asked_for_again_until_it_is_fresh(self, client, server):
        now_ns = client.node.get_clock().now().nanoseconds
        for look_up in (
            lambda *query, **more: client.lookup_transform(*query, LONG, **more),
            lambda *query, **more: asyncio.run(client.lookup_transform_async(*query, **more)),
        ):
            server.stamps_ns = [S, now_ns - 2000 * S, now_ns]
            assert stamp_ns(look_up("aged", "robot", LATEST, max_age=1000)) == now_ns
            assert server.stamps_ns == [now_ns]

    def test_a_stamp_ahead_of_the_clock_is_fresh(self, client, server):
        server.stamps_ns = [client.node.get_clock().now().nanoseconds + 1000 * S]
        assert client.can_transform("aged", "robot", LATEST, max_age=0)

    def test_the_answer_of_another_process_is_judged(self, remote, tf2_py):
        client, peer = remote
        with pytest.raises(tf2_py.ExtrapolationException, match=r"^The latest .* \[robot\] to frame \[map\]"):
            client.lookup_transform("map", "robot", LATEST, max_age=1000.0)
        assert not client.can_transform("map", "robot", LATEST, SHORT, max_age=1000.0)
        assert client.lookup_transform("map", "robot", LATEST, max_age=float("inf")).header.stamp.sec == 1
        assert client.lookup_transform("robot", "camera", LATEST, max_age=0).child_frame_id == "camera"
        peer.send(("map", "robot", client.node.get_clock().now().nanoseconds, 3.0))
        assert translation(client.lookup_transform("map", "camera", LATEST, LONG, max_age=1000.0))[0] == 4.0

    def test_an_await_that_times_out_says_how_old_the_answer_is(self, client, server, tf2_py):
        server.stamps_ns = [S]
        text = (
            r"the answer of the server, at 1\.0*, is \d\d\.\d years old by the clock of the client, at [\d.]+"
            r"; max_age allows 2\.0* s\. The sample is from 1970: .*\? Waited [\d.]+ s$"
        )
        with pytest.raises(tf2_py.ExtrapolationException, match=text):
            asyncio.run(client.lookup_transform_async("aged", "robot", LATEST, timeout=0.2, max_age=2))

    def test_a_clock_that_has_not_begun_knows_no_age(self, tf2_ros, tf2_py, server, node):
        client, server.stamps_ns = tf2_ros.BufferClient(node, "lookup"), [S]
        simulate(node, seconds=0)
        assert client.can_transform("map", "robot", LATEST, LONG)  # from now on, no response is dropped
        with pytest.raises(tf2_py.ExtrapolationException, match="the clock of the client is at 0"):
            client.lookup_transform("aged", "robot", LATEST, max_age=1)
        client.destroy()

    @pytest.mark.parametrize(
        ("policy", "error", "text"),
        [
            ({"max_age": {"robot": 1.0}}, ValueError, "as one duration.* got a duration for each frame$"),
            ({"max_age": 1.0, "tolerance": 0.5}, ValueError, "only max_age, .* got tolerance$"),
            ({"max_gap": 0}, ValueError, "only max_age, .* got max_gap$"),
            ({"max_age": -1}, ValueError, r"max_age must not be negative, got -1\.0"),
            ({"max_age": "1"}, TypeError, "max_age: expected a duration"),
            ({"maxage": 1}, TypeError, "'maxage'. Did you mean 'max_age'"),
        ],
        ids=str,
    )
    def test_other_policies_are_refused(self, lonely, policy, error, text):
        for call in (lonely.lookup_transform, lonely.can_transform):
            with pytest.raises(error, match=text):
                call("map", "robot", LATEST, **policy)
        with pytest.raises(error, match=text):
            asyncio.run(lonely.lookup_transform_async("map", "robot", LATEST, **policy))

    def test_only_one_latest_time_has_an_age(self, lonely):
        text = "max_age limits the age of the latest transform: it needs one time, which must be 0"
        for call in (
            lambda: lonely.lookup_transform("map", "robot", at(1), max_age=1),
            lambda: lonely.can_transform("map", "robot", 1, max_age=1),
            lambda: lonely.lookup_transform_full("map", 0, "robot", 0, "odom", max_age=1),
            lambda: lonely.can_transform_full("map", 0, "robot", 0, "odom", max_age=1),
            lambda: asyncio.run(lonely.lookup_transform_full_async("a", 0, "b", 0, "c", max_age=1)),
            lambda: lonely.transform(transform("robot", "data", 1), "map", max_age=1),
        ):
            with pytest.raises(ValueError, match=text):
                call()


class TestErrors:
    @pytest.mark.tf2
    @pytest.mark.parametrize("timeout", [Duration(), LONG])
    @pytest.mark.parametrize(
        ("code", "name"),
        [
            ("LOOKUP_ERROR", "LookupException"),
            ("CONNECTIVITY_ERROR", "ConnectivityException"),
            ("EXTRAPOLATION_ERROR", "ExtrapolationException"),
            ("INVALID_ARGUMENT_ERROR", "InvalidArgumentException"),
            ("TIMEOUT_ERROR", "TimeoutException"),
            ("TRANSFORM_ERROR", "TransformException"),
        ],
    )
    def test_the_servers_error_is_raised(self, client, tf2_py, code, name, timeout):
        with pytest.raises(tf2_py.TransformException, match=f"this is a {code}") as caught:
            client.lookup_transform(code, "robot", LATEST, timeout)
        assert type(caught.value) is getattr(tf2_py, name)
        assert client.can_transform(code, "robot", LATEST, timeout) is False
        assert client.can_transform_full(code, LATEST, "robot", LATEST, "odom", timeout) is False

    @pytest.mark.parametrize(
        ("how", "text"), [("too late", "robot"), ("empty", "robot"), ("rejected", "refused")]
    )
    def test_an_empty_result_or_a_refused_goal_is_a_timeout(self, client, tf2_py, how, text):
        with pytest.raises(tf2_py.TimeoutException, match=text):
            client.lookup_transform(how, "robot", LATEST, LONG)

    def test_the_reason_is_returned_on_request(self, client):
        can, reason = client.can_transform("LOOKUP_ERROR", "robot", LATEST, LONG, True)
        assert (can, reason) == (False, "this is a LOOKUP_ERROR")
        assert client.can_transform("map", "robot", LATEST, LONG) is True
        full = client.can_transform_full("map", at(1), "robot", at(2), "odom", LONG, return_debug_tuple=True)
        assert full == (True, "")

    def test_a_server_that_never_answers_is_a_timeout_and_its_goal_is_cancelled(
        self, client, server, tf2_py, monkeypatch
    ):
        monkeypatch.setattr(client, "timeout_padding", Duration(seconds=0.5))
        begin = time.monotonic()
        with pytest.raises(tf2_py.TimeoutException, match="did not answer in time.* Waited"):
            client.lookup_transform("silent", "robot", LATEST, SHORT)
        assert 0.7 <= time.monotonic() - begin < PROMPT_S, "the timeout and its padding"
        until(server.cancelled.done)


class TestWithoutServer:
    def test_it_is_waited_for_no_longer_than_the_timeout(self, lonely, tf2_py):
        question = ("map", "robot", LATEST)
        for look_up in (
            lambda timeout: lonely.lookup_transform(*question, timeout),
            lambda timeout: asyncio.run(lonely.lookup_transform_async(*question, timeout=timeout)),
        ):
            for timeout in (Duration(), SHORT):
                begin = time.monotonic()
                with pytest.raises(
                    tf2_py.TimeoutException, match=r"server \[.*\] is not ready: start it"
                ) as caught:
                    look_up(timeout)
                assert timeout.nanoseconds / 1e9 <= time.monotonic() - begin < PROMPT_S
                waited = re.search(r"\. Waited (\d[\d.e-]*) s$", str(caught.value))
                assert not timeout.nanoseconds or float(waited[1]) >= 0.2

    def test_a_server_that_starts_in_time_is_found(self, lonely):
        with ThreadPoolExecutor() as pool:
            found = pool.submit(lonely.lookup_transform, "map", "robot", LATEST, LONG)
            with serving("late_lookup"):
                assert found.result().child_frame_id == "robot"

    @pytest.mark.parametrize("how", ["shutdown", "destroy", "destroy_node"])
    def test_an_end_ends_what_waits_and_what_begins_later(self, tf2_ros, ros, node, tf2_py, how):
        client = tf2_ros.BufferClient(node, "nobody")
        thread = client._tf2_goal_sender.spinner.thread
        end = {"shutdown": ros.shutdown, "destroy": client.destroy, "destroy_node": node.destroy_node}[how]
        text = ENDED if how == "shutdown" else "destroyed"

        async def main():
            awaiting = asyncio.ensure_future(client.lookup_transform_async("map", "robot", LATEST))
            await asyncio.sleep(0)
            timer.start()
            with pytest.raises(tf2_py.TimeoutException, match=text):
                await asyncio.wait_for(awaiting, DEADLINE_S)

        timer = threading.Timer(0.05, end)
        asyncio.run(main())
        with pytest.raises(tf2_py.TimeoutException, match=text):
            client.lookup_transform("map", "robot", LATEST, LONG)
        assert client.can_transform("map", "robot", LATEST, LONG, True)[0] is False
        timer.join()
        until(lambda: not thread.is_alive())
        client.destroy()

    def test_a_shutdown_that_wakes_nobody_ends_its_thread(self, tf2_ros, node):
        client = tf2_ros.BufferClient(node, "lookup")
        shut_down_at_sleep(client._tf2_goal_sender._call_queue)
        until(lambda: client._tf2_goal_sender._ended)

    def test_a_shutdown_within_a_step_of_a_goal_logs_nothing(self, tf2_ros, tf2_py, node, monkeypatch, capfd):
        """The next thing that the client asks of its node fails then."""
        client = tf2_ros.BufferClient(node, "nobody")
        is_ready = client.action_client.server_is_ready

        def shut_down_after():
            found = is_ready()
            shut_down_quietly(node.context)
            return found

        monkeypatch.setattr(client.action_client, "server_is_ready", shut_down_after)
        with pytest.raises(tf2_py.TimeoutException, match=ENDED):
            client.lookup_transform("map", "robot", LATEST, LONG)
        until(lambda: not client._tf2_goal_sender.spinner.thread.is_alive())
        assert capfd.readouterr().err == ""

    def test_a_check_frequency_of_zero_is_refused(self, tf2_ros, node):
        with pytest.raises(ValueError, match="check_frequency"):
            tf2_ros.BufferClient(node, "lookup", 0.0)


class TestThreads:
    def test_it_blocks_in_a_callback_of_a_single_threaded_executor_beside_other_threads(self, client):
        executor = client.node.executor
        assert isinstance(executor, SingleThreadedExecutor)
        found = executor.create_task(client.can_transform, "map", "robot", at(1.5), LONG)

        def look_up(i):
            stamps = [at(1 + i + j / 100) for j in range(20)]
            found = [client.lookup_transform("map", "robot", stamp, LONG) for stamp in stamps]
            return [stamp_ns(one) for one in found] == [stamp.nanoseconds for stamp in stamps]

        with ThreadPoolExecutor(5) as pool:
            assert all(pool.map(look_up, range(5)))
        assert until(found.done) and found.result()

    def test_its_action_is_named_as_the_nodes_own_and_its_node_is_hidden(self, tf2_ros, new_node):
        remapped = ["--ros-args", "-r", "old/_action/send_goal:=/new/_action/send_goal"]
        node = new_node("asking", namespace="robot", cli_args=remapped)
        names = [("lookup", "/robot/lookup"), ("~/lookup", "/robot/asking/lookup"), ("old", "/new")]
        for given, expected in names:
            client = tf2_ros.BufferClient(node, given)
            assert repr(client) == f"<tf2_ros.BufferClient: action {expected}>"
            hidden = client.action_client._node.get_name()
            assert hidden.startswith("_")
            until(lambda hidden=hidden: hidden in node.get_node_names())
            client.destroy()
            until(lambda hidden=hidden: hidden not in node.get_node_names())


def test_neither_dropped_responses_nor_a_server_that_is_half_discovered_end_a_lookup(tmp_path):
    assert output_with_library("half_discovered_server", tmp_path) == "robot\n"


def test_a_server_that_is_slow_to_accept_a_goal_gets_no_other_one(tf2_ros, node):
    """It would do the work of both, and make others wait."""
    with serving("slow_lookup") as server:
        client = tf2_ros.BufferClient(node, "slow_lookup")
        goals = []

        def judge(goal):
            goals.append(goal)
            waiting = client.action_client
            until(lambda: len(waiting._pending_goal_requests) > 1 or waiting._pending_result_requests)
            return GoalResponse.ACCEPT

        server.server.register_goal_callback(judge)
        assert client.lookup_transform("map", "robot", LATEST, LONG).child_frame_id == "robot"
        assert len(goals) == 1
        client.destroy()


@pytest.mark.parametrize("since", ["sent", "accepted"])
def test_a_goal_that_nobody_awaits_any_more_is_cancelled(tf2_ros, node, since):
    with serving("quiet_lookup") as server:
        client = tf2_ros.BufferClient(node, "quiet_lookup")
        coroutine = client.lookup_transform_async("silent", "robot", LATEST)
        coroutine.send(None)
        (pending,) = client._tf2_goal_sender._pending
        if since == "sent":
            until(lambda: pending.goal.timeout.sec < 2**31 - 1)  # what is left, when it is sent
        else:
            until(lambda: client.action_client._pending_result_requests)
        coroutine.close()
        until(server.cancelled.done)
        until(lambda: not client._tf2_goal_sender._pending)
        client.destroy()


def test_an_interrupted_lookup_prints_nothing():
    done = run(sys.executable, PROGRAMS / "interrupts_a_client.py")
    assert (done.returncode, done.stdout, done.stderr) == (0, "interrupted\n" * 5, "")


class TestServerThatEnds:
    def test_one_that_starts_again_is_found(self, tf2_ros, node):
        client = tf2_ros.BufferClient(node, "twice")
        for _ in range(2):
            with serving("twice"):
                assert client.can_transform("map", "robot", LATEST, LONG)
            until(lambda: not client.action_client.server_is_ready())
        client.destroy()

    def test_another_one_that_takes_over_gets_the_goal(self, tf2_ros, node, monkeypatch):
        monkeypatch.setattr("tf2_ros.buffer_client.GONE_NS", 10**12)
        client = tf2_ros.BufferClient(node, "taken_over")
        sender, noticed = client._tf2_goal_sender, threading.Event()
        with serving("taken_over"):
            assert client.can_transform("map", "robot", LATEST, LONG)  # from now on, no response is dropped
            monkeypatch.setattr("tf2_ros.buffer_client.REPEAT_NS", 10**12)
            coroutine = client.lookup_transform_async("silent", "robot", LATEST)
            coroutine.send(None)
            until(lambda: client.action_client._pending_result_requests)
        until(lambda: not client.action_client.server_is_ready())
        sender._call_queue.put(sender._advance_all)
        sender._call_queue.put(noticed.set)
        until(noticed.is_set)
        monkeypatch.setattr("tf2_ros.buffer_client.REPEAT_NS", 10**8)
        with serving("taken_over") as server:
            until(server.is_asked.is_set)
            coroutine.close()
            until(server.cancelled.done)
        client.destroy()

    def test_another_one_gets_the_goal_of_one_that_was_killed(self, tf2_ros, tf2_py, node, monkeypatch):
        """The middleware takes the killed one for available until its lease expires."""
        monkeypatch.setattr("tf2_ros.buffer_client.GONE_NS", 10**12)
        client = tf2_ros.BufferClient(node, "killed")

        def is_answered():
            with pytest.raises(tf2_py.TransformException) as error:
                client.lookup_transform("map", "robot", LATEST, SHORT)
            return "does not exist" in str(error.value)  # which the server says

        with killed(start("serves_lookups.py", "killed")):
            until(is_answered)  # from now on, no response is dropped
            monkeypatch.setattr("tf2_ros.buffer_client.REPEAT_NS", 10**12)
            coroutine = client.lookup_transform_async("silent", "robot", LATEST)
            coroutine.send(None)
            until(lambda: client.action_client._pending_result_requests)
        monkeypatch.setattr("tf2_ros.buffer_client.REPEAT_NS", 10**8)
        with serving("killed") as server:
            until(server.is_asked.is_set)
            coroutine.close()
            until(server.cancelled.done)
        client.destroy()

    def test_one_that_appears_beside_another_shares_the_goal(self, tf2_ros, tf2_py, node, monkeypatch):
        """It is asked, since the other one may have been killed; the first response ends both goals."""
        monkeypatch.setattr("tf2_ros.buffer_client.REPEAT_NS", 10**12)
        client, ends = tf2_ros.BufferClient(node, "shared"), []
        with serving("shared") as first:
            goal = LookupTransform.Goal(target_frame="silent", timeout=LONG.to_msg())
            client._tf2_goal_sender.send(goal, 0).add_done_callback(ends.append)
            until(first.is_asked.is_set)
            monkeypatch.setattr("tf2_ros.buffer_client.REPEAT_NS", 10**8)
            with serving("shared") as second:
                until(second.is_asked.is_set)
                second.cancelled.set_result(True)
                until(first.cancelled.done)
                until(lambda: ends)
        assert [type(end.exception()) for end in ends] == [tf2_py.TimeoutException]
        client.destroy()

    def test_pauses_between_requests_do_not_double_for_ever(self, tf2_ros, node, monkeypatch):
        """From a nanosecond on, the fiftieth pause would last a fortnight."""
        monkeypatch.setattr("tf2_ros.buffer_client.REPEAT_NS", 1)
        monkeypatch.setattr("tf2_ros.buffer_client.LONGEST_PAUSE_NS", 1)
        client = tf2_ros.BufferClient(node, "asked_often", check_frequency=100.0)
        with serving("asked_often"):
            coroutine = client.lookup_transform_async("silent", "robot", LATEST)
            coroutine.send(None)
            until(lambda: len(client.action_client._pending_result_requests) > 50)
            coroutine.close()
        client.destroy()

    def test_one_that_ends_during_a_goal_without_a_timeout_is_one(self, tf2_ros, tf2_py, node):
        client = tf2_ros.BufferClient(node, "doomed")

        async def main():
            with serving("doomed"):
                awaiting = asyncio.ensure_future(client.lookup_transform_async("silent", "robot", LATEST))
                await asyncio.sleep(0)
                until(lambda: client.action_client._pending_result_requests)
            with pytest.raises(tf2_py.TimeoutException, match="disappeared before it answered"):
                await asyncio.wait_for(awaiting, DEADLINE_S)

        asyncio.run(main())
        client.destroy()
