"""Owns the error of sharing a buffer on a system other than Linux."""

from typing import NoReturn

__all__ = ["attached_buffer", "shared_buffer"]


def shared_buffer(*arguments: object) -> NoReturn:
    """Raise a ``NotImplementedError``: buffers are shared on Linux alone."""
    raise NotImplementedError("buffers can be shared, and attached to, on Linux alone")


attached_buffer = shared_buffer
