"""
Make, open and remove the files of shared buffers, and read the descriptions of their owners.

A file gets its name when it is complete, so a process that finds it can read it. An owner locks its file.
The kernel releases it when the process ends, however that happens. The lock belongs to an open file
description (F_OFD_SETLK) that nothing is mapped from. So other descriptors of the file may be closed, and a
forked child, which closes its own at once, does not keep the lock.
"""

import errno
import fcntl
import os
import stat
import struct
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from pathlib import Path

from tf2_ros._shared.naming import FOLDER, SharedBufferError, segment_path
from tf2_ros._shared.ring import read_text

MOST_TEXT = 3000  # bytes of the topics in a description; a file has room for a little more

_FLOCK = "hhqqi4x"  # struct flock: type, whence, start, length, process
_OWNING, _REMOVING = 0, 1  # the bytes of a file that are locked


def make_file() -> tuple[int, int]:
    """
    Make a file that has no name yet, and lock it.

    :return: a descriptor of it, and one that holds its lock.
    :raises OSError: the file cannot be made.
    """
    descriptor = os.open(FOLDER, os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o600)
    try:
        locked = os.open(_own_path(descriptor), os.O_RDWR | os.O_CLOEXEC)
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
                    raise BlockingIOError(describe_owner(other).process) from None


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


def is_owned(descriptor: int) -> bool:
    """Whether another descriptor of a file, in any process, holds its lock."""
    answer = fcntl.fcntl(descriptor, fcntl.F_OFD_GETLK, _lock_of(_OWNING))
    return bool(struct.unpack(_FLOCK, answer)[0] != fcntl.F_UNLCK)


def _lock_of(byte: int) -> bytes:
    return struct.pack(_FLOCK, fcntl.F_WRLCK, os.SEEK_SET, byte, 1, 0)


def _own_path(descriptor: int) -> str:
    return f"/proc/self/fd/{descriptor}"


def _open(path: Path) -> int:
    descriptor = os.open(path, os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW)
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


_FACTS = struct.Struct("=iqi?")  # of a Description: what precedes the topics
_UNREADABLE = _FACTS.pack(0, 10 * 10**9, -1, False)


@dataclass
class Description:
    """What readers must know about an owner."""

    process: int  # 0: unknown
    cache_time_ns: int
    domain: int | None = None  # of its listeners; None: it has none, or they are of several
    topics: list[str] = field(default_factory=list)  # that its listeners receive
    simulated: bool = False  # whether it follows simulated time

    def to_bytes(self) -> bytes:
        """Return what :func:`describe_owner` reads, without the last topics if there is no room for all."""
        domain = -1 if self.domain is None else self.domain
        facts = _FACTS.pack(self.process, self.cache_time_ns, domain, self.simulated)
        return facts + "\0".join(self.topics).encode()[:MOST_TEXT]


def describe_owner(descriptor: int) -> Description:
    """Read the description of a file's owner; if it cannot be read, nothing is known about it."""
    data = read_text(descriptor)
    process, cache_time_ns, domain, simulated = _FACTS.unpack_from(
        data if len(data) >= _FACTS.size else _UNREADABLE
    )
    topics = data[_FACTS.size :].decode(errors="replace").split("\0")
    return Description(process, max(0, cache_time_ns), None if domain < 0 else domain, topics, simulated)
