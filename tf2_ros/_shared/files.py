"""
Make, open and remove the files of shared buffers, and read the descriptions of their owners.

A file gets its name when it is complete, so whoever finds it can read it. An owner holds a lock on its file.
The kernel releases it when the process ends, however that happens. The lock belongs to an open file
description (F_OFD_SETLK) that nothing is mapped from. So other descriptors of the file may be closed, and a
forked child, which closes its own at once, does not keep the lock.
"""

import errno
import fcntl
import json
import os
import stat
import struct
from contextlib import ExitStack, suppress
from dataclasses import astuple, dataclass, field, replace
from pathlib import Path

from tf2_ros._shared.naming import FOLDER, SharedBufferError, segment_path, segment_paths
from tf2_ros._shared.ring import read_text

__all__ = [
    "Description",
    "describe_owner",
    "is_owned",
    "make_file",
    "open_file",
    "publish",
    "remove_dead_files",
]

MOST_TEXT = 3000  # bytes of a description; a file has room for a little more

_FLOCK = "hhqqi4x"  # struct flock: type, whence, start, length, process
_OWNING, _REMOVING = 0, 1  # the bytes of a file that are locked


def make_file() -> tuple[int, int]:
    """
    Make a file that has no name yet, and lock it.

    :return: a descriptor of it, and one that holds its lock.
    :raises OSError: the file cannot be made.
    """
    descriptor = _above_streams(os.open(FOLDER, os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o600))
    try:
        locked = _above_streams(os.open(_own_path(descriptor), os.O_RDWR | os.O_CLOEXEC))
    except BaseException:
        os.close(descriptor)
        raise
    fcntl.fcntl(locked, fcntl.F_OFD_SETLK, _lock_of(_OWNING))
    return descriptor, locked


def publish(descriptor: int, path: Path) -> None:
    """
    Give a file its name.

    :raises BlockingIOError: another process owns a file of this name; ``args[0]`` is its id, or 0.
    :raises OSError: it cannot be named.
    """
    while True:
        try:
            # Only with a folder given does Python let the system follow this link; the folder is not used.
            os.link(_own_path(descriptor), path, src_dir_fd=descriptor, follow_symlinks=True)
            return
        except FileExistsError:
            with suppress(FileNotFoundError), ExitStack() as stack:
                other = _open(path)
                stack.callback(os.close, other)
                if not _remove_dead(path, other):
                    owner = describe_owner(other)
                    raise BlockingIOError(0 if owner is None else owner.process) from None


def open_file(name: str) -> int:
    """
    Open the file of a shared buffer. If its owner is dead, remove it.

    :return: a descriptor.
    :raises SharedBufferError: there is no file with an owner, or it cannot be opened.
    """
    path = segment_path(name)
    try:
        while True:
            with ExitStack() as stack:
                descriptor = _open(path)
                stack.callback(os.close, descriptor)
                if not _remove_dead(path, descriptor):
                    stack.pop_all()
                    return descriptor
    except FileNotFoundError:
        raise SharedBufferError(f"no process of this user shares a buffer {name!r}") from None
    except OSError as error:
        raise SharedBufferError(f"the shared buffer {name!r} cannot be read: {error}") from None


def remove_dead_files() -> None:
    """Remove the files of this user's dead owners; what cannot be removed stays."""
    for path in segment_paths():
        with suppress(OSError), ExitStack() as stack:
            # Opening another user's file may block: its owner may hold a lease on it.
            if path.lstat().st_uid == os.geteuid():
                descriptor = _open(path)
                stack.callback(os.close, descriptor)
                _remove_dead(path, descriptor)


def is_owned(descriptor: int) -> bool:
    """Whether another descriptor of a file, in any process, holds its lock."""
    answer = fcntl.fcntl(descriptor, fcntl.F_OFD_GETLK, _lock_of(_OWNING))
    return bool(struct.unpack(_FLOCK, answer)[0] != fcntl.F_UNLCK)


def _lock_of(byte: int) -> bytes:
    return struct.pack(_FLOCK, fcntl.F_WRLCK, os.SEEK_SET, byte, 1, 0)


def _own_path(descriptor: int) -> str:
    return f"/proc/self/fd/{descriptor}"


def _above_streams(descriptor: int) -> int:
    if descriptor > 2:
        return descriptor
    # If a standard stream is closed, its number is free, and log lines would be written to this file.
    try:
        return fcntl.fcntl(descriptor, fcntl.F_DUPFD_CLOEXEC, 3)
    finally:
        os.close(descriptor)


def _open(path: Path) -> int:
    descriptor = _above_streams(os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW))
    facts = os.fstat(descriptor)
    wrong = None
    if not stat.S_ISREG(facts.st_mode) or facts.st_uid != os.geteuid():
        wrong = "it is not this user's"
    elif facts.st_mode & 0o077:
        wrong = "other users may open it"
    if wrong is not None:
        os.close(descriptor)
        raise PermissionError(errno.EPERM, wrong)
    return descriptor


def _remove_dead(path: Path, descriptor: int) -> bool:
    """Remove a file, unless it has an owner, in which case the result is False."""
    if is_owned(descriptor):
        return False
    # Of all who find it, one removes it. The lock ends with the descriptor.
    fcntl.fcntl(descriptor, fcntl.F_OFD_SETLKW, _lock_of(_REMOVING))
    with suppress(FileNotFoundError):
        if os.path.samestat(os.stat(path, follow_symlinks=False), os.fstat(descriptor)):
            os.unlink(path)
    return True


@dataclass
class Description:
    """What readers must know about an owner."""

    process: int
    program: str
    cache_time_ns: int
    domain: int | None = None  # of its listener; None: it has none
    topics: list[str] = field(default_factory=list)  # that its listeners receive
    simulated: bool = False  # whether it follows simulated time

    def to_bytes(self) -> bytes:
        """Return it as JSON, without the last topics if there is no room for all."""
        topics = list(self.topics)
        while len(text := json.dumps(astuple(replace(self, topics=topics))).encode()) > MOST_TEXT and topics:
            topics.pop()
        return text


def describe_owner(descriptor: int) -> Description | None:
    """Read the description of a file's owner; None if it cannot be read."""
    try:
        process, program, cache_time_ns, domain, topics, simulated = json.loads(read_text(descriptor))
        return Description(
            int(process),
            str(program),
            int(cache_time_ns),
            None if domain is None else int(domain),
            [str(topic) for topic in topics],
            bool(simulated),
        )
    except (OverflowError, RecursionError, TypeError, ValueError):
        return None
