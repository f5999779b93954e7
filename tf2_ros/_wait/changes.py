"""Follow the latest transform between two frames: in a coroutine, or with a callback."""

from collections.abc import Callable
from functools import partial
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.time import Time

from tf2_py import BufferCore, TimeoutException
from tf2_py._internal import call_all, call_despite_signals
from tf2_ros._arguments import require_callable
from tf2_ros._nodes import Shutdown
from tf2_ros._wait.blocking import Lookup
from tf2_ros._wait.callbacks import queue_of
from tf2_ros._wait.futures import TransformFuture
from tf2_ros._wait.rounds import run_done_callbacks


class _NextChange(Lookup):
    """The lookup of a transform that differs from the one that was delivered last."""

    delivered: Any = None  # the wait that had it
    pending: Any = None

    def wait(self, core: BufferCore, notify: Callable[[Any], Any] | None = None) -> Any:
        """Begin to wait; see ``Lookup``."""
        self.pending = BufferCore._wait(core, *self[:-1], notify=notify, after=self.delivered)
        return self.pending

    def deliver(self) -> None:
        """Note that the program gets the transform that was waited for."""
        self.delivered = self.pending


class Changes:
    """
    An asynchronous iterator over the transforms between two frames, each when it is new.

    :param buffer: kept alive by this.
    """

    def __init__(self, buffer: BufferCore, target_frame: str, source_frame: str) -> None:
        self._buffer = buffer
        self._next = _NextChange(target_frame, source_frame, Time())
        self._shutdown = Shutdown(buffer)

    def future(self) -> TransformFuture:
        """The future of the next one. There may be one at a time."""
        return TransformFuture(self._buffer, self._next)

    def deliver(self) -> None:
        """Note that the program gets the result of the future."""
        self._next.deliver()

    def call(self, callback: Callable[[TransformStamped], object]) -> "ChangeSubscription":
        """Call a function with each one; see ``Buffer.on_change``."""
        return ChangeSubscription(self._buffer, self, callback)

    def __aiter__(self) -> "Changes":
        return self

    async def __anext__(self) -> TransformStamped:
        future = self.future()
        try:
            found = await future
        except BaseException as error:
            future.cancel()  # what this refers to would go on waiting
            if isinstance(error, TimeoutException) and self._shutdown.happened():
                raise StopAsyncIteration from None
            raise
        self.deliver()
        return found


class ChangeSubscription:
    """Calls a function with each transform of :class:`Changes`."""

    def __init__(
        self, buffer: BufferCore, changes: Changes, callback: Callable[[TransformStamped], object]
    ) -> None:
        require_callable("on_change", callback)
        self._buffer, self._changes, self._callback = buffer, changes, callback
        self._future: TransformFuture | None = None  # of the next change
        self._awaited: TransformFuture | None = None  # the last one that calls `_deliver`
        self._left: list[Callable[[TransformStamped], object]] = []  # to be called with its result
        self._is_cancelled = False
        try:
            call_despite_signals(partial(self._deliver, None))
        except BaseException:
            self.cancel()  # the program gets nothing to cancel it with
            raise
        if self._future is not None and self._future.done() and self._future.exception() is not None:
            self._future.result()  # raises: a name is invalid

    def cancel(self) -> None:
        """End this; the callback is not called again, except where another thread is about to."""
        self._is_cancelled = True
        if self._future is not None:
            self._future.cancel()

    def _deliver(self, done: TransformFuture | None) -> None:
        """Deliver this change, and wait for the next one; may be called again if it was interrupted."""
        while not self._is_cancelled:
            future = self._future
            if future is None or not self._left:
                future = self._future = self._changes.future()
                self._left = [self._callback]
            if not future.done():
                if future is not self._awaited:
                    future.add_done_callback(partial(call_all, [self._delivery(future)]))
                    self._awaited = future
                return
            if future.exception() is not None:
                return
            queue = queue_of(self._buffer)
            if future is not done and queue is not None and queue.is_in_executor():
                # As many may follow as arrive during the callback: the executor does other work in between.
                queue.put(self._delivery(future))
                return
            self._changes.deliver()
            run_done_callbacks(future.result(), self._left)

    def _delivery(self, future: TransformFuture) -> Callable[[], object]:
        # No signal handler comes before its first line.
        return partial(call_despite_signals, partial(self._deliver, future))
