"""Owns the error of sharing a buffer on a system other than Linux."""

from typing import NoReturn

__all__ = ["attach_listener", "attached_buffer", "detach_listener", "shared_buffer"]


def shared_buffer(*arguments: object) -> NoReturn:
    """Raise a ``NotImplementedError``: buffers are shared on Linux alone."""
    raise NotImplementedError("buffers can be shared, and attached to, on Linux alone")


attached_buffer = shared_buffer


def attach_listener(*arguments: object) -> None:
    """There is nothing to attach to."""


detach_listener = attach_listener
