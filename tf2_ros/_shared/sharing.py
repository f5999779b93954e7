"""Owns the making of buffers that are shared or attached."""

from typing import Any, TypeAlias

from tf2_ros._shared.following import Follower, attach, open_segment
from tf2_ros._shared.names import buffer_name
from tf2_ros._shared.owning import Owner

__all__ = ["Sharing", "attached_buffer", "shared_buffer"]

Sharing: TypeAlias = Owner | Follower


def shared_buffer(buffer: Any, name: str, node: Any) -> Owner:
    """Share a buffer; see ``Buffer``. ``node``: of the ROS domain that ``auto`` belongs to, or None."""
    return Owner(buffer, buffer_name(name, _domain(node)))


def attached_buffer(buffer: Any, name: str, node: Any) -> Follower:
    """Attach a buffer; see ``Buffer``, and above."""
    name = buffer_name(name, _domain(node))
    return attach(buffer, open_segment(name), name)


def _domain(node: Any) -> int | None:
    domain: int | None = None if node is None else node.context.get_domain_id()
    return domain
