# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
What tf2_ros, tf2_geometry_msgs and tf2_sensor_msgs cimport from the core and the engine. This is not a
public interface and may change at any time. They cimport nothing else from this package, so that its modules
can be moved.
"""

# The core, and locks that are free in a forked child; then the engine, and messages.
from tf2_py._core cimport *
from tf2_py._tf2_py cimport *
