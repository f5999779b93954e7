"""Owns what a broadcaster does with transforms that every listener would refuse, or that are none."""

from collections.abc import Iterable

from geometry_msgs.msg import TransformStamped
from rclpy.logging import get_logger

from tf2_py._internal import MalformedObjectError, raise_refused

__all__ = ["RefusedTransforms", "require_transforms"]

MOST_WARNINGS = 100


class RefusedTransforms:
    """
    Raises, or warns once for each child frame, about transforms that every listener would refuse.

    :param strict: raise.
    """

    def __init__(self, strict: bool) -> None:
        self._strict = strict
        self._warned: set[str] = set()

    def before_sending(self, transforms: list[TransformStamped]) -> None:
        """Raise a ValueError about one that would be refused, if this is strict."""
        if self._strict:
            require_transforms(transforms)
            raise_refused(transforms)

    def after_sending(self, refused: Iterable[tuple[str, str]]) -> None:
        """Warn about those that were sent for nothing: pairs of a ``child_frame_id`` and the reason."""
        if self._strict:
            return
        for child, why in refused:
            if child not in self._warned and len(self._warned) < MOST_WARNINGS:
                self._warned.add(child)
                get_logger("tf2_ros").warning(f"Sent all the same (strict=True would raise): {why}")


def require_transforms(transforms: list[TransformStamped]) -> None:
    """Raise a TypeError, which is also an AttributeError as in tf2, where one is something else."""
    for one in transforms:
        if not isinstance(one, TransformStamped):
            raise MalformedObjectError(
                f"sendTransform takes a TransformStamped, or several, not {type(one).__name__}"
            )
