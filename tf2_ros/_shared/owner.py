"""Share what a buffer of this process receives."""

import errno
import os
import resource
import weakref
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tf2_py._internal import log
from tf2_ros._receive.inboxes import check_regularly
from tf2_ros._shared.files import Description, make_file, publish
from tf2_ros._shared.naming import FOLDER, SharedBufferError, segment_path
from tf2_ros._shared.ring import RingWriter
from tf2_ros_cython._presence import HAS_ROS

if TYPE_CHECKING or HAS_ROS:
    from tf2_ros._receive.receiver import open_topics

LEAST_BYTES, MOST_BYTES = 17 << 16, 1 << 28  # of the file; readers refuse a ring of less than 1 MiB
PART_OF_MEMORY, PART_OF_FOLDER = 32, 4  # no more than this part of the machine's, and of /dev/shm


class Owner:
    """
    Shares what a buffer receives with all processes of this user.

    :param name: of the shared buffer.
    :raises SharedBufferError: another process owns it, or there is no memory for it.

    Sharing ends with the buffer or the process, however that ends.
    """

    is_attached = False

    def __init__(self, buffer: Any, name: str) -> None:
        self.name = name
        self.path = segment_path(name)
        self._description = Description(os.getpid(), buffer.cache_time_ns)
        try:
            size = _file_size()
            descriptor, lock_descriptor = make_file()
            self._ring = RingWriter(descriptor, lock_descriptor, size, buffer.cache_time_ns)
            self._ring.describe(self._description.to_bytes())
            file = os.fstat(descriptor)
            publish(descriptor, self.path)
        except BlockingIOError as error:
            # The id of a process in another container is not known here.
            process = error.args[0]
            by = f"process {process}" if process > 0 else "a process that cannot be seen from here"
            raise SharedBufferError(f"the shared buffer {name!r} is owned by {by}") from None
        except OSError as error:
            why = "/dev/shm has no memory for it" if error.errno == errno.ENOSPC else str(error)
            raise SharedBufferError(f"the buffer cannot be shared as {name!r}: {why}") from None
        self._said: set[str] = set()  # the kinds of what was logged, which is done once
        self._buffer = weakref.ref(buffer)
        self._ring.tap(buffer)
        # Also when the interpreter exits, because other threads may still insert.
        self.close = weakref.finalize(buffer, _end, self._ring, self.path, file, self._description.process)
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
            self._ring.describe(changed.to_bytes())

    def _tf2_check(self) -> None:
        """Describe the listeners that fill the buffer now, and log once what readers lack."""
        if not self._ring.is_open:
            return
        self._describe()
        short_ns, missing = self._ring.shortage
        if missing:
            self._say("missing", f"it had no memory for {missing} message(s): listeners subscribe instead")
        elif short_ns:
            self._say(
                "short",
                f"it has no memory for all of the last {self._description.cache_time_ns / 1e9:g} s, but for "
                f"{short_ns / 1e9:.3g} s: programs that are attached later lack what is older",
            )

    def _say(self, kind: str, problem: str) -> None:
        if kind not in self._said:
            self._said.add(kind)
            log.logger("tf2_ros").warning(f"Of the shared buffer {self.name!r}: {problem}")


def _file_size() -> int:
    """How large the file may become. It takes memory only for what it holds."""
    folder = os.statvfs(FOLDER)
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // PART_OF_MEMORY
    sizes = [memory, folder.f_blocks * folder.f_frsize // PART_OF_FOLDER, MOST_BYTES]
    of_process, _ = resource.getrlimit(resource.RLIMIT_FSIZE)
    if of_process != resource.RLIM_INFINITY:
        sizes.append(of_process)
    return max(min(sizes), LEAST_BYTES)


def _end(ring: RingWriter, path: Path, file: os.stat_result, process: int) -> None:
    if process != os.getpid():
        return  # in a forked child
    try:
        with suppress(FileNotFoundError):  # somebody has removed it
            if os.path.samestat(os.stat(path, follow_symlinks=False), file):
                os.unlink(path)
    finally:
        ring.close()
