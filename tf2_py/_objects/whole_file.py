"""Owns writing a file so that nobody sees half of it."""

import os
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import IO

__all__ = ["UNFINISHED", "whole_file"]

UNFINISHED = ".unfinished"  # how the name of a file ends that is not whole yet; it begins with a dot


@contextmanager
def whole_file(path: str | os.PathLike[str]) -> Iterator[IO[bytes]]:
    """
    Open a file for writing under another name beside it, which becomes ``path`` where all went well.

    What is no file, such as a pipe or a device, is written to as it is: another one could not replace it.

    :raises OSError: it cannot be written. As with any other error, what was there before stays.
    """
    target = os.path.realpath(os.fsdecode(path))  # a link stays one
    # Unlike a process id, this is not taken twice where machines share a folder. The name may be the longest.
    unfinished = os.path.join(os.path.dirname(target), f".{uuid.uuid4().hex}{UNFINISHED}")
    try:
        if _is_special(path):
            with open(path, "wb") as file:
                yield file
            return
        try:
            with open(unfinished, "wb") as file:
                yield file
                file.flush()
                os.fsync(file.fileno())  # or a power cut may leave an empty file of that name
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
