"""Owns the goals of a buffer client: the thread that sends them, and the outcome of each."""

import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from action_msgs.msg import GoalStatus
from rclpy.action.client import ActionClient
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.task import Future

from tf2_msgs.action import LookupTransform
from tf2_py import TimeoutException
from tf2_py._internal import counted, printable, wait_texts
from tf2_ros._forking import keep_for_ever, register_for_fork
from tf2_ros._hidden_node import hidden_node
from tf2_ros._qos import lookup_qos
from tf2_ros._rclpy import action_result, context_was_shut_down
from tf2_ros._spinner import Spinner
from tf2_ros._times import FOR_EVER
from tf2_ros._wait.deadlines import deadlines
from tf2_ros._wait.handoff import Handoff
from tf2_ros._wait.waking_future import WakingFuture

__all__ = ["GoalSender", "PendingGoal", "send_directly"]

FIRST_RETRY_DELAY_NS = 500_000_000  # before a request is sent again; twice as long each time
DONE_CHECK_S = 0.1  # how often to check a future that may not call back

DESTROYED = "The buffer client was destroyed."
GOAL_SERVICE = "/_action/send_goal"


class PendingGoal:
    """
    One goal, until its outcome is known.

    ``outcome`` is the future of the server's response, or of a TimeoutException that says what failed.
    """

    def __init__(self, sender: "GoalSender", goal: Any, timeout_ns: int | None, padding_ns: int) -> None:
        self.goal = goal
        self._begin_ns = time.monotonic_ns()
        self.deadline_ns = None if timeout_ns is None else self._begin_ns + timeout_ns
        self.padding_ns = padding_ns
        self.outcome: WakingFuture[Any] = WakingFuture()
        self.handle: Any = None  # of the goal that was accepted
        self.request: Callable[[], None] | None = None  # sends the last request, which has no response yet
        self.retry_ns = 0  # the steady time at which it is sent again
        self.retry_delay_ns = 0
        self._sender = sender

    def waited_ns(self) -> int:
        """How long the outcome has been waited for."""
        return time.monotonic_ns() - self._begin_ns

    def over(self) -> bool:
        """Whether the outcome is known."""
        return bool(self.outcome.done() or self.outcome.cancelled())

    def expire(self) -> None:
        """A deadline has passed; there may be a later one by now."""
        self._sender.expire(self)

    def abandon(self) -> None:
        """Nobody waits for the outcome any more; without effect if it is known."""
        self._sender.abandon(self)


class GoalSender:
    """
    Sends goals to the action of a buffer server.

    :param node: the client's. Goals do not depend on its executor: a hidden node of its context, spun by
        a thread of its own, sends them.
    :param ns: the name of the action, as this node resolves it.
    :param period_s: how often to check whether the server is available.
    """

    client_class = ActionClient

    def __init__(self, node: Node, ns: str, period_s: float) -> None:
        self._name = _resolved(node, ns)
        self._pending: set[PendingGoal] = set()
        self._closed = self._ended = False
        self._node = hidden = hidden_node(
            "_buffer_client_impl",
            self,
            context=node.context,
            namespace=node.get_namespace(),
            use_global_arguments=False,
        )
        self.action_client = self.client_class(
            hidden,
            LookupTransform,
            self._name,
            goal_service_qos_profile=lookup_qos(),
            result_service_qos_profile=lookup_qos(),
            cancel_service_qos_profile=lookup_qos(),
        )
        # All that follows happens in the thread of the hidden node: rclpy's action client loses a response
        # that arrives before the thread that sent the request has returned.
        self._steps = Handoff(hidden, self._run_step)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = hidden.create_timer(period_s, partial(self._run_step, self._advance_all), clock=steady)
        self._timer.cancel()
        self._spinner = Spinner(hidden, daemon=True, at_end=self._end)
        self._spinner.thread.name = "tf2_ros buffer client"
        register_for_fork(self)

    def send(self, goal: Any, timeout_ns: int | None, padding_ns: int) -> PendingGoal:
        """
        Send a goal, as soon as a server is available.

        :param timeout_ns: nanoseconds of steady time, for finding a server and for the lookup. None: no end.
        :param padding_ns: how much longer to wait for the response of a server that was found.
        """
        pending = PendingGoal(self, goal, timeout_ns, padding_ns)
        self._pending.add(pending)
        self._steps.put(partial(self._begin, pending))
        if pending.deadline_ns is not None:
            deadlines.add(pending.deadline_ns, pending)
        if not self.alive():
            self._fail_at_end(pending)
        return pending

    def alive(self) -> bool:
        """Whether pending goals still get an outcome."""
        return not self._closed and not self._ended

    def state(self) -> str:
        """In words: the action, and how many goals have no outcome yet."""
        goals = counted(len(self._pending), "pending lookup") if self.alive() else "ended"
        return f"action {printable(self._name)}, {goals}"

    def expire(self, pending: PendingGoal) -> None:
        """Fail this goal if its deadline has passed; from any thread."""
        self._steps.put(partial(self._expire, pending))

    def abandon(self, pending: PendingGoal) -> None:
        """Cancel this goal, unless its outcome is known; from any thread."""
        if not pending.over():
            self._steps.put(partial(self._abandon, pending))

    def close(self, *, wait: bool = True) -> None:
        """
        End; pending goals fail with a TimeoutException.

        :param wait: until the thread has ended. Not from a finalizer, see ``Spinner.stop``.
        """
        if self._closed:
            return
        self._closed = True
        self._spinner.stop(wait=wait)
        for pending in list(self._pending):
            self._fail_at_end(pending)

    def after_fork(self) -> None:
        """End in a forked child; goals that are sent there fail."""
        self._closed = True
        self._pending.clear()
        keep_for_ever(self.action_client)

    def _end(self) -> None:
        self._ended = True
        for pending in list(self._pending):
            self._fail_at_end(pending)
        self._steps.close()
        self.action_client.destroy()
        self._node.destroy_node()

    def _run_step(self, step: Callable[[], None]) -> None:
        try:
            step()
        except RuntimeError:
            # Without a context nothing can be sent; after its shutdown no outcome is expected.
            if self._node.context.ok():
                raise

    def _begin(self, pending: PendingGoal) -> None:
        self._advance(pending)
        if self._pending and self._timer.is_canceled():
            self._timer.reset()

    def _advance_all(self) -> None:
        for pending in list(self._pending):
            self._advance(pending)
        if not self._pending:
            self._timer.cancel()

    def _advance(self, pending: PendingGoal) -> None:
        available = self.action_client.server_is_ready()
        if pending.request is None:
            if available:
                self._send_request(pending, partial(self._request_goal, pending))
        elif not available:
            self._fail(pending, f"The buffer server [{self._name}] went away before it answered.")
        elif time.monotonic_ns() >= pending.retry_ns:
            # A server may receive a request before it has discovered this client: its response is then lost.
            pending.request()
            pending.retry_delay_ns *= 2
            pending.retry_ns += pending.retry_delay_ns

    def _send_request(self, pending: PendingGoal, request: Callable[[], None]) -> None:
        pending.request = request
        pending.retry_delay_ns = FIRST_RETRY_DELAY_NS
        pending.retry_ns = time.monotonic_ns() + FIRST_RETRY_DELAY_NS
        request()

    def _request_goal(self, pending: PendingGoal) -> None:
        timeout = FOR_EVER
        if pending.deadline_ns is not None:
            left_ns = pending.deadline_ns - time.monotonic_ns()
            timeout = Duration(nanoseconds=min(max(left_ns, 0), FOR_EVER.nanoseconds))
        pending.goal.timeout = timeout.to_msg()
        response = self.action_client.send_goal_async(pending.goal)
        response.add_done_callback(partial(self._goal_responded, pending))

    def _goal_responded(self, pending: PendingGoal, response: Future) -> None:
        handle: Any = response.result()
        if pending.over() or pending.handle is not None:
            if handle.accepted:
                handle.cancel_goal_async()
        elif not handle.accepted:
            self._fail(pending, "The buffer server refused the goal. Something is likely wrong with it.")
        else:
            pending.handle = handle
            self._send_request(pending, partial(self._request_result, pending))

    def _request_result(self, pending: PendingGoal) -> None:
        handle = pending.handle
        handle.get_result_async().add_done_callback(partial(self._result_responded, pending, handle))

    def _result_responded(self, pending: PendingGoal, handle: Any, response: Future) -> None:
        if pending.over():
            return
        result: Any = response.result()
        if result.status == GoalStatus.STATUS_UNKNOWN:
            if handle is pending.handle:
                self._send_anew(pending)
        else:
            self._pending.discard(pending)
            pending.outcome.set_result(response.result())

    def _send_anew(self, pending: PendingGoal) -> None:
        # The server knows the goal no more: it was restarted, or a slow network delayed the request of the
        # result for longer than it keeps one. Later, because it may forget each goal at once.
        pending.handle = None
        pending.request = partial(self._request_goal, pending)
        pending.retry_ns = time.monotonic_ns() + pending.retry_delay_ns

    def _expire(self, pending: PendingGoal) -> None:
        if pending.over() or pending.deadline_ns is None:
            return
        if pending.request is None:
            self._fail(pending, f"The buffer server is not ready: no server of [{self._name}] was found.")
        elif time.monotonic_ns() < pending.deadline_ns + pending.padding_ns:
            deadlines.add(pending.deadline_ns + pending.padding_ns, pending)
        else:
            self._fail(
                pending,
                f"The buffer server [{self._name}] did not answer in time. Something is likely wrong there.",
            )
            self._cancel(pending)

    def _abandon(self, pending: PendingGoal) -> None:
        if not pending.over():
            self._pending.discard(pending)
            pending.outcome.cancel()
            self._cancel(pending)

    def _cancel(self, pending: PendingGoal) -> None:
        # A goal that is accepted later is cancelled then.
        if pending.handle is not None:
            pending.handle.cancel_goal_async()

    def _fail(self, pending: PendingGoal, text: str) -> None:
        self._end_with_text(pending, wait_texts.waited(text, pending.waited_ns()))

    def _fail_at_end(self, pending: PendingGoal) -> None:
        if context_was_shut_down(self._node.context):
            self._end_with_text(pending, wait_texts.shut_down(pending.waited_ns()))
        else:
            self._fail(pending, DESTROYED)

    def _end_with_text(self, pending: PendingGoal, text: str) -> None:
        self._pending.discard(pending)
        if not pending.over():
            pending.outcome.set_exception(TimeoutException(text))


def send_directly(client: Any, goal: Any, padding_ns: int) -> Any:
    """
    Send a goal with any action client, as tf2 does. Another thread must spin the client's node.

    :param goal: with its timeout.
    :param padding_ns: how much longer than that to wait until the goal is accepted.
    :return: the result.
    """
    if not client.server_is_ready():
        raise TimeoutException("The buffer server is not ready.")
    begin_ns = time.monotonic_ns()
    deadline_ns = begin_ns + Duration.from_msg(goal.timeout).nanoseconds + padding_ns
    sent = client.send_goal_async(goal)
    done = threading.Event()
    sent.add_done_callback(lambda _: done.set())
    # The client may be a stand-in, whose future calls nothing back.
    while not sent.done():
        left_ns = deadline_ns - time.monotonic_ns()
        if left_ns <= 0:
            text = "The buffer server did not answer in time."
            raise TimeoutException(wait_texts.waited(text, deadline_ns - begin_ns))
        done.wait(min(left_ns / 1e9, DONE_CHECK_S))
    handle = sent.result()
    if not handle.accepted:
        raise TimeoutException("The buffer server refused the goal.")
    return action_result(client, handle)


def _resolved(node: Node, ns: str) -> str:
    # As a client of the node itself would have it, remapping included.
    service: str = node.resolve_service_name(ns + GOAL_SERVICE)
    if service.endswith(GOAL_SERVICE):
        return service.removesuffix(GOAL_SERVICE)
    name: str = expand_topic_name(ns, node.get_name(), node.get_namespace())
    return name
