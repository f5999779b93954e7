"""Owns the goals of a buffer client: the thread that sends them, and what becomes of each."""

import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.action.client import ActionClient
from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.task import Future

from tf2_msgs.action import LookupTransform
from tf2_py import TimeoutException
from tf2_ros._forking import keep_for_ever, tell_of_fork
from tf2_ros._qos import lookup_qos
from tf2_ros._spinner import Spinner
from tf2_ros._wait.deadlines import deadlines
from tf2_ros._wait.handoff import Handoff
from tf2_ros._wait.waiting import WakingFuture

__all__ = ["FOR_EVER", "Asking", "Question", "ask_directly"]

FIRST_PATIENCE_NS = 500_000_000  # before something is asked again; twice as long each time
DONE_CHECK_S = 0.1  # how often to look at a future that may not call back
FOR_EVER = Duration(seconds=2**31 - 1)  # the most that a goal can say

DESTROYED = "The buffer client was destroyed."
GOAL_SERVICE = "/_action/send_goal"


class Question:
    """
    One goal on its way.

    ``outcome`` is the future of the server's response, or of a TimeoutException that tells what went wrong.
    """

    def __init__(self, asking: "Asking", goal: Any, timeout_ns: int | None, padding_ns: int) -> None:
        self.goal = goal
        self.deadline_ns = None if timeout_ns is None else time.monotonic_ns() + timeout_ns
        self.padding_ns = padding_ns
        self.outcome = WakingFuture()
        self.handle: Any = None  # of the goal that was accepted
        self.ask: Callable[[], None] | None = None  # what was asked last and not answered yet
        self.ask_again_ns = 0
        self.patience_ns = 0
        self._asking = asking

    def over(self) -> bool:
        """Whether the outcome is there."""
        return bool(self.outcome.done() or self.outcome.cancelled())

    def expire(self) -> None:
        """A deadline has come; it may have been moved since."""
        self._asking.expire(self)

    def abandon(self) -> None:
        """Nobody waits for the outcome any more; without effect if it is there."""
        self._asking.abandon(self)


class Asking:
    """
    Sends goals to the action of a buffer server.

    :param node: who asks. Goals do not depend on whoever spins it: a hidden node of its context, spun by a
        thread of its own, sends them.
    :param ns: the name of the action, as this node has it.
    :param period_s: how often to look whether the server is there.
    """

    client_class = ActionClient

    def __init__(self, node: Node, ns: str, period_s: float) -> None:
        self._name = _resolved(node, ns)
        self._open: set[Question] = set()
        self._closed = False
        self._node = hidden = _hidden_node(self, node)
        self.action_client = self.client_class(
            hidden,
            LookupTransform,
            self._name,
            goal_service_qos_profile=lookup_qos(),
            result_service_qos_profile=lookup_qos(),
            cancel_service_qos_profile=lookup_qos(),
        )
        # All that follows happens in the thread of the hidden node: rclpy's action client loses an answer
        # that comes before the thread that asked has returned.
        self._steps = Handoff(hidden, self._step)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = hidden.create_timer(period_s, partial(self._step, self._look), clock=steady)
        self._timer.cancel()
        self._spinner = Spinner(hidden, daemon=True, at_end=self._destroy)
        self._spinner.thread.name = "tf2_ros buffer client"
        tell_of_fork(self)

    def ask(self, goal: Any, timeout_ns: int | None, padding_ns: int) -> Question:
        """
        Send a goal, as soon as there is a server.

        :param timeout_ns: nanoseconds of steady time, for finding a server and for the lookup. None: no end.
        :param padding_ns: how much longer to wait for the answer of a server that was found.
        """
        question = Question(self, goal, timeout_ns, padding_ns)
        self._open.add(question)
        self._steps.put(partial(self._begin, question))
        if question.deadline_ns is not None:
            deadlines.add(question.deadline_ns, question)
        if self._closed:
            self._fail(question, DESTROYED)
        return question

    def alive(self) -> bool:
        """Whether questions are still being answered."""
        return not self._closed and self._spinner.thread.is_alive()

    def expire(self, question: Question) -> None:
        """The question may have waited long enough."""
        self._steps.put(partial(self._expire, question))

    def abandon(self, question: Question) -> None:
        """Take the question back."""
        if not question.over():
            self._steps.put(partial(self._abandon, question))

    def close(self, *, wait: bool = True) -> None:
        """
        End; what is being asked ends with a TimeoutException.

        :param wait: until the thread has ended. Not from a finalizer, see `Spinner.stop`.
        """
        if self._closed:
            return
        self._closed = True
        self._spinner.stop(wait=wait)
        for question in list(self._open):
            self._fail(question, DESTROYED)

    def after_fork(self) -> None:
        """Be closed in a forked child; whoever asks there is told so."""
        self._closed = True
        self._open.clear()
        keep_for_ever(self.action_client)

    def _destroy(self) -> None:
        self._steps.close()
        self.action_client.destroy()
        self._node.destroy_node()

    def _step(self, step: Callable[[], None]) -> None:
        try:
            step()
        except RuntimeError:
            # Without a context nothing can be asked; whoever shut it down expects no answer.
            if self._node.context.ok():
                raise

    def _begin(self, question: Question) -> None:
        self._advance(question)
        if self._open and self._timer.is_canceled():
            self._timer.reset()

    def _look(self) -> None:
        for question in list(self._open):
            self._advance(question)
        if not self._open:
            self._timer.cancel()

    def _advance(self, question: Question) -> None:
        there = self.action_client.server_is_ready()
        if question.ask is None:
            if there:
                self._ask(question, partial(self._send, question))
        elif not there:
            self._fail(question, f"The buffer server [{self._name}] went away before it answered.")
        elif time.monotonic_ns() >= question.ask_again_ns:
            # A server may hear a question before it has found the way back, and then its answer is lost.
            question.ask()
            question.patience_ns *= 2
            question.ask_again_ns += question.patience_ns

    def _ask(self, question: Question, ask: Callable[[], None]) -> None:
        question.ask = ask
        question.patience_ns = FIRST_PATIENCE_NS
        question.ask_again_ns = time.monotonic_ns() + FIRST_PATIENCE_NS
        ask()

    def _send(self, question: Question) -> None:
        timeout = FOR_EVER
        if question.deadline_ns is not None:
            left_ns = question.deadline_ns - time.monotonic_ns()
            timeout = Duration(nanoseconds=min(max(left_ns, 0), FOR_EVER.nanoseconds))
        question.goal.timeout = timeout.to_msg()
        answer = self.action_client.send_goal_async(question.goal)
        answer.add_done_callback(partial(self._take_goal, question))

    def _take_goal(self, question: Question, answer: Future) -> None:
        handle = answer.result()
        if question.over() or question.handle is not None:
            if handle.accepted:
                handle.cancel_goal_async()
        elif not handle.accepted:
            self._fail(question, "The buffer server refused the goal. Something is likely wrong with it.")
        else:
            question.handle = handle
            self._ask(question, partial(self._ask_result, question))

    def _ask_result(self, question: Question) -> None:
        question.handle.get_result_async().add_done_callback(partial(self._take_result, question))

    def _take_result(self, question: Question, answer: Future) -> None:
        if not question.over():
            self._open.discard(question)
            question.outcome.set_result(answer.result())

    def _expire(self, question: Question) -> None:
        if question.over() or question.deadline_ns is None:
            return
        if question.ask is None:
            self._fail(question, f"The buffer server is not ready: no server of [{self._name}] was found.")
        elif time.monotonic_ns() < question.deadline_ns + question.padding_ns:
            deadlines.add(question.deadline_ns + question.padding_ns, question)
        else:
            self._fail(
                question,
                f"The buffer server [{self._name}] did not answer in time. Something is likely wrong there.",
            )
            self._cancel(question)

    def _abandon(self, question: Question) -> None:
        if not question.over():
            self._open.discard(question)
            question.outcome.cancel()
            self._cancel(question)

    def _cancel(self, question: Question) -> None:
        # A goal that is accepted later is cancelled then.
        if question.handle is not None:
            question.handle.cancel_goal_async()

    def _fail(self, question: Question, text: str) -> None:
        self._open.discard(question)
        if not question.over():
            question.outcome.set_exception(TimeoutException(text))


def ask_directly(client: Any, goal: Any, padding_ns: int) -> Any:
    """
    Send a goal with any action client, as tf2 does: whoever spins the client's node must be another thread.

    :param goal: with its timeout.
    :param padding_ns: how much longer than that to wait until the goal is accepted.
    :return: the result.
    """
    if not client.server_is_ready():
        raise TimeoutException("The buffer server is not ready.")
    deadline_ns = time.monotonic_ns() + Duration.from_msg(goal.timeout).nanoseconds + padding_ns
    sent = client.send_goal_async(goal)
    done = threading.Event()
    sent.add_done_callback(lambda _: done.set())
    # The client may be a stand-in, whose future calls nothing back.
    while not sent.done():
        left_ns = deadline_ns - time.monotonic_ns()
        if left_ns <= 0:
            raise TimeoutException("The buffer server did not answer in time.")
        done.wait(min(left_ns / 1e9, DONE_CHECK_S))
    handle = sent.result()
    if not handle.accepted:
        raise TimeoutException("The buffer server refused the goal.")
    return client._get_result(handle).result


def _hidden_node(asking: Asking, node: Node) -> Node:
    # Nothing of it depends on the time, and it is nobody's to configure.
    return Node(
        f"_buffer_client_impl_{id(asking):010x}",
        context=node.context,
        namespace=node.get_namespace(),
        use_global_arguments=False,
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[Parameter("use_sim_time", value=False)],
    )


def _resolved(node: Node, ns: str) -> str:
    # As a client of the node itself would have it, remapping included.
    service: str = node.resolve_service_name(ns + GOAL_SERVICE)
    if service.endswith(GOAL_SERVICE):
        return service.removesuffix(GOAL_SERVICE)
    name: str = expand_topic_name(ns, node.get_name(), node.get_namespace())
    return name
