# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Replace files in one step, so that readers find either the old or the new one, whole."""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO

__all__ = ["whole_file"]


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """
    Open a file for writing under another name beside ``path``, and rename it to ``path`` on success.

    The other name begins with a dot and ends with ``.unfinished``. A pipe or a device at ``path`` is opened
    directly, because a file could not replace it.

    :raises OSError: it cannot be written. As after any other error, the previous file stays.
    """
    target = os.path.realpath(os.fsdecode(path))  # a link stays one
    # Unlike a process id, this is unique even if machines share a folder. `path` may have the longest name.
    unfinished = os.path.join(os.path.dirname(target), f".{uuid.uuid4().hex}.unfinished")
    try:
        if _is_special(path):
            with open(path, "wb") as file:
                yield file
            return
        try:
            with open(unfinished, "wb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())  # otherwise a power cut may leave an empty file of that name
            os.replace(unfinished, target)
        except BaseException:
            with suppress(FileNotFoundError):
                os.unlink(unfinished)
            raise
    except OSError as error:
        if error.errno is None or error.filename not in (None, unfinished):
            raise
        raise OSError(error.errno, error.strerror, os.fspath(path)) from None


def _is_special(path: str | os.PathLike[str]) -> bool:
    return os.path.exists(path) and not (os.path.isfile(path) or os.path.isdir(path))
