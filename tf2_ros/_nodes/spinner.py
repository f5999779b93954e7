# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Spin a node in a thread."""

import atexit
import os
import threading
import weakref
from collections.abc import Callable
from contextlib import suppress

from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions, get_current_signal_handlers_options, uninstall_signal_handlers

from tf2_ros._live_objects import LiveObjects
from tf2_ros._nodes.ended_nodes import node_has_ended
from tf2_ros._process.background import check_regularly
from tf2_ros._process.forking import is_inherited, keep_in_children
from tf2_ros._process.threads import await_beginnings, start_and_wait
from tf2_ros._rclpy import (
    context_was_shut_down,
    is_shut_down,
    mark_shut_down,
    shut_down_but_for_signals,
    wake,
)

CALLBACK_END_WAIT_S = 1.0  # for a callback that runs when the thread is to end

_running: "LiveObjects[Spinner]" = LiveObjects()
# Of executors that have ended: what rclpy's thread for signals may be using, see `shut_down_but_for_signals`.
_woken_by_signals: list[object] = []
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
        _woken_by_signals.clear()  # long after a signal; otherwise their number would grow
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
            start_and_wait(self.thread)
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
            kept = shut_down_but_for_signals(self.executor)
            if kept is not None:
                keep_in_children(kept)
                _woken_by_signals.append(kept)
            at_end, self._at_end = self._at_end, None
            if at_end is not None:
                at_end()


@atexit.register
def _stop_spinning() -> None:
    # After Ctrl-C, a thread of rclpy wakes all executors, also those of the program, and shuts all contexts
    # down. It does not notice when they are destroyed meanwhile, and crashes. This waits until it has ended.
    # A forked child would wait for a thread that does not exist, or for another one in its place.
    if not _lacks_signal_thread:
        uninstall_signal_handlers()
    await_beginnings()  # a signal handler may have interrupted the start of one, which is stopped only now
    for spinner in _running:
        spinner.stop()
    _woken_by_signals.clear()


def _after_fork_in_child() -> None:
    global _lacks_signal_thread
    _running.clear()
    _woken_by_signals.clear()
    if get_current_signal_handlers_options() != SignalHandlerOptions.NO:
        _lacks_signal_thread = True


os.register_at_fork(after_in_child=_after_fork_in_child)
