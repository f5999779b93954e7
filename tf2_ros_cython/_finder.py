"""
Find our packages where the order of the path cannot decide: beside a workspace's fork, or in a checkout.

If the rclpy in use is one that tf2_ros was never tried with, the finder says once that it steps aside.
"""

import os
import sys

from tf2_ros_cython._installation import (
    HOME,
    NEWEST_RCLPY,
    OLDEST_RCLPY,
    PACKAGES,
    distribution_prefix,
    lies_in,
    refused_rclpy,
)

TYPE_CHECKING = False  # to type checkers it is True; `typing` is not imported for it
if TYPE_CHECKING:
    from collections.abc import Sequence
    from importlib.machinery import ModuleSpec, PathFinder
    from types import ModuleType


class Finder:
    """Finds our packages if the path leads to those of the ROS 2 distribution."""

    @staticmethod
    def find_spec(
        name: str, path: "Sequence[str] | None" = None, target: "ModuleType | None" = None
    ) -> "ModuleSpec | None":
        if name not in PACKAGES or not precedes(name):
            return None
        return _path_finder().find_spec(name, [HOME])


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
                if _is_too_old(refused_rclpy()):
                    return  # importing tf2_ros raises an error that says so
                used = "tf2-ros-cython is used, because there is no other tf2, but"
                warning = f"{used} {unknown_rclpy(is_used=True)}. TF2_ROS_CYTHON=1 ends this warning"
            else:
                used = "another tf2 is used, not tf2-ros-cython:"
                warning = f"{used} {unknown_rclpy()}. TF2_ROS_CYTHON=0 ends this warning"
            warnings.warn(warning, stacklevel=2)


def unknown_rclpy(*, is_used: bool = False) -> str:
    """Say why an rclpy is refused, and what to do if it is a new one; ``is_used``: ours is, nevertheless."""
    version = refused_rclpy() or "of an unknown version"
    text = f"this ROS 2 has rclpy {version}; this tf2-ros-cython supports {OLDEST_RCLPY} to {NEWEST_RCLPY}"
    if _is_too_old(version):
        return text
    attempt = "" if is_used else ", or try this one with TF2_ROS_CYTHON=1"
    return f"{text}. Install a newer tf2-ros-cython{attempt}"


def _is_too_old(version: str | None) -> bool:
    major = (version or "").partition(".")[0]
    return major.isdigit() and int(major) < OLDEST_RCLPY


def install(*, is_aside: bool = False) -> None:
    """Put the finder before Python's, once."""
    finder = Aside if is_aside else Finder
    if finder not in sys.meta_path:
        sys.meta_path.insert(0, finder)


def precedes(name: str) -> bool:
    """
    Whether ours takes precedence over the package ``name`` that the path offers.

    It does if that is the distribution's, and no layer below it is from a workspace: a workspace with a fork
    of one package keeps it, together with the distribution's packages that build on it.
    """
    prefix = distribution_prefix()
    if prefix is None or not lies_in(found_on_path(name), prefix):
        return False
    below = PACKAGES[: PACKAGES.index(name)]
    found = [found_on_path(package) for package in below]
    return all(folder in (None, HOME) or lies_in(folder, prefix) for folder in found)


def found_on_path(name: str) -> str | None:
    """The folder of the path that holds the package ``name``, or None."""
    spec = _path_finder().find_spec(name)
    if spec is None or not spec.submodule_search_locations:
        return None
    return os.path.dirname(os.path.abspath(next(iter(spec.submodule_search_locations))))


def _path_finder() -> "type[PathFinder]":
    from importlib.machinery import PathFinder

    return PathFinder
