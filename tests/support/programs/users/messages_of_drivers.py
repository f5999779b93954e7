# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages as some drivers send them: a rotation of zeros, clouds of integers, padded, without a row_step."""

from array import array

import numpy as np
from geometry_msgs.msg import (
    PointStamped,
    Quaternion,
    Transform,
    TransformStamped,
)
from sensor_msgs.msg import PointCloud2, PointField

import tf2_geometry_msgs
from tf2_sensor_msgs import do_transform_cloud


def cloud(points, datatype, step):
    fields = [
        PointField(name=name, offset=i * points.itemsize, datatype=datatype, count=1)
        for i, name in enumerate("xyz")
    ]
    made = PointCloud2(fields=fields, height=1, width=len(points), point_step=step)
    made.row_step = step * len(points)
    rows = np.zeros((len(points), step), np.uint8)
    rows[:, : 3 * points.itemsize] = points.view(np.uint8)
    made.data = array("B", rows.tobytes())
    return made


def floats(message):
    return np.frombuffer(bytes(message.data), np.float32).reshape(-1, 3).tolist()


# A transform whose rotation nobody set.
unset = TransformStamped()
unset.transform.rotation = Quaternion(x=0.0, y=0.0, z=0.0, w=0.0)
print("zero rotation:", tf2_geometry_msgs.do_transform_point(PointStamped(), unset).point.x)

# Clouds.
still = TransformStamped()
integers = do_transform_cloud(cloud(np.array([[1, 2, 3]], np.int16), PointField.INT16, 6), still)
print("integers:", bytes(integers.data).hex())
padded = do_transform_cloud(
    cloud(np.array([[1, 2, 3], [4, 5, 6]], np.float32), PointField.FLOAT32, 16), still
)
print("padded:", padded.point_step, floats(padded))
packed = cloud(np.array([[1, 2, 3]], np.float32), PointField.FLOAT32, 12)
print("a Transform without a header:", repr(do_transform_cloud(packed, Transform()).header.frame_id))
packed.row_step = 0
print("without a row_step:", do_transform_cloud(packed, still).width)
