"""Make hidden nodes, spin nodes in threads, and keep forked children from destroying nodes."""

import atexit
import os
import threading
import weakref
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions, get_current_signal_handlers_options, uninstall_signal_handlers

from tf2_py._internal import MalformedObjectError, keep_for_ever
from tf2_ros._arguments import kind_of
from tf2_ros._forking import LiveObjects, is_inherited
from tf2_ros._rclpy import (
    context_was_shut_down,
    handle_exists,
    is_node,
    is_shut_down,
    mark_shut_down,
    wake,
)
from tf2_ros._threads import check_regularly

CALLBACK_END_WAIT_S = 1.0  # for a callback that runs when the thread is to end


def require_node(call: str, node: Any, method: str, other: object = None, order: str = "") -> None:
    """
    Refuse what cannot serve as a node, before anything is made.

    :param other: the argument with which a program may have swapped the node; ``order`` is the right one.
    :raises TypeError: it lacks the method; also an AttributeError, as in tf2.
    :raises InvalidHandle: it was destroyed.
    """
    if not hasattr(node, method):
        advice = f"; pass {order}" if hasattr(other, method) else ""
        raise MalformedObjectError(f"{call}: expected a node with {method}, got {kind_of(node)}{advice}")
    if is_node(node) and not handle_exists(node.handle):
        raise InvalidHandle(f"{call}: the node was destroyed")


def hidden_node(prefix: str, owner: object, **options: Any) -> Node:
    """
    Make a node whose name begins with ``prefix`` and is unique in this process while ``owner`` lives.

    Nothing in it depends on ROS time, and programs do not configure it. So it has no services,
    does not log to /rosout, and does not use simulated time. The command line's rules for namespaces and
    topics apply to it, but not those for names, with which launch files rename the program's own node.
    """
    name = f"{prefix}_{id(owner):010x}"
    node = Node(
        name,
        **options,
        cli_args=["--ros-args", "-r", f"__node:={name}"],  # a node's own rules precede those of the process
        enable_rosout=False,
        start_parameter_services=False,
        parameter_overrides=[
            Parameter("use_sim_time", value=False),
            # rclpy never frees this service: 107 kB for each node.
            Parameter("start_type_description_service", value=False),
        ],
    )
    keep_in_children(node)  # also if nothing uses it because what its owner does next fails
    return node


def companion_node(prefix: str, owner: object, node: Any) -> Node:
    """Make a hidden node in the context and the namespace of another one."""
    return hidden_node(
        prefix, owner, context=node.context, namespace=node.get_namespace(), use_global_arguments=False
    )


_of_middleware: LiveObjects[object] = LiveObjects()


def keep_in_children(node_or_executor: object) -> None:
    """
    Never destroy a node or an executor, and what it refers to, in a forked child.

    A child lacks the threads of the middleware, so destroying any part of a node may hang.
    """
    _of_middleware.add(node_or_executor)


def _after_fork_in_child() -> None:
    global _lacks_signal_thread
    keep_for_ever(*_of_middleware)
    _of_middleware.clear()
    _running.clear()
    if get_current_signal_handlers_options() != SignalHandlerOptions.NO:
        _lacks_signal_thread = True


os.register_at_fork(after_in_child=_after_fork_in_child)


_running: "LiveObjects[Spinner]" = LiveObjects()
_lacks_signal_thread = False  # rclpy's, because this process was forked from one that had it


class Spinner:
    """
    Spins a node in a separate thread.

    :param daemon: let the interpreter exit while the thread runs. Otherwise the program continues until the
        node's context is shut down.
    :param at_end: called by the thread when it ends, to destroy what only it uses.
    :param until: the node whose end ends the thread; None: the node that it spins.

    The thread ends with :meth:`stop`, with the shutdown of ``executor``, with the node's context, and when
    the node is destroyed, unless a program has added other nodes to ``executor``. It idles when another
    executor takes the node.
    """

    def __init__(
        self,
        node: Node,
        *,
        daemon: bool,
        at_end: Callable[[], None] | None = None,
        until: Node | None = None,
    ) -> None:
        self._at_end = at_end
        self._node = weakref.ref(until or node)
        self.executor = SingleThreadedExecutor(context=node.context)
        self._process = os.getpid()
        keep_in_children(node)
        keep_in_children(self.executor)
        self.executor.add_node(node)
        self.thread = threading.Thread(target=self._run, name="tf2_ros listener", daemon=daemon)
        # It must not run while the interpreter is finalized, which waits for threads that are not daemons
        # unless it is interrupted.
        _running.add(self)
        check_regularly(self)
        try:
            self.thread.start()
        except BaseException:
            self._at_end = None  # whoever called this destroys that
            self.stop(wait=False)
            raise

    def stop(self, *, wait: bool = True) -> None:
        """
        End the thread.

        :param wait: wait until it has ended, for CALLBACK_END_WAIT_S at most, unless this is that thread. Not
            in a finalizer, which may run inside any other function, also one that holds a lock that joining
            needs.
        """
        if is_inherited(self._process):
            return
        # The spinning thread does the rest of the shutdown: another one could destroy what is in use.
        mark_shut_down(self.executor)
        # It does not live if a signal handler raised before it was started.
        if wait and self.thread.is_alive() and self.thread is not threading.current_thread():
            self.thread.join(CALLBACK_END_WAIT_S)

    def _tf2_check(self) -> None:
        """Wake the executor after a shutdown, see ``CallQueue._tf2_check``, and end with the node."""
        node = self._node()
        if context_was_shut_down(self.executor.context):
            wake(self.executor)
        elif (node is None or node_has_ended(node)) and len(self.executor.get_nodes()) <= 1:
            self.stop(wait=False)

    def _run(self) -> None:
        try:
            while self.executor.context.ok() and not is_shut_down(self.executor):
                # A part of the node may be destroyed while the executor gathers them.
                with suppress(InvalidHandle):
                    self.executor.spin()
        except (AttributeError, ExternalShutdownException, RuntimeError):
            # The context may end, or a program shut the executor down, between two checks of the executor.
            if self.executor.context.ok() and not is_shut_down(self.executor):
                raise
        finally:
            self.executor.shutdown()
            at_end, self._at_end = self._at_end, None
            if at_end is not None:
                at_end()


@atexit.register
def _stop_spinning() -> None:
    if not _running:
        return
    # After Ctrl-C, a thread of rclpy wakes all executors and shuts all contexts down. It does not notice when
    # they are destroyed meanwhile, and crashes. This waits until it has ended. A forked child would wait for
    # a thread that does not exist, or for another one in its place.
    if not _lacks_signal_thread:
        uninstall_signal_handlers()
    for spinner in _running:
        spinner.stop()


def node_has_ended(node: Any) -> bool:
    """Whether a node receives nothing any more, because it was destroyed or its context was shut down."""
    if not is_node(node):
        return False  # of a program's own kind, or a mock
    return not handle_exists(node.handle) or context_was_shut_down(node.context)
