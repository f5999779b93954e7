"""Forget frames that have fallen silent."""

import weakref
from typing import Any

from tf2_py import BufferCore
from tf2_ros._receive.inboxes import check_regularly


class Expiry:
    """
    Every one or two seconds, has a buffer forget the frames whose newest dynamic transform is too old.

    :param buffer: which has a clock; not kept alive.
    :param after_ns: how old that may be, in nanoseconds of that clock.
    """

    def __init__(self, buffer: Any, after_ns: int) -> None:
        if after_ns <= 0:
            raise ValueError("expire_after must be above 0")
        self._buffer = weakref.ref(buffer)
        self._after_ns = after_ns
        check_regularly(self)

    def _tf2_check(self) -> None:
        """Forget what is too old now."""
        buffer = self._buffer()
        if buffer is None:
            return
        oldest_ns = buffer.clock.now().nanoseconds - self._after_ns
        for name, frame in BufferCore.frames(buffer).items():
            # A frame without a newest stamp may be one that was emptied by a clear.
            if not frame.static and (frame.newest_ns or 0) < oldest_ns:
                BufferCore._forget_silent(buffer, name, oldest_ns)
