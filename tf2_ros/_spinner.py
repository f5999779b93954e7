"""Owns the thread that spins a listener's node."""

import atexit
import threading
import weakref

from rclpy.exceptions import InvalidHandle
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node

__all__ = ["Spinner"]

EXIT_WAIT_S = 1.0  # for a callback that runs while the interpreter exits

_running: "weakref.WeakSet[Spinner]" = weakref.WeakSet()


class Spinner:
    """
    Spins a node in a thread of its own.

    The thread ends with :meth:`stop`, with the node's context and with the interpreter. It idles when another
    executor takes the node.
    """

    def __init__(self, node: Node) -> None:
        self.executor = SingleThreadedExecutor(context=node.context)
        self._stopping = threading.Event()
        self._ended = False
        self._ending = threading.Lock()
        self.executor.add_node(node)
        # A daemon, so that the interpreter does not wait for it before it runs the exit handlers.
        self.thread = threading.Thread(target=self._run, name="tf2_ros listener", daemon=True)
        _running.add(self)
        self.thread.start()

    def stop(self, wait_s: float | None = None) -> None:
        """
        End the thread, and wait until it has ended, unless this is that thread.

        :param wait_s: wait so many seconds at most.
        """
        self._stopping.set()
        with self._ending:
            if not self._ended:
                # Waking an executor alone does not make it return: it waits until there is something to do.
                self.executor.create_task(_nothing)
        if self.thread is not threading.current_thread():
            self.thread.join(wait_s)

    def _run(self) -> None:
        try:
            self._spin()
        except ExternalShutdownException:
            return
        except rclpy_implementation.RCLError:
            if self.executor.context.ok():
                raise
            # It ended after the executor had looked.
        finally:
            with self._ending:
                self._ended = True
                for node in self.executor.get_nodes():
                    self.executor.remove_node(node)
                self.executor.shutdown()

    def _spin(self) -> None:
        while not self._stopping.is_set() and self.executor.context.ok():
            try:
                self.executor.spin_once()
            except InvalidHandle:
                continue  # a part of the node was destroyed while the executor gathered them
            if not self.executor.get_nodes():
                return


def _nothing() -> None:
    pass


@atexit.register
def _stop_all() -> None:
    for spinner in list(_running):
        spinner.stop(EXIT_WAIT_S)
