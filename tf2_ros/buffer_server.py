# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Answer the lookups of other processes through an action."""

import tf2_ros_cython._ros_requirement  # noqa: F401

import os
import weakref
from typing import Any

from rclpy.action import ActionServer, CancelResponse
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
from tf2_py._internal import duration_ns
from tf2_ros._nodes.ended_nodes import node_has_ended, require_node, suppress_at_end
from tf2_ros._nodes.hidden_nodes import companion_node
from tf2_ros._nodes.spinner import Spinner
from tf2_ros._process.background import check_regularly
from tf2_ros._process.forking import is_inherited
from tf2_ros._qos import lookup_qos
from tf2_ros._rclpy import runs_in_loop
from tf2_ros._wait.call_queue import CallQueue
from tf2_ros._wait.call_runners import ExecutorRunner
from tf2_ros._wait.futures import TransformFuture
from tf2_ros._wait.lookup_or_wait import Lookup

__all__ = ["BufferServer"]

# How long a result is kept for a client that has not requested it yet. Every change of a goal publishes the
# state of all goals that are kept.
KEEP_RESULT_S = 10

# Of an action, behind its name.
GOAL_SERVICE = "/_action/send_goal"
STATUS_TOPIC = "/_action/status"  # which each server publishes

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

    :param buffer: the buffer; a listener, or the program, fills it.
    :param node: offers the action; its executor answers. For an ``AsyncNode``, a hidden node with a separate
        thread does both.
    :param ns: the name of the action.
    :param check_period: has no effect, and exists because tf2 has it: a waiting goal is answered when its
        transform is inserted.
    :raises TypeError: ``buffer`` is not a buffer, or ``node`` is not a node.

    A waiting goal does not occupy a thread. A goal whose timeout passes gets ``TIMEOUT_ERROR`` with the
    reason of the last attempt; a goal without a timeout gets the error of its only attempt. The node keeps
    the server alive; ``destroy()`` ends it, and so does destroying the node.

    >>> from rclpy.duration import Duration
    >>> from rclpy.time import Time
    >>> from tf2_ros import Buffer, BufferClient, BufferServer
    >>> from geometry_msgs.msg import TransformStamped
    >>> mount = TransformStamped(child_frame_id="camera")
    >>> mount.header.frame_id = "base_link"
    >>> mount.transform.translation.x = 0.3
    >>> buffer = Buffer()
    >>> buffer.set_transform_static(mount, "example")
    >>> server = BufferServer(buffer, node, "lookup")  # of a node that is spun
    >>> client = BufferClient(node, "lookup")  # usually in another process
    >>> answer = client.lookup_transform("base_link", "camera", Time(), timeout=Duration(seconds=5))
    >>> answer.transform.translation.x
    0.3
    >>> client.destroy()
    >>> server.destroy()
    """

    def __init__(self, buffer: BufferCore, node: Node, ns: str, check_period: float = 0.01) -> None:
        require_node("BufferServer", node, "create_service", buffer, "the buffer first, then the node")
        if not issubclass(type(buffer), BufferCore):  # isinstance believes a Mock(spec=Buffer)
            raise TypeError(f"buffer: expected a tf2_ros.Buffer, got {type(buffer).__name__}")
        self._buffer = buffer
        self._lookups: dict[bytes, Future] = {}
        self._spinner: Spinner | None = None
        if runs_in_loop(node):
            node, ns = self._hide(node, ns)
        runner = ExecutorRunner(node)
        self._call_queue = CallQueue(node, runner)
        self._server: ActionServer | None = ActionServer(
            node,
            LookupTransform,
            ns,
            self._finish,
            # So that no other thread ends a goal while its cancellation is decided.
            callback_group=runner.callback_group,
            handle_accepted_callback=self._begin,
            cancel_callback=self._cancel,
            result_timeout=KEEP_RESULT_S,
            **lookup_qos(),
        )
        self._process = os.getpid()
        self._node = weakref.ref(node)
        check_regularly(self)

    def _hide(self, node: Any, ns: str) -> tuple[Node, str]:
        """Create a hidden, spun node that offers the action for a node that no executor spins."""
        # As a server of the node itself would have it, remapping included.
        name = node.resolve_service_name(ns + GOAL_SERVICE).removesuffix(GOAL_SERVICE)
        hidden = companion_node("_buffer_server_impl", self, node)
        self._spinner = Spinner(hidden, daemon=True, at_end=hidden.destroy_node, until=node)
        self._spinner.thread.name = "tf2_ros buffer server"
        return hidden, name

    def destroy(self) -> None:
        """End the server; pending goals get no result. Again, or in a forked child, it has no effect."""
        # The action server refers to this, so as long as this refers to it, only the collector frees both.
        server, self._server = self._server, None
        if server is None or is_inherited(self._process):
            return
        self._call_queue.close("the server has ended")
        for lookup in list(self._lookups.values()):
            lookup.cancel()
        self._lookups.clear()
        # First, because an executor of rclpy fails if another thread destroys an action server that it spins.
        if self._spinner is not None:
            self._spinner.stop()
        server.destroy()

    def _tf2_check(self) -> None:
        """End with the node."""
        node = self._node()
        if node is not None and node_has_ended(node):
            self.destroy()

    def _begin(self, handle: Any) -> None:
        lookup = self._lookups[bytes(handle.goal_id.uuid)] = self._look_up(handle.request)
        # The executor answers, not the thread that inserts the transform.
        lookup.add_done_callback(lambda _: self._call_queue.put(handle.execute))

    def _look_up(self, goal: Any) -> Future:
        fixed = (goal.fixed_frame, goal.target_time) if goal.advanced else ()
        lookup = Lookup(goal.target_frame, goal.source_frame, goal.source_time, *fixed)
        wait_ns = duration_ns(goal.timeout, "timeout")
        future = Future()
        try:
            answer = lookup.now(self._buffer, or_none=wait_ns > 0)
            if answer is None:
                return TransformFuture(self._buffer, lookup.wait, Duration(nanoseconds=wait_ns))
            future.set_result(answer)
        except OverflowError as error:
            # Its seconds and nanoseconds add up to more than a stamp can be.
            future.set_exception(InvalidArgumentException(str(error)))
        except TransformException as error:
            future.set_exception(error)
        return future

    def _cancel(self, handle: Any) -> CancelResponse:
        lookup = self._lookups.get(bytes(handle.goal_id.uuid))
        if lookup is None:
            return CancelResponse.REJECT
        lookup.cancel()  # without effect if the answer was first
        return CancelResponse.ACCEPT if lookup.cancelled() else CancelResponse.REJECT

    def _finish(self, handle: Any) -> LookupTransform.Result:
        lookup = self._lookups.pop(bytes(handle.goal_id.uuid), None)
        result = LookupTransform.Result()
        if lookup is None:
            return result  # the server was destroyed meanwhile
        if lookup.cancelled():
            with suppress_at_end(self._node()):
                handle.canceled()
            # A client that reads only the error must not mistake the empty transform for an answer.
            result.error.error = TF2Error.TRANSFORM_ERROR
            result.error.error_string = "The goal was canceled"
            return result
        error = lookup.exception()
        if error is None:
            result.transform = lookup.result()
        else:
            result.error.error = next(code for kind, code in CODES if isinstance(error, kind))
            result.error.error_string = str(error)
        # An error is a result, too: clients in C++ do not read the result of a goal that was aborted.
        with suppress_at_end(self._node()):
            handle.succeed()
        return result
