"""Owns writing files so that nobody sees half of one."""

import os
import time
from contextlib import suppress

from tf2_py._internal import UNFINISHED, whole_file

__all__ = ["remove_abandoned", "write_whole"]

# Writing takes seconds: a file that has not grown for so long will not be finished.
ABANDONED_S = 3600.0


def write_whole(path: str | os.PathLike[str], data: bytes | memoryview) -> None:
    """
    Write a file in one step: who opens it finds what was there before, or all of the new.

    :raises OSError: it cannot be written; what was there before stays.
    """
    with whole_file(path) as file:
        file.write(data)


def remove_abandoned(folder: str | os.PathLike[str]) -> None:
    """Remove what writers that were killed have left in a folder, and nothing of those that are at work."""
    for one in os.scandir(folder):
        if one.name.startswith(".") and one.name.endswith(UNFINISHED):
            with suppress(FileNotFoundError):
                if time.time() - one.stat().st_mtime > ABANDONED_S:
                    os.unlink(one.path)
