# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Which frozen file a buffer was opened from."""

import os
from contextlib import suppress
from stat import S_IMODE, S_ISREG
from typing import IO, Any, NamedTuple, TypeAlias

Path: TypeAlias = str | bytes | os.PathLike[str]

_WRITE = 0o222


class FrozenFile(NamedTuple):
    """
    A frozen file, as it was when it was opened.

    :param path: absolute.
    :param checksum: of its index, which has that of all samples.
    :param size: bytes.
    :param modified_ns: when it was last written.
    :param device: with ``inode``, which file of this machine it is.
    """

    path: str
    checksum: int
    size: int
    modified_ns: int
    device: int = 0
    inode: int = 0

    def is_there(self) -> bool:
        """Whether its path still leads to it, unchanged."""
        try:
            now = os.stat(self.path)
        except OSError:
            return False
        return self[2:] == (now.st_size, now.st_mtime_ns, now.st_dev, now.st_ino)

    def as_state(self) -> dict[str, Any]:
        """Get the state of a buffer that holds what the file holds."""
        return {"frozen": tuple(self[:4])}


def from_state(state: dict[str, Any]) -> tuple[Path, FrozenFile | None]:
    """
    Get the path of such a state, and which file is expected. A state with a path alone, without the numbers,
    is that of a buffer that holds whatever the file holds.

    :raises ValueError: its ``"frozen"`` is neither.
    """
    match state["frozen"]:
        case (path,):
            return path, None
        case (str() as path, int() as checksum, int() as size, int() as modified_ns):
            return path, FrozenFile(path, checksum, size, modified_ns)
    raise ValueError('this is not the state of a buffer: "frozen" must be a path and three numbers')


def protect(file: IO[bytes]) -> None:
    """Make a file that is open for writing read-only, if it is a regular file and has permissions."""
    mode = os.fstat(file.fileno()).st_mode
    if S_ISREG(mode):
        with suppress(PermissionError):
            os.fchmod(file.fileno(), S_IMODE(mode) & ~_WRITE)
