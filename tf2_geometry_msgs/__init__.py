# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Transform messages of geometry_msgs and nav_msgs from frame to frame."""

import tf2_ros_cython._ros_requirement  # noqa: F401

from contextlib import suppress

# Public programs take message classes from here, too.
from geometry_msgs.msg import Quaternion as Quaternion
from geometry_msgs.msg import QuaternionStamped as QuaternionStamped
from geometry_msgs.msg import Transform as Transform
from geometry_msgs.msg import Vector3 as Vector3
from geometry_msgs.msg import WrenchStamped as WrenchStamped

from tf2_geometry_msgs import tf2_geometry_msgs
from tf2_geometry_msgs._geometry import *  # noqa: F403  with what tf2 lacks, which stays outside __all__
from tf2_geometry_msgs._roll_pitch_yaw import quaternion_from_rpy as quaternion_from_rpy
from tf2_geometry_msgs._roll_pitch_yaw import rpy_from_quaternion as rpy_from_quaternion
from tf2_geometry_msgs.tf2_geometry_msgs import *  # noqa: F403

with suppress(ModuleNotFoundError):  # of nav_msgs
    from tf2_geometry_msgs._nav import *  # noqa: F403

__all__ = ["tf2_geometry_msgs"]
__all__ += tf2_geometry_msgs.__all__
