# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Commands, recordings and pictures of transforms. They use only public names of ``tf2_ros`` and ``tf2_py``.

Users import ``tf2_ros_tools.bag``, ``tf2_ros_tools.live`` and ``tf2_ros_tools.urdf``. They start the programs
by name, or with ``python -m tf2_ros_tools.programs.<name>``. The other folders are private.
"""

__all__: list[str] = []
