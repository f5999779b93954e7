# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Where this installation and a ROS 2 distribution lie, and whether they fit together.

Python reads this when it starts, so it imports only what Python has already loaded.
"""

import os
import sys

TYPE_CHECKING = False  # to type checkers it is True; `typing` is not imported for it
if TYPE_CHECKING:
    from collections.abc import Mapping

# In the order of their layers: each of ours builds on ours of the layers before it.
PACKAGES = ("tf2_py", "tf2_ros", "tf2_geometry_msgs", "tf2_sensor_msgs")

# The folder into which this installation was put, beside all other packages.
SITE = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
# Ours have a folder of their own. In a checkout, they have not.
PARTS = ("tf2_ros_cython", "packages")
FOLDER = os.path.join(SITE, *PARTS)
HOME = FOLDER if os.path.isdir(FOLDER) else SITE

# Where a distribution has installed this, the build leaves this file, and ours wait for ``TF2_ROS_CYTHON=1``.
IS_OPT_IN = os.path.isfile(os.path.join(SITE, "tf2_ros_cython", "opt_in"))

# The rclpy that tf2_ros works with, by the first number of its version: of Humble, and of Rolling today.
OLDEST_RCLPY, NEWEST_RCLPY = 3, 11

_RCLPY_MARKER = os.path.join("share", "ament_index", "resource_index", "packages", "rclpy")


def is_switched_off(environ: "Mapping[str, str]" = os.environ) -> bool:
    """Whether ``TF2_ROS_CYTHON=0`` asks for another tf2."""
    return environ.get("TF2_ROS_CYTHON") == "0"


def is_waiting(environ: "Mapping[str, str]" = os.environ) -> bool:
    """Whether ours wait for ``TF2_ROS_CYTHON=1``."""
    return IS_OPT_IN and environ.get("TF2_ROS_CYTHON") != "1"


def refused_rclpy(environ: "Mapping[str, str]" = os.environ) -> str | None:
    """
    The version of the rclpy in use, if it is one that tf2_ros was never tried with; otherwise None.

    ``TF2_ROS_CYTHON=1`` tries it.
    """
    if environ.get("TF2_ROS_CYTHON") == "1":
        return None
    for prefix in filter(None, (*environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix)):
        try:
            # Of any encoding: the version is ASCII.
            with open(os.path.join(prefix, "share", "rclpy", "package.xml"), encoding="latin-1") as file:
                version = file.read().partition("<version>")[2].partition("<")[0].strip()
        except OSError:
            continue
        major = version.partition(".")[0]
        is_known = major.isdigit() and OLDEST_RCLPY <= int(major) <= NEWEST_RCLPY
        return None if is_known else version
    return None


def unknown_rclpy(*, is_used: bool = False) -> str:
    """Say why an rclpy is refused, and what to do if it is a new one; ``is_used``: ours is, nevertheless."""
    version = refused_rclpy() or "of an unknown version"
    text = f"this ROS 2 has rclpy {version}; this tf2-ros-cython supports {OLDEST_RCLPY} to {NEWEST_RCLPY}"
    if is_too_old(version):
        return text
    attempt = "" if is_used else ", or try this one with TF2_ROS_CYTHON=1"
    return f"{text}. Install a newer tf2-ros-cython{attempt}"


def is_too_old(version: str | None) -> bool:
    """Whether it is older than Humble's."""
    major = (version or "").partition(".")[0]
    return major.isdigit() and int(major) < OLDEST_RCLPY


def distribution_prefix(environ: "Mapping[str, str]" = os.environ) -> str | None:
    """
    The folder in which the ROS 2 distribution is installed: the lowest one that holds rclpy.

    So a workspace above it with an rclpy of its own still counts as a workspace. A distribution built with
    colcon may have a folder for each package; then this is the folder that contains them.
    """
    for prefix in reversed(environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)):
        if prefix and os.path.isfile(os.path.join(prefix, _RCLPY_MARKER)):
            parent = os.path.dirname(os.path.abspath(prefix))
            return parent if _is_isolated(parent) else os.path.abspath(prefix)
    return None


def _is_isolated(folder: str) -> bool:
    try:
        with open(os.path.join(folder, ".colcon_install_layout"), encoding="latin-1") as file:
            return file.read().strip() == "isolated"
    except OSError:
        return False


def lies_in(folder: str | None, prefix: str | None) -> bool:
    """Whether a folder is below a prefix."""
    if folder is None or prefix is None:
        return False
    return os.path.realpath(folder).startswith(os.path.join(os.path.realpath(prefix), ""))
