"""Share what a buffer of this process receives."""

import atexit
import errno
import os
import sys
import weakref
from contextlib import suppress
from pathlib import Path
from typing import Any

from tf2_py._internal import log
from tf2_ros._forking import LiveObjects
from tf2_ros._receive.inboxes import check_regularly
from tf2_ros._shared.files import Description, make_file, publish
from tf2_ros._shared.naming import SharedBufferError, segment_path
from tf2_ros._shared.ring import RingWriter

__all__ = ["Owner"]

STEP = 1 << 16  # as in ring.pyx
LEAST_BYTES, MOST_BYTES = 1 << 20, 1 << 28  # of the ring
PART_OF_MEMORY, PART_OF_FOLDER = 32, 4  # no more than this part of the machine's, and of /dev/shm

_owners: "LiveObjects[Owner]" = LiveObjects()


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
        self._process = os.getpid()
        program = os.path.basename(sys.argv[0]) if sys.argv else ""
        self._description = Description(self._process, program[:100], buffer.cache_time_ns)
        try:
            descriptor, lock_descriptor = make_file()
            self._ring = _new_ring(descriptor, lock_descriptor, buffer.cache_time_ns)
            self._ring.describe(self._description.to_bytes())
            self._file = os.fstat(descriptor)
            publish(descriptor, self.path)
        except BlockingIOError as error:
            # The id of a process in another container is not known here.
            process = error.args[0]
            by = f"process {process}" if process > 0 else "a process that cannot be seen from here"
            raise SharedBufferError(f"the shared buffer {name!r} is owned by {by}") from None
        except OSError as error:
            why = "/dev/shm has no memory for it" if error.errno == errno.ENOSPC else str(error)
            raise SharedBufferError(f"the buffer cannot be shared as {name!r}: {why}") from None
        self._said: set[str] = set()  # what was logged, which is done once
        self._listeners: dict[int, tuple[int, list[str]]] = {}  # by the listeners' addresses
        self._ring.tap(buffer)
        weakref.finalize(buffer, _end, self._ring, self.path, self._file, self._process).atexit = False
        check_regularly(self)
        _owners.add(self)

    def add_listener(self, listener: object, domain: int, topics: list[str]) -> None:
        """Note that a listener of this ROS domain fills the buffer from these topics."""
        self._listeners[id(listener)] = domain, topics
        self._describe_listeners()

    def forget_listener(self, listener: object) -> None:
        """Note that it no longer does."""
        if self._listeners.pop(id(listener), None) is not None:
            self._describe_listeners()

    def _describe_listeners(self) -> None:
        known = self._description
        # A buffer that is filled from several domains cannot stand for one's own.
        domains = {one for one, _ in self._listeners.values()}
        known.domain = domains.pop() if len(domains) == 1 else None
        known.topics = list(dict.fromkeys(name for _, names in self._listeners.values() for name in names))
        self._ring.describe(known.to_bytes())

    def set_simulated(self, is_simulated: bool) -> None:
        """Note whether the buffer's clock follows simulated time."""
        if self._description.simulated != is_simulated:
            self._description.simulated = is_simulated
            self._ring.describe(self._description.to_bytes())

    def check(self) -> None:
        """Log once what readers lack."""
        if not self._ring.is_open:
            return
        short_ns, missing = self._ring.shortage
        if self._ring.is_lost:
            self._say("its file was truncated, and nothing is shared any more")
        elif missing:
            self._say(f"it had no memory for {missing} message(s): listeners subscribe instead")
        elif short_ns:
            self._say(
                f"it has no memory for all of the last {self._description.cache_time_ns / 1e9:g} s, but for "
                f"{short_ns / 1e9:.3g} s: programs that are attached later lack what is older"
            )

    def _say(self, problem: str) -> None:
        kind = problem[:10]
        if kind not in self._said:
            self._said.add(kind)
            log.logger("tf2_ros").warning(f"Of the shared buffer {self.name!r}: {problem}")

    def close(self) -> None:
        """End sharing."""
        _end(self._ring, self.path, self._file, self._process)


def _new_ring(descriptor: int, lock_descriptor: int, keep_ns: int) -> RingWriter:
    folder = os.fstatvfs(descriptor)
    memory = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // PART_OF_MEMORY
    wanted = min(memory, folder.f_blocks * folder.f_frsize // PART_OF_FOLDER, MOST_BYTES)
    while True:
        size = max(wanted, LEAST_BYTES) // STEP * STEP
        try:
            # The process may be limited to smaller files (RLIMIT_FSIZE).
            os.ftruncate(descriptor, STEP + size)
            break
        except OSError as error:
            if error.errno not in (errno.EFBIG, errno.EINVAL) or wanted < LEAST_BYTES:
                os.close(descriptor)
                os.close(lock_descriptor)
                raise
            wanted //= 4
    return RingWriter(descriptor, lock_descriptor, size, keep_ns)


def _end(ring: RingWriter, path: Path, file: os.stat_result, process: int) -> None:
    if process != os.getpid() or not ring.is_open:
        return  # in a forked child, or ended before
    try:
        with suppress(FileNotFoundError):  # somebody has removed it
            if os.path.samestat(os.stat(path, follow_symlinks=False), file):
                os.unlink(path)
    finally:
        ring.close()


@atexit.register
def _end_all() -> None:
    # Other threads may still insert.
    for owner in _owners:
        owner.close()
