# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A buffer for the lookups of other processes."""

import threading

import pytest
import rclpy
from action_msgs.msg import GoalStatus
from builtin_interfaces.msg import Time as TimeMsg
from forked_children import in_a_child
from rclpy.action import ActionClient
from rclpy.context import Context
from rclpy.duration import Duration
from rclpy.executors import MultiThreadedExecutor, SingleThreadedExecutor
from spinning_nodes import shut_down_quietly, spinning, spun_node
from times_and_transforms import S, transform
from waiting import DEADLINE_S, until

from tf2_msgs.action import LookupTransform
from tf2_msgs.msg import TF2Error
from tf2_py import TransformException
from tf2_ros._qos import lookup_qos
from tf2_ros._wait.lookup_or_wait import Lookup

LONG = Duration(seconds=DEADLINE_S)
SHORT, NONE, PAST = Duration(seconds=0.1), Duration(), Duration(seconds=-1)


@pytest.fixture
def buffer(tf2_ros):
    return tf2_ros.Buffer(Duration(seconds=10))


@pytest.fixture
def server(new_node, tf2_ros, buffer):
    server = tf2_ros.BufferServer(buffer, new_node("serving"), "lookup")
    yield server
    server.destroy()


@pytest.fixture(params=[SingleThreadedExecutor, MultiThreadedExecutor])
def serving(request, server):
    """The executor that answers for `buffer`; another thread spins it."""
    executor = request.param()
    executor.add_node(server._node())
    with spinning(executor):
        yield executor


class GoalClient:
    """Sends goals as any client of the action may, in a context of its own."""

    def __init__(self, node):
        # In the thread that takes the answers: rclpy drops one that comes before it has noted the request.
        self._request = node.executor.create_task
        # The usual queue of ten would lose answers that are sent all at once.
        self.client = ActionClient(node, LookupTransform, "lookup", **lookup_qos())
        until(self.client.server_is_ready)
        until(self._is_answered)

    def _is_answered(self):
        """Whether an empty goal is answered: the middleware loses answers to clients not known yet."""
        answered = threading.Event()
        sent = self._request(self.client.send_goal_async, LookupTransform.Goal())
        sent.add_done_callback(lambda _: sent.result().add_done_callback(lambda _: answered.set()))
        return answered.wait(1)

    def send(self, target="map", source="robot", ns=S, timeout=LONG, fixed=None, target_ns=0):
        goal = LookupTransform.Goal(target_frame=target, source_frame=source, timeout=timeout.to_msg())
        goal.source_time = _time(ns)
        if fixed is not None:
            goal.advanced, goal.fixed_frame, goal.target_time = True, fixed, _time(target_ns)
        handle = _wait(_wait(self._request(self.client.send_goal_async, goal)))
        assert handle.accepted
        return handle

    def result_of(self, handle):
        return _wait(self._request(handle.get_result_async))

    def cancel(self, handle):
        """The goals that are being cancelled."""
        return _wait(_wait(self._request(handle.cancel_goal_async))).goals_canceling

    def answer_to(self, *what, **how):
        """The status and the result of a goal."""
        return _answer(self.result_of(self.send(*what, **how)))


def _time(ns):
    """Also one that no stamp has: its seconds and nanoseconds add up to more."""
    sec = min(ns // S, 2**31 - 1)
    return TimeMsg(sec=sec, nanosec=ns - sec * S)


def _wait(future):
    done = threading.Event()
    future.add_done_callback(lambda _: done.set())
    assert done.wait(DEADLINE_S), "no answer"
    return future.result()


def _answer(future):
    response = _wait(future)
    return response.status, response.result


@pytest.fixture
def goal_client(serving):
    with spun_node("client_node") as node:
        goal_client = GoalClient(node)
        yield goal_client
        # In the thread of the executor, which would raise if it met the client in between.
        _wait(node.executor.create_task(goal_client.client.destroy))


def insert(buffer, parent="map", child="robot", seconds=1.0, x=0.0):
    buffer.set_transform(transform(parent, child, seconds, (x, 0, 0)), "me")


SIMPLE = ("map", "robot", S, LONG)
FULL = ("robot", "robot", S, LONG, "map", 2 * S)


class TestAnswers:
    @pytest.mark.parametrize(("goal", "x"), [(SIMPLE, 1), (FULL, -4)], ids=["simple", "full"])
    def test_a_goal_is_answered_when_its_transform_is_available(self, goal_client, buffer, goal, x):
        waiting = goal_client.result_of(goal_client.send(*goal))
        until(lambda: buffer.statistics()["waiters"] == 1)
        assert not waiting.done()
        insert(buffer, seconds=1, x=1)
        insert(buffer, seconds=2, x=5)
        later = [goal_client.answer_to(*goal[:3], timeout, *goal[4:]) for timeout in (LONG, NONE)]
        for status, result in (_answer(waiting), *later):
            assert (status, result.error.error) == (GoalStatus.STATUS_SUCCEEDED, TF2Error.NO_ERROR)
            assert (result.transform.header.frame_id, result.transform.child_frame_id) == goal[:2]
            assert result.transform.transform.translation.x == x

    def test_many_goals_that_wait_delay_no_other(self, goal_client, buffer, serving):
        stamps = [S + i for i in range(200)]
        futures = [goal_client.result_of(goal_client.send(ns=ns)) for ns in stamps]
        until(lambda: buffer.statistics()["waiters"] == len(stamps))
        assert goal_client.answer_to("map", "map", timeout=NONE)[0] == GoalStatus.STATUS_SUCCEEDED
        served = threading.Event()
        serving.create_task(served.set)
        assert served.wait(DEADLINE_S)
        insert(buffer, seconds=1)
        insert(buffer, seconds=2)
        for ns, future in zip(stamps, futures, strict=True):
            stamp = _answer(future)[1].transform.header.stamp
            assert stamp.sec * S + stamp.nanosec == ns


class TestErrors:
    @pytest.mark.parametrize(
        ("code", "timeouts", "target", "source", "ns", "fixed"),
        [
            (TF2Error.LOOKUP_ERROR, [NONE, PAST], "map", "nobody", S, None),
            (TF2Error.CONNECTIVITY_ERROR, [NONE, PAST], "map", "island", S, None),
            (TF2Error.EXTRAPOLATION_ERROR, [NONE, PAST], "map", "robot", 9 * S, None),
            # A wait would not help.
            (TF2Error.INVALID_ARGUMENT_ERROR, [NONE, LONG], "", "robot", S, None),
            (TF2Error.INVALID_ARGUMENT_ERROR, [NONE, LONG], "map", "/map", S, None),
            (TF2Error.INVALID_ARGUMENT_ERROR, [NONE, LONG], "map", "robot", S, ""),
            (TF2Error.INVALID_ARGUMENT_ERROR, [NONE, LONG], "map", "robot", (2**31 + 2) * S, None),
        ],
    )
    def test_it_is_that_of_the_lookup(
        self, goal_client, buffer, tf2_py, code, timeouts, target, source, ns, fixed
    ):
        insert(buffer)
        insert(buffer, "sea", "island")
        with pytest.raises((tf2_py.TransformException, OverflowError)) as raised:
            if fixed is None:
                buffer.lookup_transform(target, source, _time(ns))
            else:
                buffer.lookup_transform_full(target, _time(0), source, _time(ns), fixed)
        for timeout in timeouts:
            status, result = goal_client.answer_to(target, source, ns, timeout, fixed)
            assert (status, result.error.error) == (GoalStatus.STATUS_SUCCEEDED, code)
            assert result.error.error_string == str(raised.value)

    def test_a_timeout_has_the_reason_of_the_last_attempt(self, goal_client, buffer, monkeypatch):
        begin = Lookup.wait

        def begin_and_insert(*arguments):
            wait = begin(*arguments)
            insert(buffer)
            return wait

        monkeypatch.setattr(Lookup, "wait", begin_and_insert)
        _, result = goal_client.answer_to(timeout=SHORT, ns=9 * S)
        assert result.error.error == TF2Error.TIMEOUT_ERROR
        assert "extrapolation" in result.error.error_string
        assert buffer.statistics()["waiters"] == 0


class TestCancel:
    def test_a_waiting_goal_ends_and_its_waiter_too_and_others_wait_on(self, goal_client, buffer):
        handle, other = goal_client.send(), goal_client.send()
        future, others = goal_client.result_of(handle), goal_client.result_of(other)
        until(lambda: buffer.statistics()["waiters"] == 2)
        assert len(goal_client.cancel(handle)) == 1
        status, result = _answer(future)
        assert status == GoalStatus.STATUS_CANCELED
        assert result.error.error == TF2Error.TRANSFORM_ERROR
        assert buffer.statistics()["waiters"] == 1
        insert(buffer)
        assert _answer(others)[0] == GoalStatus.STATUS_SUCCEEDED

    def test_an_answered_goal_is_not_cancelled(self, goal_client, buffer):
        insert(buffer)
        handle = goal_client.send()
        _answer(goal_client.result_of(handle))
        assert goal_client.cancel(handle) == []

    @pytest.mark.parametrize("is_first", [True, False], ids=["answered first", "cancelled first"])
    def test_what_is_first_holds_although_the_goal_has_not_ended(self, goal_client, server, buffer, is_first):
        cancel = server._cancel

        def insert_and_cancel(handle):
            if is_first:
                insert(buffer)
            response = cancel(handle)
            if not is_first:
                insert(buffer)
            return response

        server._server.register_cancel_callback(insert_and_cancel)
        handle = goal_client.send()
        future = goal_client.result_of(handle)
        assert len(goal_client.cancel(handle)) == (0 if is_first else 1)
        status, result = _answer(future)
        if is_first:
            assert (status, result.error.error) == (GoalStatus.STATUS_SUCCEEDED, TF2Error.NO_ERROR)
            assert result.transform.child_frame_id == "robot"
        else:
            assert (status, result.error.error) == (GoalStatus.STATUS_CANCELED, TF2Error.TRANSFORM_ERROR)

    def test_a_goal_that_has_ended_leaves_nothing(self, goal_client, server, buffer):
        waiting = goal_client.send()
        until(lambda: server._lookups)
        goal_client.cancel(waiting)
        goal_client.result_of(waiting)
        goal_client.answer_to(timeout=NONE)  # an error
        insert(buffer)
        goal_client.answer_to()
        until(lambda: not server._lookups)


class TestEnd:
    @pytest.mark.parametrize("how", ["destroy", "destroy_node"])
    def test_destroying_it_or_its_node_ends_the_waits_and_the_action(
        self, tf2_ros, new_node, buffer, recwarn, how
    ):
        node = new_node("serving")
        before = {*node.timers, *node.waitables}
        server = tf2_ros.BufferServer(buffer, node, "lookup")
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        with spinning(executor), spun_node("client_node") as client_node:
            goal_client = GoalClient(client_node)
            recwarn.clear()  # rclpy warns of an answer to a client that the server had not discovered
            goal_client.send()
            until(lambda: buffer.statistics()["waiters"] == 1)
            executor.create_task(getattr(server if how == "destroy" else node, how))
            until(lambda: buffer.statistics()["waiters"] == 0)
            until(lambda: not goal_client.client.server_is_ready())
            goal_client.client.destroy()
        for _ in range(2):
            server.destroy()
        assert {*node.timers, *node.waitables} <= before
        insert(buffer)
        # The first service of a process imports a module that is deprecated.
        warned = [warning for warning in recwarn if warning.category is not DeprecationWarning]
        assert [str(warning.message) for warning in warned] == []

    @pytest.mark.parametrize("step", ["execute", "answer"])
    def test_a_shutdown_before_a_step_of_a_goal_prints_no_traceback(self, tf2_ros, new_node, capfd, step):
        """rclpy fails to publish what has become of the goal."""
        done = threading.Event()

        class Ending(tf2_ros.BufferServer):
            def _begin(self, handle):
                if step == "execute":
                    self._call_queue.put(lambda: shut_down_quietly(node.context))
                super()._begin(handle)
                self._call_queue.put(done.set)

            def _finish(self, handle):
                shut_down_quietly(node.context)
                return super()._finish(handle)

        with spun_node("client_node") as client_node:
            asking = ActionClient(client_node, LookupTransform, "lookup")
            context = Context()
            context.init(args=[])
            node = rclpy.create_node("serving", context=context)
            buffer = tf2_ros.Buffer()
            insert(buffer)
            server = Ending(buffer, node, "lookup")
            executor = SingleThreadedExecutor(context=context)
            executor.add_node(node)
            with spinning(executor):
                until(asking.server_is_ready)
                goal = LookupTransform.Goal(target_frame="map", source_frame="robot")
                client_node.executor.create_task(asking.send_goal_async, goal)
                assert done.wait(DEADLINE_S)
                until(lambda: not context.ok())
            asking.destroy()
        server.destroy()
        node.destroy_node()
        assert "Traceback" not in capfd.readouterr().err

    def test_in_a_forked_child_it_is_the_parents(self, goal_client, server, buffer):
        insert(buffer)
        waitables = list(server._node().waitables)

        def end():
            server.destroy()
            assert list(server._node().waitables) == waitables

        # Ended there, it would be gone for all clients.
        assert in_a_child(end) == 0
        assert goal_client.answer_to()[0] == GoalStatus.STATUS_SUCCEEDED

    def test_anything_but_a_buffer_is_refused(self, tf2_ros, node):
        with pytest.raises(TypeError, match="buffer"):
            tf2_ros.BufferServer(object(), node, "lookup")


def test_a_client_answers_as_the_buffer_does(tf2_ros, serving, buffer):
    """Also before 1970, and where no frame has a name, which the answer then lacks, too."""
    buffer.set_transform(transform("map", "robot", 1), "test")
    with spun_node("asking") as node:
        client = tf2_ros.BufferClient(node, "lookup", timeout_padding=LONG)
        until(lambda: client.can_transform("map", "robot", 0, LONG))
        for names in (("robot", "robot"), ("", ""), ("", "robot"), ("map", "")):
            for stamp in (TimeMsg(), TimeMsg(sec=-2), TimeMsg(sec=-2, nanosec=5), TimeMsg(sec=1)):
                assert outcome(client, *names, stamp) == outcome(buffer, *names, stamp), (names, stamp)
        with pytest.raises(ValueError, match="max_age"):
            client.lookup_transform("robot", "robot", TimeMsg(sec=-2), max_age=1)
        client.destroy()


def outcome(buffer, *arguments):
    try:
        return buffer.can_transform(*arguments), buffer.lookup_transform(*arguments)
    except TransformException as error:
        return type(error), str(error)
