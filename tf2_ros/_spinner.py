"""Owns the thread that spins a listener's node."""

import atexit
import threading
import weakref
from collections.abc import Callable

from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from tf2_ros._forking import keep_for_ever, register_for_fork
from tf2_ros._node_use import NodeUse
from tf2_ros._rclpy import RCLError, executor_handles, executor_wake_handle, is_shut_down, mark_shut_down

__all__ = ["END_WAIT_S", "Spinner"]

END_WAIT_S = 1.0  # for a callback that runs when the thread is to end

_running: "weakref.WeakSet[Spinner]" = weakref.WeakSet()


class Spinner:
    """
    Spins a node in a thread of its own.

    :param daemon: let the interpreter exit while the thread runs. Otherwise the program goes on until the
        node's context is shut down.
    :param owner: kept alive by the thread.
    :param at_end: called by the thread when it ends, to destroy what only it uses.

    The thread ends with :meth:`stop`, with the shutdown of ``executor``, and with the node's context. It
    idles when another executor takes the node.
    """

    def __init__(
        self,
        node: Node,
        *,
        daemon: bool,
        owner: object = None,
        at_end: Callable[[], None] | None = None,
    ) -> None:
        self._owner = owner
        self._at_end = at_end
        self.executor = SingleThreadedExecutor(context=node.context)
        self._wake_handle = executor_wake_handle(self.executor)
        self._node_use = NodeUse(node)
        self.executor.add_node(node)
        self.thread = threading.Thread(target=self._run, name="tf2_ros listener", daemon=daemon)
        # It must not run while the interpreter is finalized. That waits for threads that are not daemons,
        # unless it is interrupted.
        _running.add(self)
        register_for_fork(self)
        self.thread.start()

    def stop(self, *, wait: bool = True) -> None:
        """
        End the thread.

        :param wait: until it has ended, for END_WAIT_S at most, unless this is that thread. Not from a
            finalizer: it may run inside any other function of this thread, also one that holds a lock which
            joining takes.
        """
        if self._node_use.forked:
            return
        # The rest of the shutdown is for the spinning thread: from another one, it may destroy what is in
        # use.
        mark_shut_down(self.executor, self._wake_handle)
        if wait and self.thread is not threading.current_thread():
            self.thread.join(END_WAIT_S)

    def after_fork(self) -> None:
        """End in a forked child."""
        _running.discard(self)
        self._owner = self._at_end = None
        keep_for_ever(self._wake_handle, *executor_handles(self.executor))

    def _run(self) -> None:
        try:
            self._spin()
        except ExternalShutdownException:
            return
        except (AttributeError, RCLError):
            if self.executor.context.ok() and not is_shut_down(self.executor):
                raise
            # The context ended, or a program shut the executor down, between two checks of the executor.
        finally:
            self._owner = None
            for node in self.executor.get_nodes():
                self.executor.remove_node(node)
            self.executor.shutdown()
            at_end, self._at_end = self._at_end, None
            if at_end is not None:
                at_end()

    def _spin(self) -> None:
        while self.executor.context.ok() and not is_shut_down(self.executor):
            try:
                self.executor.spin()
            except InvalidHandle:
                continue  # a part of the node was destroyed while the executor gathered them


@atexit.register
def _stop_all() -> None:
    for spinner in list(_running):
        spinner.stop()
