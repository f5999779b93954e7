# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The version of this installation, as the build recorded it."""

try:
    from tf2_ros_cython._built import VERSION as __version__
except ModuleNotFoundError:
    __version__ = "unknown"  # in a checkout that was not built

__all__ = ["__version__"]
