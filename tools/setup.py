# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""What pyproject.toml cannot express: files by which the tools of ROS find the package."""

from pathlib import Path

from setuptools import find_packages, setup

ROOT = Path(__file__).resolve().parent

# `colcon build --symlink-install` runs this file in a folder of its own, with links to the packages alone.
for name in ("pyproject.toml", "README.md", "LICENSE"):
    if not Path(name).exists():
        Path(name).symlink_to(ROOT / name)

setup(
    # Here for colcon's sake, as in the setup.py of tf2-ros-cython.
    python_requires=">=3.10",
    license="BSD-3-Clause",
    license_files=["LICENSE"],
    packages=find_packages(str(ROOT), include=["tf2_ros_tools*"]),
    package_data={"tf2_ros_tools": ["py.typed"]},
    include_package_data=False,
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/tf2_ros_tools"]),
        ("share/tf2_ros_tools", ["package.xml"]),
    ],
    zip_safe=False,
)
