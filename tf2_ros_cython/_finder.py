# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Find our packages where they have no folder of their own on the path: in a checkout.

If the rclpy in use is one that tf2_ros was never tried with, the finder says once that it steps aside.
"""

import os
import sys

from tf2_ros_cython._installation import (
    HOME,
    PACKAGES,
    distribution_prefix,
    is_too_old,
    lies_in,
    refused_rclpy,
    unknown_rclpy,
)

TYPE_CHECKING = False  # to type checkers it is True; `typing` is not imported for it
if TYPE_CHECKING:
    from collections.abc import Sequence
    from importlib.machinery import ModuleSpec, PathFinder
    from types import ModuleType


class Finder:
    """Finds our packages if the path leads to those of the ROS 2 distribution."""

    precedes: bool | None = None  # all four or none, because they are not mixed with others; None: not asked

    @classmethod
    def find_spec(
        cls, name: str, path: "Sequence[str] | None" = None, target: "ModuleType | None" = None
    ) -> "ModuleSpec | None":
        if name not in PACKAGES:
            return None
        if cls.precedes is None:
            cls.precedes = not any(map(_is_of_workspace, PACKAGES))
        return _path_finder().find_spec(name, [HOME]) if cls.precedes else None


class Aside:
    """Finds nothing, and once warns of what the path leads to."""

    has_warned = False

    @classmethod
    def find_spec(
        cls, name: str, path: "Sequence[str] | None" = None, target: "ModuleType | None" = None
    ) -> None:
        if name in PACKAGES and not cls.has_warned:
            cls.has_warned = True
            import warnings

            if found_on_path(name) == HOME:
                if is_too_old(refused_rclpy()):
                    return  # importing tf2_ros raises an error that says so
                used = "tf2-ros-cython is used, because there is no other tf2, but"
                warning = f"{used} {unknown_rclpy(is_used=True)}. TF2_ROS_CYTHON=1 ends this warning"
            else:
                used = "another tf2 is used, not tf2-ros-cython:"
                warning = f"{used} {unknown_rclpy()}. TF2_ROS_CYTHON=0 ends this warning"
            warnings.warn(warning, stacklevel=2)


def install(*, is_aside: bool = False) -> None:
    """Put the finder before Python's, once."""
    finder = Aside if is_aside else Finder
    if finder not in sys.meta_path:
        sys.meta_path.insert(0, finder)


def _is_of_workspace(name: str) -> bool:
    folder = found_on_path(name)
    return folder not in (None, HOME) and not lies_in(folder, distribution_prefix())


def found_on_path(name: str) -> str | None:
    """The folder of the path that holds the package ``name``, or None."""
    spec = _path_finder().find_spec(name)
    if spec is None or not spec.submodule_search_locations:
        return None
    return os.path.dirname(os.path.abspath(next(iter(spec.submodule_search_locations))))


def _path_finder() -> "type[PathFinder]":
    from importlib.machinery import PathFinder

    return PathFinder
