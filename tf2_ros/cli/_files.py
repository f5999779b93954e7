"""Owns writing files so that nobody sees half of one."""

import os
from contextlib import suppress

from tf2_ros_cython.cli._program import RunError, deferred_signals

__all__ = ["write_whole"]


def write_whole(path: str, data: bytes) -> None:
    """
    Write a file in one step: who opens it finds what was there before, or all of the new.

    :raises RunError: it cannot be written; what was there before stays.
    """
    path = os.path.realpath(path)  # a link stays one
    folder, name = os.path.split(path)
    unfinished = os.path.join(folder, f".{name}.{os.getpid()}")
    with deferred_signals():
        try:
            try:
                with open(unfinished, "wb") as file:
                    file.write(data)
                os.replace(unfinished, path)
            except BaseException:
                with suppress(FileNotFoundError):
                    os.unlink(unfinished)
                raise
        except OSError as failure:
            raise RunError(f"cannot write {path}: {failure.strerror}") from None
