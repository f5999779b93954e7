# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Offline: what a camera saw, as poses and as a cloud of points, in the frame of the map."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass, field

import numpy as np
from geometry_msgs.msg import (
    Point32,
    PointStamped,
    PolygonStamped,
    Pose,
    PoseStamped,
    PoseWithCovarianceStamped,
    TransformStamped,
    Vector3Stamped,
)
from sensor_msgs.msg import PointCloud2, PointField

import tf2_geometry_msgs
import tf2_ros
from tf2_sensor_msgs import do_transform_cloud, transform_points


def rounded(*numbers):
    return tuple(round(float(number), 3) + 0.0 for number in numbers)


@dataclass
class Mount:
    parent: str
    child: str
    xyz: tuple[float, float, float]
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    degrees: float = 0.0

    def message(self) -> TransformStamped:
        half = math.radians(self.degrees) / 2
        t = TransformStamped()
        t.header.frame_id, t.child_frame_id = self.parent, self.child
        t.transform.translation.x, t.transform.translation.y, t.transform.translation.z = self.xyz
        q = t.transform.rotation
        q.x, q.y, q.z = (component * math.sin(half) for component in self.axis)
        q.w = math.cos(half)
        return t


@dataclass
class Robot:
    mounts: list[Mount]
    buffer: tf2_ros.Buffer = field(default_factory=tf2_ros.Buffer)

    def __post_init__(self):
        for mount in self.mounts:
            self.buffer.set_transform_static(mount.message(), "urdf")


def header_for(message, frame="camera"):
    message.header.frame_id = frame
    message.header.stamp.sec = 5
    return message


def make_cloud() -> PointCloud2:
    cloud = header_for(PointCloud2())
    cloud.fields = [
        PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
        for i, name in enumerate(["x", "y", "z", "intensity"])
    ]
    cloud.height, cloud.width = 1, 3
    cloud.point_step, cloud.row_step = 16, 48
    cloud.is_dense = True
    cloud.data = struct.pack("<12f", 1, 0, 0, 10, 0, 2, 0, 20, 0.5, -0.5, 3, 30)
    return cloud


def show_pose(title: str, pose: Pose):
    p, q = pose.position, pose.orientation
    sign = 1 if q.w >= 0 else -1
    print(title, rounded(p.x, p.y, p.z), rounded(sign * q.x, sign * q.y, sign * q.z, sign * q.w))


def main():
    robot = Robot(
        [
            Mount("map", "base_link", (2.0, -1.0, 0.0), degrees=90.0),
            Mount("base_link", "camera", (0.1, 0.0, 0.8), axis=(0.0, 1.0, 0.0), degrees=30.0),
        ]
    )
    to_map = robot.buffer.lookup_transform("map", "camera", tf2_ros.buffer.Time())

    seen = header_for(PoseStamped())
    seen.pose.position.x, seen.pose.orientation.w = 1.5, 1.0
    moved = robot.buffer.transform(seen, "map")
    print(type(moved).__name__, moved.header.frame_id, moved.header.stamp.sec)
    show_pose("pose:", moved.pose)
    show_pose("the same by hand:", tf2_geometry_msgs.do_transform_pose(seen.pose, to_map))
    show_pose("and stamped:", tf2_geometry_msgs.do_transform_pose_stamped(seen, to_map).pose)
    show_pose("back again:", robot.buffer.transform(moved, "camera").pose)

    uncertain = header_for(PoseWithCovarianceStamped())
    uncertain.pose.pose = seen.pose
    uncertain.pose.covariance = [float(10 * i + i) if i % 7 == 0 else 0.0 for i in range(36)]
    uncertain = robot.buffer.transform(uncertain, "map")
    show_pose("uncertain:", uncertain.pose.pose)
    print(*(rounded(*row) for row in np.reshape(uncertain.pose.covariance, (6, 6))), sep="\n")

    point = header_for(PointStamped(), "base_link")
    point.point.y = 3.0
    spot = robot.buffer.transform(point, "map").point
    print("point:", rounded(spot.x, spot.y, spot.z))

    up = header_for(Vector3Stamped())
    up.vector.z = 1.0
    v = robot.buffer.transform(up, "map").vector
    print("vector:", rounded(v.x, v.y, v.z))

    area = header_for(PolygonStamped())
    area.polygon.points = [Point32(x=1.0), Point32(y=1.0), Point32(z=1.0)]
    corners = robot.buffer.transform(area, "map").polygon.points
    print("polygon:", *(rounded(p.x, p.y, p.z) for p in corners))

    for cloud in (do_transform_cloud(make_cloud(), to_map), robot.buffer.transform(make_cloud(), "map")):
        numbers = np.frombuffer(bytes(cloud.data), dtype="<f4").reshape(cloud.width, 4)
        print("cloud:", cloud.header.frame_id, cloud.width, cloud.point_step, [f.name for f in cloud.fields])
        for row in numbers:
            print("   ", rounded(*row))

    grid = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0]])
    print("points:", *(rounded(*row) for row in transform_points(grid, to_map.transform)))


if __name__ == "__main__":
    main()
