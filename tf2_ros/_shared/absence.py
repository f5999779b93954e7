"""Owns what says that buffers cannot be shared here: it takes Linux."""

from typing import NoReturn

__all__ = ["attached_buffer", "shared_buffer"]


def shared_buffer(*arguments: object) -> NoReturn:
    """Buffers are shared on Linux alone."""
    raise NotImplementedError("buffers can be shared, and attached to, on Linux alone")


attached_buffer = shared_buffer
