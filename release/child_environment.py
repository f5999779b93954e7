# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Give another Python a clean environment."""

import os


def environment_of_children(**variables):
    """
    This environment with these variables, for another Python.

    A Python that has the ROS wheels leaves a mark and its own library path to its children. One of another
    environment would take the mark for its own and not find its libraries.
    """
    environment = {**os.environ, **variables}
    if environment.pop("_ROS_WHEELS_BOOTSTRAP_COMPLETE", None):
        environment.pop("LD_LIBRARY_PATH", None)
    return environment
