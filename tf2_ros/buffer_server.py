"""Owns answering lookups from other processes, through the action of a buffer server."""

from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.task import Future

from tf2_msgs.action import LookupTransform
from tf2_msgs.msg import TF2Error
from tf2_py import (
    BufferCore,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TimeoutException,
    TransformException,
)
from tf2_py._objects.errors import bad_name
from tf2_ros._qos import lookup_qos
from tf2_ros._wait.handoff import Handoff
from tf2_ros._wait.waiting import Lookup, TransformFuture, duration_ns

__all__ = ["BufferServer"]

# How long an answer is kept for a client that has not asked for it yet; every change of a goal publishes the
# state of all that are kept.
KEEP_RESULT_S = 10

CODES = (
    (ConnectivityException, TF2Error.CONNECTIVITY_ERROR),
    (ExtrapolationException, TF2Error.EXTRAPOLATION_ERROR),
    (InvalidArgumentException, TF2Error.INVALID_ARGUMENT_ERROR),
    (LookupException, TF2Error.LOOKUP_ERROR),
    (TimeoutException, TF2Error.TIMEOUT_ERROR),
    (TransformException, TF2Error.TRANSFORM_ERROR),
)


class BufferServer:
    """
    Answers the action ``tf2_msgs/action/LookupTransform`` from a buffer.

    :param buffer: the buffer; a listener, or whoever else, fills it.
    :param node: offers the action; whoever spins it answers.
    :param ns: the name of the action.
    :param check_period: in seconds; accepted for programs that give it, and without effect: a waiting goal is
        answered when its transform comes.

    A goal that waits occupies no thread. One with a timeout that passes gets ``TIMEOUT_ERROR`` with the
    reason of the last attempt; one without a timeout the error of its only attempt. The node keeps the
    server alive; ``destroy()`` ends it.
    """

    def __init__(self, buffer: BufferCore, node: Node, ns: str, check_period: float = 0.01) -> None:
        if not isinstance(buffer, BufferCore):
            raise TypeError(f"buffer must be a tf2_ros.Buffer, not {type(buffer).__name__}")
        self._buffer = buffer
        self._lookups: dict[bytes, Future] = {}
        # One group: a goal ends in no other thread while its cancelling is being decided.
        group = MutuallyExclusiveCallbackGroup()
        self._ended = Handoff(node, _execute, group)
        self._server = ActionServer(
            node,
            LookupTransform,
            ns,
            self._finish,
            callback_group=group,
            handle_accepted_callback=self._begin,
            cancel_callback=self._cancel,
            goal_service_qos_profile=lookup_qos(),
            result_service_qos_profile=lookup_qos(),
            cancel_service_qos_profile=lookup_qos(),
            result_timeout=KEEP_RESULT_S,
        )

    def destroy(self) -> None:
        """End the server; goals that still wait get no answer."""
        self._ended.close()
        for lookup in list(self._lookups.values()):
            lookup.cancel()
        self._lookups.clear()
        self._server.destroy()

    def _begin(self, handle: Any) -> None:
        lookup = self._lookups[bytes(handle.goal_id.uuid)] = self._look_up(handle.request)
        if lookup.done():
            handle.execute()
        else:
            # The thread that brings the transform does not answer: that is the executor's.
            lookup.add_done_callback(lambda _: self._ended.put(handle))

    def _look_up(self, goal: Any) -> Future:
        names = {"target_frame": goal.target_frame, "source_frame": goal.source_frame}
        lookup: Lookup = (goal.target_frame, goal.source_frame, goal.source_time, None, None)
        if goal.advanced:
            names["fixed_frame"] = goal.fixed_frame
            lookup = (*lookup[:3], goal.fixed_frame, goal.target_time)
        for argument, name in names.items():
            # Here, because a lookup between equal names does not check them.
            if not name or name.startswith("/"):
                refused = Future()
                refused.set_exception(bad_name(name, argument))
                return refused
        timeout_ns = duration_ns(goal.timeout)
        future = Future()
        try:
            if timeout_ns > 0:
                return TransformFuture(self._buffer, lookup, Duration(nanoseconds=timeout_ns))
            future.set_result(self._look_up_now(goal))
        except OverflowError as error:
            # Its nanoseconds add up to a time that no stamp carries.
            future.set_exception(InvalidArgumentException(str(error)))
        except TransformException as error:
            future.set_exception(error)
        return future

    def _look_up_now(self, goal: Any) -> Any:
        if not goal.advanced:
            return self._buffer.lookup_transform_core(goal.target_frame, goal.source_frame, goal.source_time)
        return self._buffer.lookup_transform_full_core(
            goal.target_frame, goal.target_time, goal.source_frame, goal.source_time, goal.fixed_frame
        )

    def _cancel(self, handle: Any) -> CancelResponse:
        lookup = self._lookups.get(bytes(handle.goal_id.uuid))
        if lookup is None or lookup.cancelled():
            return CancelResponse.REJECT
        lookup.cancel()
        # Not if its answer came first.
        return CancelResponse.ACCEPT if lookup.cancelled() else CancelResponse.REJECT

    def _finish(self, handle: Any) -> LookupTransform.Result:
        lookup = self._lookups.pop(bytes(handle.goal_id.uuid))
        result = LookupTransform.Result()
        if lookup.cancelled():
            handle.canceled()
            # Nobody who looks at the error alone shall take the empty transform for an answer.
            result.error.error = TF2Error.TRANSFORM_ERROR
            result.error.error_string = "The goal was cancelled"
            return result
        error = lookup.exception()
        if error is None:
            result.transform = lookup.result()
        else:
            result.error.error = next(code for kind, code in CODES if isinstance(error, kind))
            result.error.error_string = str(error)
        # An error, too, is an answer: clients in C++ do not look at the result of a goal that was aborted.
        handle.succeed()
        return result


def _execute(handle: Any) -> None:
    handle.execute()
