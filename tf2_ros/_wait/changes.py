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


class _NextChange(Lookup):
    """The lookup of a transform that differs from the one that was delivered last."""

    delivered: Any = None  # the wait that had it
    pending: Any = None

    def wait(self, core: BufferCore, notify: Callable[[Any], Any] | None = None) -> Any:
        """Begin to wait; see ``Lookup``."""
        self.pending = BufferCore._wait(
            core, self.target_frame, self.source_frame, self.source_time, notify=notify, after=self.delivered
        )
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
        self._next = _NextChange(target_frame, None, source_frame, Time(), None)
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
        self._noted: TransformFuture | None = None  # the last one whose change the next one must differ from
        self._awaited: TransformFuture | None = None  # the last one whose steps were registered
        self._delivered: TransformFuture | None = None  # the last one whose result the callback got
        self._is_cancelled = False
        self._go_on(None)
        if self._future is not None and self._future.done() and self._future.exception() is not None:
            self._future.result()  # raises: a name is invalid

    def cancel(self) -> None:
        """End this; the callback is not called again, except where another thread is about to."""
        self._is_cancelled = True
        if self._future is not None:
            self._future.cancel()

    def _go_on(self, done: TransformFuture | None) -> None:
        """Wait for the change after this one; to be called again if a signal handler has cut it short."""
        if self._future is done:
            if self._noted is not done:
                self._changes.deliver()
                self._noted = done
            self._future = self._changes.future()
        future = self._future
        if future is None or self._awaited is future:
            return
        steps = [
            partial(call_despite_signals, partial(step, future)) for step in (self._deliver, self._after)
        ]
        if self._is_cancelled:
            future.cancel()
        elif future.done():
            # Not here, because as many may follow as arrive during the callback.
            queue_of(self._buffer).put_all(steps)
        else:
            future.add_done_callback(partial(call_all, steps))
        self._awaited = future

    def _deliver(self, future: TransformFuture) -> None:
        if self._has_ended_at(future) or self._delivered is future:
            return
        found = future.result()
        self._delivered = future
        self._callback(found)

    def _after(self, future: TransformFuture) -> None:
        if not self._has_ended_at(future):
            self._go_on(future)

    def _has_ended_at(self, future: TransformFuture) -> bool:
        return self._is_cancelled or future.cancelled() or future.exception() is not None
