# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Find the ROS 2 to build for, and where it is installed."""

import importlib.metadata
import os
import re
import sys
from pathlib import Path

# One wheel stands for all: the files it installed tell the prefix that holds share/, include/ and lib/.
_LANDMARK = "ros-geometry-msgs"

# The releases on PyPI, with the first number of their rclpy; the default first.
RCLPY_OF = {"jazzy": 7, "kilted": 9}

# What one hook of the build tells setup.py, which the others run.
_VARIABLE = "_TF2_MSGS_RELEASE"
# In a source distribution, the release that it is for.
_CHOSEN = Path("release.txt")


def choose(config_settings):
    """Heed ``-C ros=...`` of pip, the release to build for, and let setup.py know it."""
    chosen = (config_settings or {}).get("ros")
    if chosen is not None and chosen not in RCLPY_OF:
        raise SystemExit(
            f"tf2_msgs knows no -C ros={chosen}: give one of {', '.join(RCLPY_OF)};"
            " without ROS 2 tf2_msgs is not needed"
        )
    if chosen is not None:
        os.environ[_VARIABLE] = chosen


def release():
    """
    The ROS release to build for.

    Whoever installs into an environment that has the wheels of one release is taken to mean that one.
    """
    if os.environ.get(_VARIABLE) in RCLPY_OF:
        return os.environ[_VARIABLE]
    if _CHOSEN.is_file():
        return _CHOSEN.read_text(encoding="utf-8").strip()
    # Build isolation hides the packages of the environment to install into, and not its folder.
    version = rclpy_version(Path(sys.prefix))
    names = [name for name, major in RCLPY_OF.items() if version and version.startswith(f"{major}.")]
    return names[0] if names else next(iter(RCLPY_OF))


def ros_wheels():
    """The wheels to build with, which hold the generators, too."""
    return [f"ros-{release()}-rclpy[fastrtps]", f"ros-{release()}-common-interfaces"]


def type_support():
    """The minor version of the type support on which messages are built."""
    return ".".join(_version(ros_prefix(), "rosidl_typesupport_fastrtps_c").split(".")[:2])


def rclpy_version(prefix):
    """The version of the prefix's rclpy, or None."""
    return _version(prefix, "rclpy")


def _version(prefix, package):
    manifest = prefix / "share" / package / "package.xml"
    if not manifest.is_file():
        return None
    # Of any encoding: the version is ASCII.
    found = re.search(r"<version>\s*([\d.]+)", manifest.read_text(encoding="latin-1"))
    return found.group(1) if found else None


def ros_prefix():
    """Where the wheels lie: under build isolation that is not ``sys.prefix``."""
    # All answers: the finder by which pip finds a build backend answers any name with the project itself.
    for found in importlib.metadata.distributions(name=_LANDMARK):
        for file in found.files or []:
            if file.parts[-3:] == ("share", "geometry_msgs", "package.xml"):
                prefix = Path(file.locate()).resolve().parents[2]
                version = rclpy_version(prefix) or ""
                if version.startswith(f"{RCLPY_OF[release()]}."):
                    return prefix
                raise SystemExit(f"tf2_msgs is to be built for {release()}, and here is rclpy {version}")
    wheels = " ".join(f"'{name}'" for name in ros_wheels())
    raise SystemExit(
        "tf2_msgs found no ROS 2 to be built with: build it with isolation (plain `pip install`),"
        f" or first: pip install {wheels}"
    )


def share_directory(package, prefix):
    """``share/<package>`` of the prefix."""
    if (prefix / "share" / package).is_dir():
        return prefix / "share" / package
    raise SystemExit(f"tf2_msgs needs {package}, which the ROS 2 in {prefix} lacks: install it there")


def refuse_sourced(environ=os.environ):
    """End the build beside a sourced ROS 2: what is made from wheels is not for it."""
    for prefix in environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        if prefix and Path(prefix, "share", "ament_index", "resource_index", "packages", "rclpy").is_file():
            raise SystemExit(
                f"tf2_msgs is not built here, for a ROS 2 is sourced ({prefix}), whose own is used: where it"
                " lacks tf2_msgs, install that there, on Ubuntu by apt install ros-$ROS_DISTRO-tf2-msgs"
            )
