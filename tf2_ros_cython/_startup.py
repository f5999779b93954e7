# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Put our packages on the path, before the tf2 that they replace, unless a workspace has one of them of its own.

The .pth file of the installation calls this when Python starts. Type checkers and editors see a folder on
the path, and no finder.
"""

import os
import sys

from tf2_ros_cython._installation import (
    HOME,
    PACKAGES,
    SITE,
    distribution_prefix,
    is_switched_off,
    is_waiting,
    lies_in,
    refused_rclpy,
)


def arrange() -> None:
    """Arrange the path of this process, unless ``TF2_ROS_CYTHON=0`` or ours wait for another value."""
    prefix = distribution_prefix()
    if is_switched_off() or is_waiting() or (prefix is None and HOME == SITE):
        return
    others = [entry for entry in sys.path if entry != HOME]
    at = next((i for i, entry in enumerate(others) if entry == SITE or lies_in(entry, prefix)), len(others))
    is_refused = refused_rclpy() is not None
    if HOME != SITE:
        if is_refused:
            others.append(HOME)
        elif not _has_fork(others[:at]):
            others.insert(at, HOME)
        sys.path[:] = others
        if not is_refused:
            return
    from tf2_ros_cython import _finder

    _finder.install(is_aside=is_refused)


def _has_fork(entries: "list[str]") -> bool:
    # Python passes over a folder without this file, such as one of sources.
    found = (os.path.join(entry, name, "__init__.py") for entry in entries for name in PACKAGES)
    return any(map(os.path.isfile, found))
