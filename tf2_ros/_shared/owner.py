"""
Share what a buffer of this process receives: an owner, its file, and the description of it for readers.

A file gets its name when it is complete, so a process that finds it can read it. An owner has an exclusive
lock on its file, which the kernel releases when the process ends, however that happens. The lock belongs to
an open file description, so other descriptors of the file may be closed, and a forked child, which closes its
own at once, does not keep the lock.
"""

import errno
import fcntl
import os
import stat
import struct
import time
import weakref
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tf2_py._internal import log
from tf2_py.printable import counted
from tf2_ros._forking import LOCK
from tf2_ros._rclpy import is_simulated
from tf2_ros._receive.listeners_and_silence import open_topics, watch_listeners
from tf2_ros._shared.ring import RingWriter
from tf2_ros._shared.shared_names import FOLDER, SharedBufferError, segment_path
from tf2_ros._threads import check_regularly

# Of the file, which takes memory only for what it holds. At least, the ring has 1 MiB.
LEAST_BYTES, MOST_BYTES = 19 << 16, 1 << 28
PART_OF_FOLDER = 4  # no more than this part of /dev/shm
LOCK_WAIT_S = 1.0  # for a lock on the file of a dead owner
TEXT_AT, TEXT_BYTES = 4096, 4096  # place of the description in the file, behind the page that is mapped


class SharedBufferOwner:
    """
    Shares what a buffer receives with all processes of this user.

    :param name: of the shared buffer.
    :raises SharedBufferError: another process owns it, or there is no memory for it.

    Sharing ends with the buffer, with the process, or when there is no memory for a message.
    """

    def __init__(self, buffer: Any, name: str) -> None:
        self.name = name
        self.path = segment_path(name)
        try:
            folder = os.statvfs(FOLDER)
            size = min(folder.f_blocks * folder.f_frsize // PART_OF_FOLDER, MOST_BYTES)
            descriptor = os.open(FOLDER, os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o600)  # it has no name yet
            fcntl.flock(descriptor, fcntl.LOCK_EX)
            self._ring = RingWriter(descriptor, max(size, LEAST_BYTES), buffer)
            self._describe(buffer)
            publish(descriptor, name)
        except OSError as error:
            why = "/dev/shm has no memory for it" if error.errno == errno.ENOSPC else str(error)
            raise SharedBufferError(f"the buffer cannot be shared as {name!r}: {why}") from None
        self._buffer = weakref.ref(buffer)
        self._has_warned_of_room, self._warned_of_names = False, 0
        # Also when the interpreter exits, because other threads may still insert.
        self.close = weakref.finalize(buffer, _end, self._ring, self.path, os.getpid())
        check_regularly(self)
        watch_listeners(self)  # so that readers learn of them at once

    def _describe(self, buffer: Any) -> None:
        topics = open_topics(buffer)
        # A buffer that is filled from several domains cannot replace one's own subscriptions.
        domains = {None if one.context is None else one.context.get_domain_id() for one in topics}
        description = Description(
            os.getpid(),
            buffer.cache_time_ns,
            domain=domains.pop() if len(domains) == 1 else None,
            topics=list(dict.fromkeys(topic.name for topic in topics)),
            simulated=is_simulated(getattr(buffer, "clock", None)),
        )
        write_description(self._ring, description)

    def _tf2_check(self) -> None:
        """Describe the listeners that fill the buffer now, or end if readers lack a message."""
        if self._ring.has_failed and self._ring.descriptor >= 0:
            self.close()
            log.logger("tf2_ros").error(
                f"The shared buffer {self.name!r} has ended, because there was no memory for a message"
            )
        self._warn()
        with LOCK:  # of two threads that describe it, the later one must be right
            buffer = self._buffer()
            if buffer is not None and self._ring.descriptor >= 0:
                self._describe(buffer)

    def _warn(self) -> None:
        """Say once that the ring is too small, and each time that transforms are not shared."""
        buffer, room_s, too_long = self._buffer(), self._ring.room_s, self._ring.too_long
        if buffer is not None and room_s and not self._has_warned_of_room:
            self._has_warned_of_room = True
            keeps_s = buffer.cache_time_ns / 1e9
            log.logger("tf2_ros").warning(
                f"The shared buffer {self.name!r} has room for the last {room_s:.1f} s of messages, but its "
                f"cache time is {keeps_s:g} s. Processes that attach to it get no older messages, and lose "
                "messages if they make no lookup for that long. Give this process a larger /dev/shm, up to "
                "1 GiB"
            )
        if new := too_long - self._warned_of_names:
            self._warned_of_names = too_long
            log.logger("tf2_ros").warning(
                f"The shared buffer {self.name!r} lacks {counted(new, 'transform')}: frame names that are "
                "longer than 100 kB are not shared"
            )


def _end(ring: RingWriter, path: Path, process: int) -> None:
    # A finalizer, so without LOCK: whoever holds that may wait for the thread in which this runs.
    if process == os.getpid():  # not in a forked child
        try:
            remove_name(path, ring.descriptor)
        finally:
            ring.close()


def publish(descriptor: int, name: str) -> None:
    """
    Give a file the name of a shared buffer, instead of the file of a dead owner.

    :raises SharedBufferError: another process owns a file of this name.
    :raises OSError: it cannot be named.
    """
    path = segment_path(name)
    while True:
        try:
            # Only with a folder given does Python let the system follow this link; the folder is not used.
            link = f"/proc/self/fd/{descriptor}"
            os.link(link, path, src_dir_fd=descriptor, follow_symlinks=True)
            return
        except FileExistsError:
            with suppress(FileNotFoundError), opened(path) as other:
                if is_owned(other):
                    process = read_description(other).process
                    text = f"the shared buffer {name!r} is owned by process {process}"
                    raise SharedBufferError(text) from None
                _lock(other, path)  # of all who find it, one removes it
                remove_name(path, other)


def _lock(descriptor: int, path: Path) -> None:
    # Until the descriptor is closed. Whoever looks at the file has a lock for a moment, and only then.
    until = time.monotonic() + LOCK_WAIT_S
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except BlockingIOError as error:
            if time.monotonic() > until:
                raise BlockingIOError(
                    error.errno, f"it is locked by {_lockers(descriptor)}", str(path)
                ) from None
        time.sleep(LOCK_WAIT_S / 100)


def _lockers(descriptor: int) -> str:
    """Which processes have locked a file, as far as this one can see them."""
    # In a line such as "1: FLOCK ADVISORY READ 4711 00:1a:1234 0 EOF", a file has its device in hexadecimal.
    status = os.fstat(descriptor)
    file = f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}:{status.st_ino}"
    lines = [line.split() for line in Path("/proc/locks").read_text().splitlines()]
    found = [line[4] for line in lines if line[1] == "FLOCK" and line[5] == file]
    return " and ".join(f"process {process}" for process in found) or "another process"


def is_owned(descriptor: int) -> bool:
    """Whether another open file description, in any process, has the owner's lock on a file."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    fcntl.flock(descriptor, fcntl.LOCK_UN)
    return False


@contextmanager
def opened(path: Path) -> Iterator[int]:
    """
    Open the file of a shared buffer; for a ``with`` statement, which gets a descriptor.

    :raises OSError: there is none, or it is not a regular file that only this user can write.
    """
    descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
    try:
        status = os.fstat(descriptor)
        if status.st_uid != os.geteuid():
            raise PermissionError(errno.EPERM, "it belongs to another user", str(path))
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "it is not a regular file", str(path))
        if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
            mode = f"{stat.S_IMODE(status.st_mode):04o}"
            raise PermissionError(errno.EPERM, f"other users may write to it; its mode is {mode}", str(path))
        yield descriptor
    finally:
        os.close(descriptor)


def remove_name(path: Path, descriptor: int) -> None:
    """Remove the name of a file, unless it is that of another one by now."""
    with suppress(FileNotFoundError):
        if os.path.samestat(os.stat(path, follow_symlinks=False), os.fstat(descriptor)):
            os.unlink(path)


@dataclass
class Description:
    """What readers must know about an owner."""

    process: int
    cache_time_ns: int
    domain: int | None  # of its listeners; None: it has none, or they are of several
    topics: list[str]  # that its listeners receive
    simulated: bool  # whether it follows simulated time


_FACTS = struct.Struct("=iqi?")  # of a Description: what precedes the topics


def write_description(ring: RingWriter, owner: Description) -> None:
    """Describe the owner of a ring in its file, without the last topics if there is no room for all."""
    domain = -1 if owner.domain is None else owner.domain
    data = _FACTS.pack(owner.process, owner.cache_time_ns, domain, owner.simulated)
    data += "\0".join(owner.topics).encode()
    ring.write(data.ljust(TEXT_BYTES, b"\0")[:TEXT_BYTES], TEXT_AT)


def read_description(descriptor: int) -> Description:
    """Read the description of the owner of a file, which may be any bytes."""
    data = os.pread(descriptor, TEXT_BYTES, TEXT_AT).ljust(_FACTS.size, b"\0")
    process, cache_time_ns, domain, simulated = _FACTS.unpack_from(data)
    topics = data[_FACTS.size :].decode(errors="replace").split("\0")
    return Description(process, max(0, cache_time_ns), None if domain < 0 else domain, topics, simulated)
