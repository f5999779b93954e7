# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The table of the types of sensor_msgs: which function transforms which."""

from sensor_msgs import msg as sensor

from tf2_ros._registration import TransformFunctions
from tf2_sensor_msgs import _cloud, _imu_and_magnetometer

# A line here registers a type.
TYPES: TransformFunctions = {
    sensor.Imu: _imu_and_magnetometer.do_transform_imu,
    sensor.MagneticField: _imu_and_magnetometer.do_transform_magnetic_field,
    sensor.PointCloud2: _cloud.do_transform_cloud,
}
