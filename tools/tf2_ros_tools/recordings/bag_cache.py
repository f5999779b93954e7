# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Keep the transforms of recordings in frozen files, which all processes map: the argument ``cache``."""

from __future__ import annotations

import hashlib
import json
import os
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tf2_py import __version__
from tf2_ros_tools.recordings.bag_reader import FROZEN, LOGS, SUFFIXES, logs_of, require_existing

if TYPE_CHECKING:
    from tf2_ros import Buffer

UNFINISHED = ".unfinished"  # of a file that `whole_file` has not completed
SHARED_MEMORY = "-shm"  # of SQLite, next to a database that is open
LIMITS = ("TF2_ROS_CYTHON_MAX_FRAMES", "TF2_ROS_CYTHON_MAX_BYTES")  # of a buffer, by variables


def state_of(recording: str) -> list[list[Any]]:
    """
    Get what changes when the contents of a recording change; JSON can hold it.

    For each file, these are its name, its size, and when it and its inode were changed. An archive can
    restore the size and the time of a file, but no program can set the time at which the inode was changed.
    Frozen and unfinished files are left out, so that the folder of a recording may be that of its frozen
    file.
    """
    path = Path(recording)
    if not path.is_dir():
        return [_state_of_file(path), *_states_of([*logs_of(path)])]
    left_out = (FROZEN, UNFINISHED, SHARED_MEMORY, *LOGS)
    files = sorted(one for one in path.iterdir() if one.is_file() and not one.name.endswith(left_out))
    return _states_of([*files, *(log for one in files for log in logs_of(one))])


def _states_of(files: list[Path]) -> list[list[Any]]:
    states = []
    for one in files:
        with suppress(FileNotFoundError):  # logs are merged, and other programs use the folder, too
            states.append(_state_of_file(one))
    return states


def _state_of_file(path: Path) -> list[Any]:
    facts = os.stat(path)
    return [path.name, facts.st_size, facts.st_mtime_ns, facts.st_ctime_ns]


class Cached:
    """
    The file in a folder for what is wanted of a recording; its name changes with both.

    :param what: what is wanted, with keys and values that JSON can hold.
    :raises FileNotFoundError: the recording does not exist.
    :raises ValueError: ``folder`` is empty.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        recording: str | os.PathLike[str],
        what: dict[str, Any],
        cache_time_ns: int,
    ) -> None:
        require_existing(Path(recording))
        if not folder:
            raise ValueError("cache: expected a folder, got ''")
        self._recording, self._real = recording, os.path.realpath(recording)
        path = self._real
        self._state = state_of(path)
        name = os.path.basename(path)
        stem = name.rpartition(".")[0] if name.endswith(SUFFIXES) else name
        # What a version makes of a recording may differ from what the next one does, and so may the limits.
        limits = [os.environ.get(name) for name in LIMITS]
        request = _digest([os.fsencode(path).hex(), what, cache_time_ns, limits, __version__])
        # A name has at most 255 bytes.
        self._begin = f"{stem[:50]}-{request}-"
        self._folder = os.path.abspath(os.fsdecode(folder))
        self.path = os.path.join(self._folder, f"{self._begin}{_digest(self._state)}{FROZEN}")

    def open(self) -> Buffer | None:
        """Open the file; None if there is none, or none that this user and this version can read."""
        from tf2_ros import Buffer

        try:
            return Buffer.open(self.path)
        except (FileNotFoundError, PermissionError, ValueError):
            return None

    def write(self, buffer: Buffer) -> None:
        """
        Write the file, unless the recording was changed or replaced meanwhile. Delete the files of earlier
        states of the recording, if this user may; who uses these keeps them.
        """
        if not self._is_unchanged():
            return
        os.makedirs(self._folder, exist_ok=True)
        buffer.freeze(self.path)
        earlier = []
        with suppress(OSError):  # this user may not list the folder
            earlier = [one for one in os.listdir(self._folder) if one.startswith(self._begin)]
        for one in earlier:
            if one != os.path.basename(self.path):
                with suppress(OSError):
                    os.unlink(os.path.join(self._folder, one))

    def _is_unchanged(self) -> bool:
        with suppress(FileNotFoundError):
            return os.path.realpath(self._recording) == self._real and state_of(self._real) == self._state
        return False


def _digest(content: Any) -> str:
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()[:16]
