"""Owns the manners in which programs write files."""

from tf2_ros import _whole_files
from tf2_ros_cython.cli._program import RunError, deferred_signals

__all__ = ["write_whole"]


def write_whole(path: str, data: bytes) -> None:
    """
    Write a file in one step: who opens it finds what was there before, or all of the new.

    :raises RunError: it cannot be written; what was there before stays.
    """
    with deferred_signals():
        try:
            _whole_files.write_whole(path, data)
        except OSError as failure:
            raise RunError(f"cannot write {path}: {failure.strerror}") from None
