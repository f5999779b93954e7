# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry, Path

def do_transform_odometry(odometry: Odometry, transform: TransformStamped) -> Odometry: ...
def do_transform_path(path: Path, transform: TransformStamped) -> Path: ...
