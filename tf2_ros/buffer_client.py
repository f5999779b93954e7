# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Look up transforms in the buffer of another process, through an action."""

import tf2_ros_cython._ros_requirement  # noqa: F401

import os
import threading
import time
import weakref
from collections.abc import Callable, Generator, Mapping
from contextlib import suppress
from functools import partial
from typing import Any, TypeVar
from uuid import uuid4

from action_msgs.msg import GoalInfo, GoalStatus
from geometry_msgs.msg import TransformStamped
from rclpy.action.client import ActionClient
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

import tf2_py as tf2
from tf2_msgs.action import LookupTransform
from tf2_msgs.msg import TF2Error
from tf2_py import TimeoutException, TransformException
from tf2_py._internal import class_name, duration_ns, errors, frame_name, policy_of
from tf2_py.printable import printable
from tf2_py.typing import DurationLike, LookupPolicy, TimeLike, Unpack
from tf2_ros._arguments import optional_timeout_ns
from tf2_ros._messages import time_msg
from tf2_ros._nodes.ended_nodes import require_node
from tf2_ros._nodes.hidden_nodes import companion_node
from tf2_ros._nodes.spinner import Spinner
from tf2_ros._nodes.topic_publishers import publisher_ids
from tf2_ros._process.forking import refuse_inherited
from tf2_ros._qos import lookup_qos
from tf2_ros._rclpy import context_was_shut_down, handle_of_goal
from tf2_ros._sources import SHUT_DOWN
from tf2_ros._wait.call_runners import call_queue_of
from tf2_ros._wait.futures import WakingFuture
from tf2_ros._wait.lookup_or_wait import warn_in_a_loop
from tf2_ros.buffer_interface import NO_TIMEOUT, BufferInterface
from tf2_ros.buffer_server import CODES, GOAL_SERVICE, STATUS_TOPIC

__all__ = [
    "ActionClient",
    "BufferClient",
    "Duration",
    "LookupTransform",
    "LookupTransformGoal",
    "LookupTransformResult",
    "Node",
    "Time",
    "TransformStamped",
    "tf2",
]

LookupTransformGoal = TypeVar("LookupTransformGoal")
LookupTransformResult = TypeVar("LookupTransformResult")

# Without a response, the result is requested again after the first of these times, then after twice as long
# each time, up to the second. A server keeps all requests of a goal until it has the result.
REPEAT_NS = 10**9
LONGEST_PAUSE_NS = 30 * 10**9
# A server counts as gone when it has been unavailable for this long. While the middleware discovers another
# server of the same name, it finds none available.
GONE_NS = 10**9
FOR_EVER = Duration(seconds=2**31 - 1)  # the longest that a duration message can hold

EXCEPTIONS = {code: kind for kind, code in CODES}


class PendingGoal(WakingFuture[Any]):
    """The future of the result of one goal, or of a TimeoutException that says what failed."""

    def __init__(self, goal: Any, padding_ns: int, max_age_ns: int | None) -> None:
        super().__init__()
        self.goal, self.max_age_ns = goal, max_age_ns
        self.begin_ns = time.monotonic_ns()
        # Steady times: of the lookup, and until which a server that was found may respond.
        self.deadline_ns = self.begin_ns + Duration.from_msg(goal.timeout).nanoseconds
        self.last_ns = self.deadline_ns + padding_ns
        self.is_abandoned = False  # nobody asks for its outcome

    def error(self, text: str) -> TimeoutException:
        """The exception of a goal that fails now."""
        return TimeoutException(errors.after_wait(text, time.monotonic_ns() - self.begin_ns))


class SentGoal:
    """
    One goal that was sent, with the requests of its result.

    :param on_response: called after each response of the server.
    """

    def __init__(self, client: ActionClient, goal: Any, on_response: Callable[[Any], None]) -> None:
        identifier = GoalInfo().goal_id
        identifier.uuid = list(uuid4().bytes)
        self._on_response = on_response
        self._request: Any = client.send_goal_async(goal, goal_uuid=identifier)
        self._request.add_done_callback(on_response)
        # Also for a goal whose acceptance was dropped.
        self._handle = handle_of_goal(client, LookupTransform, identifier)
        self._accepted = False
        self._results: list[Any] = []  # futures
        self.refused = False
        self.unknown = False  # to the server, when it last said so

    def request_result(self) -> None:
        """Request the result, once more."""
        self._results.append(self._handle.get_result_async())
        self._results[-1].add_done_callback(self._on_response)

    def result(self) -> Any:
        """The response with the result, or None; requests it when the server has accepted the goal."""
        if self._request.done() and not self._accepted and not self.refused:
            self._accepted = self._request.result().accepted
            self.refused = not self._accepted
            if self._accepted:
                self.unknown = False
                self.request_result()
        for request in [request for request in self._results if request.done()]:
            response = request.result()
            if response.status != GoalStatus.STATUS_UNKNOWN:
                return response
            # Earlier ones may say so because the server had not taken the goal yet.
            self.unknown = self.unknown or request is self._results[-1]
            self._results.remove(request)
        return None

    def cancel(self, _: object = None) -> None:
        """Cancel the goal in the server, and again if a server that is busy accepts it later."""
        if not self._request.done():
            self._request.add_done_callback(self.cancel)
        elif not self._request.result().accepted:
            return
        with suppress(RuntimeError):  # the context was shut down
            self._handle.cancel_goal_async()


class GoalSender:
    """
    Sends goals to the action of a buffer server.

    :param node: the node of the client. Goals do not depend on its executor: a hidden node in the same
        context, which a separate thread spins, sends them.
    :param ns: the name of the action, as this node resolves it.
    :param period_s: how often to check for the server and for the end of a timeout.
    """

    def __init__(self, node: Node, ns: str, period_s: float) -> None:
        # As a client of the node itself would have it, remapping included.
        self.name = node.resolve_service_name(ns + GOAL_SERVICE).removesuffix(GOAL_SERVICE)
        self.process = os.getpid()
        self._pending: dict[PendingGoal, Generator[None, None, Any]] = {}  # with the steps that are left
        self._servers: set[bytes] = set()  # at the last check
        self._appearances = 0  # how often a check has found a new server
        self._ended = False
        self._clock = node.get_clock()  # which counts the age of answers
        self._node = hidden = companion_node("_buffer_client_impl", self, node)
        self.action_client = ActionClient(hidden, LookupTransform, self.name, **lookup_qos())
        # All else happens in the thread of the hidden node, because rclpy's action client loses a response
        # that arrives before the thread that sent the request has returned.
        self._call_queue = call_queue_of(hidden)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = hidden.create_timer(period_s, self._advance_all, clock=steady)
        self._timer.cancel()
        self.spinner = Spinner(hidden, daemon=True, at_end=self._end, until=node)
        self.spinner.thread.name = "tf2_ros buffer client"

    def send(self, goal: Any, padding_ns: int, max_age_ns: int | None = None) -> PendingGoal:
        """
        Send a goal, as soon as a server is available.

        :param goal: its ``timeout`` is for finding a server and for the lookup, in steady time.
        :param padding_ns: how much longer to wait for the response of a server that was found.
        :param max_age_ns: how old the answer may be; an older one is asked for again until the timeout.
        """
        pending = PendingGoal(goal, padding_ns, max_age_ns)
        self._pending[pending] = self._steps(pending)
        self._call_queue.put(partial(self._advance, pending))
        if self._ended:
            self._fail_at_end(pending)
        return pending

    def abandon(self, pending: PendingGoal) -> None:
        """Cancel a goal, unless it has a result; nobody else waits for it. From any thread."""
        pending.is_abandoned = True
        if pending.done():
            pending.exception()  # so that it does not print that nobody has asked for it
        else:
            self._call_queue.put(partial(self._forget, pending))

    # All that follows happens in the thread.

    def _end(self) -> None:
        self._ended = True
        for pending in list(self._pending):
            self._fail_at_end(pending)
        self._call_queue.close("the client has ended")
        self.action_client.destroy()
        self._node.destroy_node()
        del self._timer  # it refers to this, so only the collector would free both

    def _fail_at_end(self, pending: PendingGoal) -> None:
        if context_was_shut_down(self._node.context):
            error = TimeoutException(errors.in_vain(SHUT_DOWN, time.monotonic_ns() - pending.begin_ns))
        else:
            error = pending.error("The buffer client was destroyed.")
        self._forget(pending)
        self._fail(pending, error)

    def _fail(self, pending: PendingGoal, error: Exception) -> None:
        pending.set_exception(error)
        if pending.is_abandoned:
            pending.exception()

    def _forget(self, pending: PendingGoal) -> None:
        """Take no more steps of a goal; it is canceled in the server, if it was sent and has no result."""
        steps = self._pending.pop(pending, None)
        if steps is not None:
            steps.close()

    def _find_servers(self) -> set[bytes]:
        return publisher_ids(self._node, self.name + STATUS_TOPIC)

    def _advance_all(self) -> None:
        """Check for new servers, and take the next step of each goal; after each period."""
        # A server that was killed remains available until its lease expires, in 20 s with Fast DDS.
        servers = self._find_servers()
        self._appearances += not servers <= self._servers
        self._servers = servers
        for pending in list(self._pending):
            self._advance(pending)

    def _advance(self, pending: PendingGoal, _: object = None) -> None:
        """Take the next step of a goal, unless it has ended; after each period and response."""
        try:
            if pending in self._pending:
                next(self._pending[pending])
        except StopIteration as end:
            self._forget(pending)
            pending.set_result(end.value)
        except Exception as error:
            self._forget(pending)
            # Without a context nothing can be sent; after its shutdown no outcome is expected.
            if not self._node.context.ok():
                self._fail_at_end(pending)
            # Its traceback would refer to the goal, which refers to it.
            self._fail(pending, error.with_traceback(None))
        if not self._pending:
            self._timer.cancel()
        elif self._timer.is_canceled():
            self._servers = self._find_servers()
            self._timer.reset()

    def _steps(self, pending: PendingGoal) -> Generator[None, None, Any]:
        """Return the result of a goal, once that is fresh; resumed by ``_advance``."""
        while True:
            result = yield from self._result(pending)
            text = self._staleness(pending, result)
            if not text:
                return result
            if time.monotonic_ns() >= pending.deadline_ns:
                text = errors.after_wait(text, time.monotonic_ns() - pending.begin_ns)
                raise tf2.ExtrapolationException(text)
            yield

    def _staleness(self, pending: PendingGoal, result: Any) -> str:
        """What is said of an answer that is too old; "": it is not."""
        stamp, max_age_ns = result.transform.header.stamp, pending.max_age_ns
        stamp_ns = stamp.sec * errors.NS_PER_S + stamp.nanosec  # an rclpy Time cannot be negative
        # The stamp of a static transform, and that of an error, is 0.
        if max_age_ns is None or stamp_ns == 0:
            return ""
        now_ns, frames = self._clock.now().nanoseconds, (pending.goal.target_frame, pending.goal.source_frame)
        is_fresh = 0 < now_ns <= stamp_ns + max_age_ns
        return "" if is_fresh else str(errors.stale(None, "", stamp_ns, now_ns, max_age_ns, *frames))

    def _result(self, pending: PendingGoal) -> Generator[None, None, Any]:
        """Find a server, send a goal, and return its result."""
        while not self.action_client.server_is_ready():
            if time.monotonic_ns() >= pending.deadline_ns:
                raise pending.error(
                    f"The buffer server [{self.name}] is not ready: start it, or check its name."
                )
            yield
        sent: list[SentGoal] = []
        try:
            goal, response = yield from self._response(pending, sent)
            sent.remove(goal)
        finally:  # also if it was abandoned
            for goal in sent:
                goal.cancel()
        lookup, result = pending.goal, response.result
        # A server whose wait timed out or was cancelled may send an empty result without an error. But the
        # transform from the frame without a name to itself, which tf2 looks up, has no names, either.
        is_empty = lookup.target_frame and not result.transform.header.frame_id
        if result.error.error == TF2Error.NO_ERROR and (
            response.status != GoalStatus.STATUS_SUCCEEDED or is_empty
        ):
            raise pending.error(
                f"The buffer server [{self.name}] did not get the transform from "
                f"[{printable(lookup.source_frame)}] to [{printable(lookup.target_frame)}] in time."
            )
        return result

    def _response(
        self, pending: PendingGoal, sent: list[SentGoal]
    ) -> Generator[None, None, tuple[SentGoal, Any]]:
        """
        Send a goal, and return it with the first response that has its result.

        The middleware drops the responses of a server that has not discovered this client yet. So the result
        is requested again, also of a goal whose acceptance may have been dropped. The goal itself is sent
        again only if the server does not know it: a busy server would otherwise do the same work repeatedly.
        When another server appears, its answer decides at once, because the former one may have been killed.

        :param sent: receives the goals that were sent.
        """
        server = f"The buffer server [{self.name}]"
        pause_ns, next_ns = REPEAT_NS, 0
        missing_ns: int | None = None  # the time since when the server is unavailable
        appearances, is_new = self._appearances, False  # whether a server may not have been sent the goal
        while True:
            for goal in sent:
                response = goal.result()
                if response is not None:
                    return goal, response
                if goal.refused:
                    raise pending.error(f"{server} refused the goal: check its log.")
            now_ns = time.monotonic_ns()
            if not self.action_client.server_is_ready():
                missing_ns = missing_ns or now_ns
                if now_ns - missing_ns >= GONE_NS:
                    raise pending.error(f"{server} disappeared before it answered: restart it.")
            elif missing_ns is not None or appearances != self._appearances:
                missing_ns, appearances, is_new = None, self._appearances, True
                pause_ns, next_ns = REPEAT_NS, now_ns
            if sent and now_ns >= pending.last_ns:
                raise pending.error(f"{server} did not answer in time: check that its node is spun.")
            known = [goal for goal in sent if not goal.unknown]
            if now_ns >= next_ns or (is_new and not known):
                next_ns, pause_ns = now_ns + pause_ns, min(2 * pause_ns, LONGEST_PAUSE_NS)
                for goal in known:
                    goal.request_result()
                if not known:
                    is_new = False
                    left_ns = max(pending.deadline_ns - now_ns, 0)
                    pending.goal.timeout = Duration(nanoseconds=left_ns).to_msg()
                    sent.append(SentGoal(self.action_client, pending.goal, partial(self._advance, pending)))
            yield


class BufferClient(BufferInterface):
    """
    Looks up transforms in the buffer of a buffer server.

    :param node: the node whose context and namespace are used. It need not be spun: a hidden node with a
        separate thread sends the goals, so blocking lookups also work in callbacks of any executor.
    :param ns: the name of the server's action.
    :param check_frequency: how often to check for a server and for the end of a timeout, in Hz.
    :param timeout_padding: how much longer than the timeout of a lookup to wait for the server's response.
    :raises ValueError: ``check_frequency`` is not above 0.

    A ``timeout`` covers both finding a server and the lookup in the server. Without a timeout, a coroutine
    waits for the transform until the server disappears or the context is shut down. A lookup raises what the
    lookup in the server raises. It raises a ``TimeoutException`` if no server was found, if the server did
    not answer, if the transform was not available in time, or if the context was shut down; the text says
    which, and how long the wait took.

    Of the options of a :class:`~tf2_py.typing.LookupPolicy`, a lookup at time 0 accepts ``max_age``, as one
    duration: the answer is asked for again, ``check_frequency`` times a second, until its stamp is at most
    this old on the clock of ``node``, or the timeout passes, which raises an ``ExtrapolationException``. The
    stamp is that of the frame that was updated least recently; 0 is that of a static transform, which has no
    age. Any other option, and ``max_age`` for another time or for two times, is a ``ValueError``.

    ``destroy()`` ends the client, and so does destroying the node.

    For every ``time`` and ``timeout``, see :class:`tf2_ros.Buffer`.

    >>> from rclpy.time import Time
    >>> from tf2_ros import BufferClient
    >>> client = BufferClient(node, "tf2_buffer_server")  # of any node, such as rclpy.create_node("example")
    >>> client.can_transform("map", "base_link", Time())  # no server runs
    False
    >>> client.destroy()
    """

    def __init__(
        self,
        node: Node,
        ns: str,
        check_frequency: float = 10.0,
        timeout_padding: DurationLike = Duration(seconds=2.0),  # noqa: B008  as in tf2; a Duration cannot change
    ) -> None:
        require_node("BufferClient", node, "create_client", ns, "the node first, then the name")
        if not check_frequency > 0.0:
            raise ValueError(f"check_frequency: expected a number above 0 Hz, got {check_frequency}")
        super().__init__()
        self.node = node
        self.check_frequency = check_frequency
        self.timeout_padding = timeout_padding
        self._tf2_goal_sender = GoalSender(node, ns, 1.0 / check_frequency)
        self.action_client = self._tf2_goal_sender.action_client
        # Without destroy(), too, no thread remains; at exit it ends by itself.
        weakref.finalize(self, self._tf2_goal_sender.spinner.stop, wait=False).atexit = False

    def __repr__(self) -> str:
        return f"<{class_name(type(self))}: action {printable(self._tf2_goal_sender.name)}>"

    def destroy(self) -> None:
        """End the client; pending lookups raise a TimeoutException. May be called again."""
        self._tf2_goal_sender.spinner.stop()

    def lookup_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        timeout: DurationLike = NO_TIMEOUT,
        **policy: "Unpack[LookupPolicy]",
    ) -> TransformStamped:
        """
        Get the pose of ``source_frame`` in ``target_frame``, which converts data from source to target.

        A point at p in ``source_frame`` is at R p + t in ``target_frame``: R and t are the rotation and the
        translation returned. ``Time()``, which is 0, asks for the latest time for which all frames on the
        path have data. The default ``timeout`` does not wait.

        :param target_frame: the frame into which the data is to be transformed.
        :param source_frame: the frame that the data is in.
        :param time: the time; 0 is the latest time for which all frames on the path have data. An int
            is nanoseconds.
        :param timeout: how long to wait for an answer, in steady time. A number is seconds. Zero or negative:
            do not wait.
        :param policy: options such as ``tolerance``, see :class:`tf2_ros.Buffer`. A
            :class:`tf2_ros.BufferClient` accepts ``max_age``, as one duration.
        :return: a ``TransformStamped`` from ``target_frame`` (its ``header.frame_id``) to ``source_frame``
            (its ``child_frame_id``), stamped with ``time``, or with the latest time if that is 0. With a
            ``tolerance``, the stamp is the oldest at which a frame stays, unless ``extrapolate`` is set.
        :raises LookupException: a frame is unknown, or the tree contains a loop.
        :raises ConnectivityException: the frames are in different trees.
        :raises ExtrapolationException: a frame on the path has no data for the time, only data that is older
            than ``max_age``, or a gap that is longer than ``max_gap``.
        :raises InvalidArgumentException: a name is empty or begins with ``/``; raised without waiting.
        :raises TypeError: a name is not a str, ``time`` is not a time, or ``timeout`` is not a duration.
        :raises ValueError: a limit is negative, or of a frame that is unknown or not a child, or ``max_age``
            is given for a time that is not 0, or to a buffer without a clock.

        After a wait, the text of an error also says how long it took, or that a shutdown ended it.

        >>> buffer.lookup_transform("base_link", "camera", 1_000_000_000, timeout=0.5).header.stamp.sec
        1
        """
        return self.__process_goal(_simple_goal(target_frame, source_frame, time, timeout), policy)

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        timeout: DurationLike = NO_TIMEOUT,
        **policy: "Unpack[LookupPolicy]",
    ) -> TransformStamped:
        """
        Get the pose of ``source_frame`` at ``source_time`` in ``target_frame`` at ``target_time``.

        It converts data from the source to the target: a point at p in ``source_frame`` at ``source_time`` is
        at R p + t in ``target_frame`` at ``target_time``, if ``fixed_frame`` does not move in between.
        ``Time()``, which is 0, means the latest time. The default ``timeout`` does not wait.

        The other arguments are those of :meth:`lookup_transform`, which raises the same.

        :param target_time: the time in ``target_frame``; 0 is the latest time for which all frames on the
            path between it and ``fixed_frame`` have data.
        :param source_time: the time of the data; 0 as above, for the path between it and ``fixed_frame``.
        :param fixed_frame: a frame that does not move between the two times.
        :return: a ``TransformStamped``, stamped with the target's time.
        """
        goal = _full_goal(target_frame, target_time, source_frame, source_time, fixed_frame, timeout)
        return self.__process_goal(goal, policy)

    async def lookup_transform_async(
        self,
        target_frame: str,
        source_frame: str,
        time: TimeLike,
        *,
        timeout: DurationLike | None = None,
        **policy: "Unpack[LookupPolicy]",
    ) -> TransformStamped:
        """
        Await what :meth:`lookup_transform` returns: the pose of ``source_frame`` in ``target_frame``, which
        converts data from the source to the target. Without ``timeout`` it waits forever.

        :param timeout: how long to wait, in steady time. None: until the context is shut down. The other
            arguments are those of :meth:`lookup_transform`.
        :raises TimeoutException: it was not available in time, or not before the shutdown of the context; the
            text says which, and the reason.
        :raises InvalidArgumentException: a name is empty or begins with ``/``.
        :raises TypeError: a name is not a str, ``time`` is not a time, or ``timeout`` is not a duration.

        This is a coroutine for asyncio and for rclpy's executors. Give a callback of rclpy that awaits it a
        ``ReentrantCallbackGroup``: in the node's default group, no other callback runs meanwhile.
        """
        return await self._tf2_await(_simple_goal(target_frame, source_frame, time, timeout), policy)

    async def lookup_transform_full_async(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        *,
        timeout: DurationLike | None = None,
        **policy: "Unpack[LookupPolicy]",
    ) -> TransformStamped:
        """
        Await what :meth:`lookup_transform_full` returns, with its arguments. Without ``timeout`` it waits
        forever. :meth:`lookup_transform_async` describes the rest, such as what it raises.
        """
        goal = _full_goal(target_frame, target_time, source_frame, source_time, fixed_frame, timeout)
        return await self._tf2_await(goal, policy)

    def __process_goal(self, goal: Any, policy: LookupPolicy | None = None) -> TransformStamped:
        warn_in_a_loop()
        pending = self._tf2_send(goal, policy or {})
        # Not an Event: a signal handler that raises inside one leaves it locked.
        done = threading.Lock()
        done.acquire()
        pending.add_done_callback(lambda _: done.release())
        try:
            # The sender's thread gives every goal an outcome, also at its own end.
            done.acquire()
            return self.__process_result(pending.result())
        finally:
            self._tf2_goal_sender.abandon(pending)

    def __process_result(self, result: Any) -> TransformStamped:
        if result.error.error != TF2Error.NO_ERROR:
            raise EXCEPTIONS.get(result.error.error, TransformException)(printable(result.error.error_string))
        return result.transform

    async def _tf2_await(self, goal: Any, policy: LookupPolicy) -> TransformStamped:
        pending = self._tf2_send(goal, policy)
        try:
            return self.__process_result(await pending)
        finally:
            self._tf2_goal_sender.abandon(pending)

    def _tf2_send(self, goal: Any, policy: LookupPolicy) -> PendingGoal:
        refuse_inherited(self, self._tf2_goal_sender.process)
        padding_ns = duration_ns(self.timeout_padding, "timeout_padding")
        return self._tf2_goal_sender.send(goal, padding_ns, _max_age_ns(goal, policy))


def _max_age_ns(goal: Any, policy: LookupPolicy) -> int | None:
    """How old the answer to a goal may be; None: any age."""
    policy_of("lookup_transform", True, **policy)
    given = {key: value for key, value in policy.items() if value is not None and value is not False}
    max_age: Any = given.pop("max_age", None)
    if given or isinstance(max_age, Mapping):
        raise ValueError(
            "a BufferClient accepts only max_age, as one duration, because all that it knows of an answer's "
            f"data is the stamp; got {' and '.join(given) or 'a duration for each frame'}"
        )
    if max_age is not None and (goal.advanced or goal.source_time.sec or goal.source_time.nanosec):
        raise ValueError("max_age limits the age of the latest transform: it needs one time, which must be 0")
    return optional_timeout_ns(max_age, "max_age")


# The names are checked here, because a message accepts any object until the sender's thread serializes it.


def _simple_goal(
    target_frame: str, source_frame: str, time: Any, timeout: Any, time_argument: str = "time"
) -> Any:
    timeout_ns = FOR_EVER.nanoseconds if timeout is None else max(duration_ns(timeout, "timeout"), 0)
    return LookupTransform.Goal(
        target_frame=frame_name(target_frame, "target_frame"),
        source_frame=frame_name(source_frame, "source_frame"),
        source_time=time_msg(time, time_argument),
        timeout=min(Duration(nanoseconds=timeout_ns), FOR_EVER).to_msg(),
    )


def _full_goal(
    target_frame: str, target_time: Any, source_frame: str, source_time: Any, fixed_frame: str, timeout: Any
) -> Any:
    goal = _simple_goal(target_frame, source_frame, source_time, timeout, "source_time")
    goal.target_time = time_msg(target_time, "target_time")
    goal.fixed_frame = frame_name(fixed_frame, "fixed_frame")
    goal.advanced = True
    return goal
