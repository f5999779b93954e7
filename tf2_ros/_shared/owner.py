"""Share what a buffer of this process receives."""

import errno
import os
import weakref
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tf2_py._internal import log
from tf2_ros._forking import LOCK
from tf2_ros._receive.inboxes import check_regularly
from tf2_ros._shared.files import Description, make_file, publish, remove_name, write_description
from tf2_ros._shared.naming import FOLDER, SharedBufferError, segment_path
from tf2_ros._shared.ring import RingWriter
from tf2_ros_cython._presence import HAS_ROS

if TYPE_CHECKING or HAS_ROS:
    from tf2_ros._receive.receiver import open_topics

# Of the file, which takes memory only for what it holds. At least, the ring has 1 MiB.
LEAST_BYTES, MOST_BYTES = 19 << 16, 1 << 28
PART_OF_FOLDER = 4  # no more than this part of /dev/shm


class Owner:
    """
    Shares what a buffer receives with all processes of this user.

    :param name: of the shared buffer.
    :raises SharedBufferError: another process owns it, or there is no memory for it.

    Sharing ends with the buffer, with the process, or when there is no memory for a message.
    """

    def __init__(self, buffer: Any, name: str) -> None:
        self.name = name
        self.path = segment_path(name)
        self._description = Description(os.getpid(), buffer.cache_time_ns)
        try:
            folder = os.statvfs(FOLDER)
            size = min(folder.f_blocks * folder.f_frsize // PART_OF_FOLDER, MOST_BYTES)
            descriptor = make_file()
            self._ring = RingWriter(descriptor, max(size, LEAST_BYTES), buffer)
            write_description(self._ring, self._description)
            publish(descriptor, name)
        except OSError as error:
            why = "/dev/shm has no memory for it" if error.errno == errno.ENOSPC else str(error)
            raise SharedBufferError(f"the buffer cannot be shared as {name!r}: {why}") from None
        self._buffer = weakref.ref(buffer)
        # Also when the interpreter exits, because other threads may still insert.
        self.close = weakref.finalize(buffer, _end, self._ring, self.path, self._description.process)
        check_regularly(self)

    def _describe(self) -> None:
        buffer = self._buffer()
        topics = open_topics(buffer) if HAS_ROS else []
        # A buffer that is filled from several domains cannot replace one's own subscriptions.
        domains = {None if one.context is None else one.context.get_domain_id() for one in topics}
        changed = replace(
            self._description,
            domain=domains.pop() if len(domains) == 1 else None,
            topics=list(dict.fromkeys(topic.name for topic in topics)),
            simulated=getattr(getattr(buffer, "clock", None), "ros_time_is_active", False),
        )
        if changed != self._description:
            self._description = changed
            write_description(self._ring, changed)

    def _tf2_check(self) -> None:
        """Describe the listeners that fill the buffer now, or end if readers lack a message."""
        if self._ring.has_failed and self._ring.descriptor >= 0:
            self.close()
            log.logger("tf2_ros").error(
                f"The shared buffer {self.name!r} has ended: there was no memory for a message"
            )
        with LOCK:  # of two threads that describe it, the later one must be right
            if self._ring.descriptor >= 0:
                self._describe()


def _end(ring: RingWriter, path: Path, process: int) -> None:
    # A finalizer, so without LOCK: whoever holds that may wait for the thread in which this runs.
    if process == os.getpid():  # not in a forked child
        try:
            remove_name(path, ring.descriptor)
        finally:
            ring.close()
