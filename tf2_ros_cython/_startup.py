"""
Put our packages on the path: before the tf2 that they replace, and after a workspace's fork of it.

The startup files of the installation call this when Python starts. Type checkers and editors see a folder on
the path, and no finder.
"""

import os
import sys

from tf2_ros_cython._installation import HOME, PACKAGES, SITE, distribution_prefix, lies_in, refused_rclpy


def arrange() -> None:
    """Arrange the path of this process, unless ``TF2_ROS_CYTHON=0``."""
    prefix = distribution_prefix()
    if os.environ.get("TF2_ROS_CYTHON") == "0" or (prefix is None and HOME == SITE):
        return
    others = [entry for entry in sys.path if entry != HOME]
    at = next((i for i, entry in enumerate(others) if entry == SITE or lies_in(entry, prefix)), len(others))
    is_refused = refused_rclpy() is not None
    if HOME != SITE:
        # What builds on a workspace's fork must not be replaced, either; only a finder can tell.
        is_last = is_refused or _has_fork(others[:at])
        others.insert(len(others) if is_last else at, HOME)
        sys.path[:] = others
        if not is_last:
            return
    from tf2_ros_cython import _finder

    _finder.install(is_aside=is_refused)


def _has_fork(entries: "list[str]") -> bool:
    return any(os.path.isdir(os.path.join(entry, name)) for entry in entries for name in PACKAGES)
