"""Look up transforms in the buffer of another process, through an action."""

# Imported first, because it explains what to install if the imports below fail.
from tf2_ros_cython import _requirement  # noqa: F401

# isort: split

import os
import threading
import time
import weakref
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any, TypeVar

from action_msgs.msg import GoalStatus
from geometry_msgs.msg import TransformStamped
from rclpy.action.client import ActionClient
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.task import Future

from tf2_msgs.action import LookupTransform
from tf2_msgs.msg import TF2Error
from tf2_py import TimeoutException, TransformException
from tf2_py._internal import class_name, counted, duration_ns, errors, frame_name, printable
from tf2_py.typing import DurationLike, TimeLike
from tf2_ros import _names
from tf2_ros._arguments import optional_timeout_ns, require_node
from tf2_ros._forking import FORKED, is_inherited, refuse_inherited
from tf2_ros._messages import time_msg
from tf2_ros._nodes import Spinner, hidden_node, node_has_ended
from tf2_ros._qos import lookup_qos
from tf2_ros._rclpy import context_was_shut_down
from tf2_ros._receive.inboxes import check_regularly
from tf2_ros._wait.callbacks import callback_queue
from tf2_ros._wait.futures import WakingFuture
from tf2_ros._wait.timers import deadlines
from tf2_ros.buffer_interface import NO_TIMEOUT, BufferInterface
from tf2_ros.buffer_server import CODES

__all__ = ["BufferClient", "LookupTransformGoal", "LookupTransformResult"]
_names.offer(globals())

LookupTransformGoal = TypeVar("LookupTransformGoal")
LookupTransformResult = TypeVar("LookupTransformResult")

FOR_EVER = Duration(seconds=2**31 - 1)  # the longest that a duration message can hold
GOAL_SERVICE = "/_action/send_goal"

EXCEPTIONS = {code: kind for kind, code in CODES}


class PendingGoal(WakingFuture[Any]):
    """The future of the server's response to one goal, or of a TimeoutException that says what failed."""

    def __init__(self, sender: "GoalSender", goal: Any, timeout_ns: int | None, padding_ns: int) -> None:
        super().__init__()
        self.goal = goal
        self.begin_ns = time.monotonic_ns()
        # Steady times: of the lookup, and until which a server that was found may respond.
        self.deadline_ns = None if timeout_ns is None else self.begin_ns + timeout_ns
        self.last_ns = None if timeout_ns is None else self.begin_ns + timeout_ns + padding_ns
        self.request: Future | None = None  # what was sent last, the goal or the request for its result
        self.handle: Any = None  # if the server has accepted the goal
        self._sender = sender

    def error(self, text: str) -> TimeoutException:
        """The exception of a goal that fails now."""
        return TimeoutException(errors.after_wait(text, time.monotonic_ns() - self.begin_ns))

    def expire(self) -> None:
        """A deadline has passed."""
        self._sender.put(self._sender.advance, self)

    def abandon(self) -> None:
        """Stop waiting for the response, and cancel the goal; without effect if it is over."""
        if not self.over():
            self._sender.put(self._sender.abandon, self)

    def send_to(self, action_client: ActionClient) -> Future:
        """Send the goal, with what is left of its timeout."""
        timeout = FOR_EVER
        if self.deadline_ns is not None:
            left_ns = max(self.deadline_ns - time.monotonic_ns(), 0)
            timeout = Duration(nanoseconds=min(left_ns, FOR_EVER.nanoseconds))
        self.goal.timeout = timeout.to_msg()
        return action_client.send_goal_async(self.goal)

    def cancel_in_server(self) -> None:
        """Cancel the goal in the server, now or when it says that it has accepted the goal."""
        if self.handle is not None:
            self.handle.cancel_goal_async()
        elif self.request is not None and self.request.done():
            _cancel_if_accepted(self.request)  # its executor may be shut down, and call nothing any more
        elif self.request is not None:
            self.request.add_done_callback(_cancel_if_accepted)


class GoalSender:
    """
    Sends goals to the action of a buffer server.

    :param node: the node of the client. Goals do not depend on its executor: a hidden node in the same
        context, which a separate thread spins, sends them.
    :param ns: the name of the action, as this node resolves it.
    :param period_s: how often to check whether the server is available.
    """

    def __init__(self, node: Node, ns: str, period_s: float) -> None:
        self._name = _resolved(node, ns)
        self.process = os.getpid()
        self._pending: set[PendingGoal] = set()
        self._ended = False
        self._node = hidden = hidden_node(
            "_buffer_client_impl",
            self,
            context=node.context,
            namespace=node.get_namespace(),
            use_global_arguments=False,
        )
        self.action_client = ActionClient(
            hidden,
            LookupTransform,
            self._name,
            goal_service_qos_profile=lookup_qos(),
            result_service_qos_profile=lookup_qos(),
            cancel_service_qos_profile=lookup_qos(),
        )
        # All else happens in the thread of the hidden node, because rclpy's action client loses a response
        # that arrives before the thread that sent the request has returned.
        self._queue = callback_queue(hidden)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = hidden.create_timer(period_s, self._advance_all, clock=steady)
        self._timer.cancel()
        self._spinner = Spinner(hidden, daemon=True, at_end=self._end)
        self._spinner.thread.name = "tf2_ros buffer client"
        self._owner_node = weakref.ref(node)
        check_regularly(self)

    def send(self, goal: Any, timeout_ns: int | None, padding_ns: int) -> PendingGoal:
        """
        Send a goal, as soon as a server is available.

        :param timeout_ns: nanoseconds of steady time, for finding a server and for the lookup. None: no end.
        :param padding_ns: how much longer to wait for the response of a server that was found.
        """
        pending = PendingGoal(self, goal, timeout_ns, padding_ns)
        self._pending.add(pending)
        self.put(self._begin, pending)
        for deadline_ns in (pending.deadline_ns, pending.last_ns):
            if deadline_ns is not None:
                deadlines.add(deadline_ns, pending)
        if self._ended:
            self._end_goal(pending, self._end_error(pending))
        return pending

    def state(self) -> str:
        """Describe the action, and how many goals have no outcome yet."""
        goals = "ended" if self._ended else counted(len(self._pending), "pending lookup")
        goals = FORKED if is_inherited(self.process) else goals
        return f"action {printable(self._name)}, {goals}"

    def put(self, call: Callable[[PendingGoal], None], pending: PendingGoal) -> None:
        """Have the thread make this call for a goal; from any thread."""
        if not is_inherited(self.process):  # otherwise it is the end of a coroutine of the parent
            self._queue.put(partial(call, pending))

    def close(self, *, wait: bool = True) -> None:
        """
        End; pending goals fail with a TimeoutException.

        :param wait: until the thread has ended. Not from a finalizer, see ``Spinner.stop``.
        """
        if not self._ended and not is_inherited(self.process):
            self._ended = True
            self._spinner.stop(wait=wait)

    def _tf2_check(self) -> None:
        """End with the node of the client."""
        node = self._owner_node()
        if node is None or node_has_ended(node):
            self.close(wait=False)

    def _end(self) -> None:
        self._ended = True
        for pending in list(self._pending):
            self._end_goal(pending, self._end_error(pending))
        self._queue.close("the client has ended")
        self.action_client.destroy()
        self._node.destroy_node()
        del self._timer  # it refers to this, so only the collector would free both

    # All that follows happens in the thread.

    def _begin(self, pending: PendingGoal) -> None:
        self.advance(pending)
        if self._pending and self._timer.is_canceled():
            self._timer.reset()

    def _advance_all(self) -> None:
        for pending in list(self._pending):
            self.advance(pending)
        if not self._pending:
            self._timer.cancel()

    def advance(self, pending: PendingGoal, _: object = None) -> None:
        """Take the next step of a goal; after each period, response and deadline."""
        if self._ended or pending.over():
            return
        try:
            problem = self._step(pending, self.action_client.server_is_ready())
        except RuntimeError:
            # Without a context nothing can be sent; after its shutdown no outcome is expected.
            if self._node.context.ok():
                raise
        else:
            if problem:
                self._end_goal(pending, pending.error(problem))

    def _step(self, pending: PendingGoal, server_is_ready: bool) -> str:
        """Return why the goal fails now, if it does."""
        request: Any = pending.request
        if request is None:
            if server_is_ready:
                self._await_response(pending, pending.send_to(self.action_client))
            elif _is_past(pending.deadline_ns):
                return f"The buffer server is not ready: no server of [{self._name}] was found."
        elif not request.done():
            server = f"The buffer server [{self._name}]"
            if not server_is_ready:
                return f"{server} went away before it answered."
            if _is_past(pending.last_ns):
                return f"{server} did not answer in time. Something is likely wrong there."
        elif pending.handle is not None:
            self._pending.discard(pending)
            pending.set_result(request.result())
        elif request.result().accepted:
            pending.handle = request.result()
            self._await_response(pending, pending.handle.get_result_async())
        else:
            return "The buffer server refused the goal. Something is likely wrong with it."
        return ""

    def _await_response(self, pending: PendingGoal, request: Future) -> None:
        pending.request = request
        request.add_done_callback(partial(self.advance, pending))

    def abandon(self, pending: PendingGoal) -> None:
        """Cancel a goal, unless it is over."""
        if not self._ended and not pending.over():
            self._end_goal(pending, None)

    def _end_goal(self, pending: PendingGoal, error: TimeoutException | None) -> None:
        """End a goal with this error, or cancel it; the server need not answer it any more."""
        self._pending.discard(pending)
        if error is None:
            pending.cancel()
        else:
            pending.set_exception(error)
        with suppress(RuntimeError):  # the context was shut down
            pending.cancel_in_server()

    def _end_error(self, pending: PendingGoal) -> TimeoutException:
        if context_was_shut_down(self._node.context):
            return TimeoutException(errors.shut_down(time.monotonic_ns() - pending.begin_ns))
        return pending.error("The buffer client was destroyed.")


def _is_past(steady_ns: int | None) -> bool:
    return steady_ns is not None and time.monotonic_ns() >= steady_ns


def _cancel_if_accepted(response: Future) -> None:
    handle: Any = response.result()
    if handle.accepted:
        handle.cancel_goal_async()


class BufferClient(BufferInterface):
    """
    Looks transforms up in the buffer of a buffer server.

    :param node: the node whose context and namespace are used. It need not be spun: a hidden node with a
        separate thread sends the goals, so blocking lookups also work in callbacks of any executor.
    :param ns: the name of the server's action.
    :param check_frequency: how often to check whether a server is available, in Hz.
    :param timeout_padding: how much longer than the timeout of a lookup to wait for the server's response.
    :raises ValueError: ``check_frequency`` is not above 0.

    A ``timeout`` is for finding a server, and then for the lookup in it. Without one, a coroutine waits until
    the server is destroyed, or the context is shut down. A lookup raises what the lookup in the server
    raises; and a ``TimeoutException`` if no server was found, it did not answer, the transform was not
    available in time, or the context was shut down. The text says which, and how long the wait took.

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
        require_node("BufferClient", node, "create_client")
        if not check_frequency > 0.0:
            raise ValueError(f"check_frequency: expected a number above 0 Hz, got {check_frequency}")
        super().__init__()
        self.node = node
        self.check_frequency = check_frequency
        self.timeout_padding = timeout_padding
        self._tf2_goal_sender = GoalSender(node, ns, 1.0 / check_frequency)
        self.action_client = self._tf2_goal_sender.action_client
        # Without destroy(), too, no thread remains; at exit it ends by itself.
        weakref.finalize(self, self._tf2_goal_sender.close, wait=False).atexit = False

    def __repr__(self) -> str:
        return f"<{class_name(type(self))}: {self._tf2_goal_sender.state()}>"

    def destroy(self) -> None:
        """End the client; pending lookups raise a TimeoutException. May be called again."""
        self._tf2_goal_sender.close()

    def lookup_transform(
        self, target_frame: str, source_frame: str, time: TimeLike, timeout: DurationLike = NO_TIMEOUT
    ) -> TransformStamped:
        goal = _simple_goal(target_frame, source_frame, time)
        goal.timeout = _duration_msg(timeout)
        return self.__process_goal(goal)

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        timeout: DurationLike = NO_TIMEOUT,
    ) -> TransformStamped:
        goal = _full_goal(target_frame, target_time, source_frame, source_time, fixed_frame)
        goal.timeout = _duration_msg(timeout)
        return self.__process_goal(goal)

    async def lookup_transform_async(
        self, target_frame: str, source_frame: str, time: TimeLike, *, timeout: DurationLike | None = None
    ) -> TransformStamped:
        return await self._tf2_await(_simple_goal(target_frame, source_frame, time), timeout)

    async def lookup_transform_full_async(
        self,
        target_frame: str,
        target_time: TimeLike,
        source_frame: str,
        source_time: TimeLike,
        fixed_frame: str,
        *,
        timeout: DurationLike | None = None,
    ) -> TransformStamped:
        """
        Await what :meth:`lookup_transform_full` returns. Without ``timeout`` it waits forever.

        :param target_frame: the frame into which the data is to be transformed.
        :param target_time: the time in ``target_frame``; 0 is the latest time.
        :param source_frame: the frame that the data is in.
        :param source_time: the time of the data; 0 is the latest time.
        :param fixed_frame: a frame that does not move between the two times.
        :param timeout: how long to wait for a server and its answer, in steady time. None: forever.
        """
        goal = _full_goal(target_frame, target_time, source_frame, source_time, fixed_frame)
        return await self._tf2_await(goal, timeout)

    def __process_goal(self, goal: Any) -> TransformStamped:
        pending = self._tf2_send(goal, duration_ns(Duration.from_msg(goal.timeout), "timeout"))
        # Not an Event: a signal handler that raises inside one leaves it locked.
        done = threading.Lock()
        done.acquire()
        pending.add_done_callback(lambda _: done.release())
        try:
            # The sender's thread gives every goal an outcome, also at its own end.
            done.acquire()
            return self.__process_result(_result_of(pending, pending.result()))
        finally:
            pending.abandon()

    def __process_result(self, result: Any) -> TransformStamped:
        if result.error.error != TF2Error.NO_ERROR:
            raise EXCEPTIONS.get(result.error.error, TransformException)(printable(result.error.error_string))
        return result.transform

    async def _tf2_await(self, goal: Any, timeout: DurationLike | None) -> TransformStamped:
        pending = self._tf2_send(goal, optional_timeout_ns(timeout))
        try:
            return self.__process_result(_result_of(pending, await pending))
        finally:
            pending.abandon()

    def _tf2_send(self, goal: Any, lookup_ns: int | None) -> PendingGoal:
        refuse_inherited(self, self._tf2_goal_sender.process)
        padding_ns = duration_ns(self.timeout_padding, "timeout_padding")
        return self._tf2_goal_sender.send(goal, lookup_ns, padding_ns)


# The names are checked here, because a message accepts any object until the sender's thread serialises it.


def _simple_goal(target_frame: str, source_frame: str, time: Any) -> Any:
    return LookupTransform.Goal(
        target_frame=frame_name(target_frame, "target_frame"),
        source_frame=frame_name(source_frame, "source_frame"),
        source_time=time_msg(time, "time"),
    )


def _full_goal(
    target_frame: str, target_time: Any, source_frame: str, source_time: Any, fixed_frame: str
) -> Any:
    return LookupTransform.Goal(
        target_frame=frame_name(target_frame, "target_frame"),
        target_time=time_msg(target_time, "target_time"),
        source_frame=frame_name(source_frame, "source_frame"),
        source_time=time_msg(source_time, "source_time"),
        fixed_frame=frame_name(fixed_frame, "fixed_frame"),
        advanced=True,
    )


def _result_of(pending: PendingGoal, response: Any) -> Any:
    goal, result = pending.goal, response.result
    # A server whose wait timed out or was cancelled may send an empty result without an error.
    if result.error.error == TF2Error.NO_ERROR and (
        response.status != GoalStatus.STATUS_SUCCEEDED or not result.transform.header.frame_id
    ):
        text = (
            f"The buffer server did not get the transform from [{printable(goal.source_frame)}] to "
            f"[{printable(goal.target_frame)}] in time."
        )
        raise pending.error(text)
    return result


def _duration_msg(timeout: Any) -> Any:
    """The duration message of a timeout; at most FOR_EVER, with either sign."""
    longest_ns: int = FOR_EVER.nanoseconds
    return Duration(nanoseconds=max(-longest_ns, min(duration_ns(timeout, "timeout"), longest_ns))).to_msg()


def _resolved(node: Node, ns: str) -> str:
    # As a client of the node itself would have it, remapping included.
    service: str = node.resolve_service_name(ns + GOAL_SERVICE)
    if service.endswith(GOAL_SERVICE):
        return service.removesuffix(GOAL_SERVICE)
    name: str = expand_topic_name(ns, node.get_name(), node.get_namespace())
    return name
