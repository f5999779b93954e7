"""Follow the latest transform between two frames: in a coroutine, or with a callback."""

from collections.abc import Callable
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.time import Time

from tf2_py import BufferCore, TimeoutException
from tf2_ros._arguments import require_callable
from tf2_ros._nodes import Shutdown
from tf2_ros._wait.blocking import Lookup
from tf2_ros._wait.callbacks import put_in_executor, queue_of
from tf2_ros._wait.endings import ChangeSubscription, Ending
from tf2_ros._wait.futures import TransformFuture


class _NextChange(Lookup):
    """The lookup of a transform that differs from the one that was delivered last."""

    delivered: Any = None  # the wait that had it
    pending: Any = None

    def wait(self, core: BufferCore, notify: Callable[[Any], Any] | None = None) -> Any:
        """Begin to wait; see ``Lookup``."""
        self.pending = BufferCore._wait(core, *self[:-1], notify=notify, after=self.delivered)
        return self.pending


class Changes:
    """
    An asynchronous iterator over the transforms between two frames, each when it is new.

    :param buffer: kept alive by this.
    """

    def __init__(self, buffer: BufferCore, target_frame: str, source_frame: str) -> None:
        self._buffer = buffer
        self._next = _NextChange(target_frame, source_frame, Time())
        self._shutdown = Shutdown(buffer)

    def call(self, callback: Callable[[TransformStamped], object]) -> ChangeSubscription:
        """Call a function with each one; see ``Buffer.on_change``."""
        require_callable("on_change", callback)

        def put(call: Ending) -> bool:
            return put_in_executor(queue_of(self._buffer), call)

        return ChangeSubscription(self._buffer, *self._next[:2], callback, put)

    def __aiter__(self) -> "Changes":
        return self

    async def __anext__(self) -> TransformStamped:
        future = TransformFuture(self._buffer, self._next)
        try:
            found = await future
        except BaseException as error:
            future.cancel()  # what this refers to would go on waiting
            if isinstance(error, TimeoutException) and self._shutdown.happened():
                raise StopAsyncIteration from None
            raise
        self._next.delivered = self._next.pending
        return found
