# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import Imu, MagneticField

def do_transform_imu(imu: Imu, transform: TransformStamped) -> Imu: ...
def do_transform_magnetic_field(
    magnetic_field: MagneticField, transform: TransformStamped
) -> MagneticField: ...
