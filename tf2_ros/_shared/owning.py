"""Owns what a process does that shares its buffer."""

import atexit
import os
import sys
import weakref
from pathlib import Path
from typing import Any

from tf2_ros._forking import register_for_fork
from tf2_ros._shared.description import Description
from tf2_ros._shared.following import Follower
from tf2_ros._shared.names import SharedBufferError, segment_path
from tf2_ros._shared.segment import OwnedSegment

__all__ = ["Owner"]

_owners: "weakref.WeakSet[Owner]" = weakref.WeakSet()


class Owner:
    """
    Shares a buffer with all processes of this user.

    :param name: of the shared buffer.
    :raises SharedBufferError: it has an owner, or there is no memory for it.

    It ends with the buffer or the process, however that ends.
    """

    def __init__(self, buffer: Any, name: str) -> None:
        self.name = name
        try:
            self._segment = OwnedSegment(segment_path(name))
        except BlockingIOError as error:
            process = error.args[0]
            # Of one in another container no id is known here.
            by = f"process {process}" if process > 0 else "a process that cannot be seen from here"
            raise SharedBufferError(f"the shared buffer {name!r} is owned by {by}") from None
        except OSError as error:
            raise SharedBufferError(f"the buffer cannot be shared as {name!r}: {error}") from None
        try:
            self._segment.publish(buffer)
        except MemoryError:
            self._segment.close()
            raise SharedBufferError(
                f"the buffer cannot be shared as {name!r}: /dev/shm has no memory for it"
            ) from None
        self._buffer = weakref.ref(buffer)
        self._listeners: dict[int, tuple[int, list[str]]] = {}  # by the listeners' addresses
        program = os.path.basename(sys.argv[0]) if sys.argv else ""
        self._description = Description(os.getpid(), program[:100], buffer.cache_time_ns)
        self._segment.describe(self._description.to_bytes())
        weakref.finalize(buffer, self._segment.close).atexit = False
        register_for_fork(self)
        _owners.add(self)

    @property
    def path(self) -> Path:
        """The file."""
        return self._segment.path

    def tell_of_listener(self, listener: object, domain: int, topics: list[str]) -> None:
        """A listener of this ROS domain fills the buffer from these topics; from none: no longer."""
        self._listeners.pop(id(listener), None)
        if topics:
            self._listeners[id(listener)] = domain, topics
        known = self._description
        # Listeners of several domains fill no buffer that could stand for one's own.
        domains = {one for one, _ in self._listeners.values()}
        known.domain = domains.pop() if len(domains) == 1 else None
        known.topics = list(dict.fromkeys(name for _, names in self._listeners.values() for name in names))
        self._segment.describe(known.to_bytes())

    def tell_of_time(self, simulated: bool) -> None:
        """The buffer's clock follows simulated time, or does not."""
        if self._description.simulated != simulated:
            self._description.simulated = simulated
            self._segment.describe(self._description.to_bytes())

    def clears_at_jumps(self, clock: Any) -> bool:
        """Nobody else does it; but readers are told what the clock follows now."""
        self.tell_of_time(bool(clock.ros_time_is_active))
        return False

    def after_fork(self) -> None:
        """In a forked child the buffer is a reader of its parent's."""
        buffer = self._buffer()
        if buffer is not None:
            buffer._sharing = Follower(buffer, self._segment, self.name)

    def close(self) -> None:
        """End sharing."""
        self._segment.close()


@atexit.register
def _unlink_all() -> None:
    # Threads may still insert.
    for owner in list(_owners):
        owner._segment.unlink()


os.register_at_fork(after_in_child=_owners.clear)
