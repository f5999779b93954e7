"""Owns the making of buffers that are shared or attached."""

from typing import Any, TypeAlias

from tf2_ros._shared.following import Follower, attach, open_segment
from tf2_ros._shared.names import SharedBufferError, buffer_name
from tf2_ros._shared.owning import Owner

__all__ = ["SharedBufferError", "Sharing", "attached_buffer", "shared_buffer"]

Sharing: TypeAlias = Owner | Follower


def shared_buffer(buffer: Any, name: str) -> Owner:
    """Share a buffer; see ``Buffer``."""
    return Owner(buffer, name)


def attached_buffer(buffer: Any, name: str, share: str | None) -> Follower:
    """Attach a buffer; see ``Buffer``, also for ``share``, which must be None."""
    if share is not None:
        raise ValueError("a buffer either shares what it holds, or is attached to one that does")
    name = buffer_name(name)
    return attach(buffer, open_segment(name), name)
