# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A type of one's own that buffers transform, and a buffer of one's own that transforms it; no node."""

import dataclasses
import math

from geometry_msgs.msg import PointStamped, TransformStamped, Vector3Stamped
from rclpy.duration import Duration
from rclpy.time import Time
from std_msgs.msg import Header

import tf2_geometry_msgs
import tf2_ros
from tf2_ros import ConvertRegistration, TransformRegistration


@dataclasses.dataclass
class Ray:
    """From a point into a direction."""

    header: Header
    origin: tuple
    direction: tuple


@dataclasses.dataclass
class Polar:
    header: Header
    distance: float
    bearing: float


def do_transform_ray(ray, transform):
    start = PointStamped(header=ray.header)
    start.point.x, start.point.y, start.point.z = ray.origin
    towards = Vector3Stamped(header=ray.header)
    towards.vector.x, towards.vector.y, towards.vector.z = ray.direction
    p = tf2_geometry_msgs.do_transform_point(start, transform).point
    v = tf2_geometry_msgs.do_transform_vector3(towards, transform).vector
    return Ray(transform.header, (p.x, p.y, p.z), (v.x, v.y, v.z))


def ray_to_point(ray):
    point = PointStamped(header=ray.header)
    point.point.x, point.point.y, point.point.z = ray.origin
    return point


def point_to_polar(point):
    p = point.point
    return Polar(point.header, math.hypot(p.x, p.y), math.degrees(math.atan2(p.y, p.x)))


def register():
    TransformRegistration().add(Ray, do_transform_ray)
    conversions = ConvertRegistration()
    conversions.add_to_msg(Ray, ray_to_point)
    conversions.add_from_msg(Polar, point_to_polar)
    conversions.add_convert((Polar, float), lambda polar: polar.distance)


class TableOfFrames(tf2_ros.BufferInterface):
    """Transforms from a dictionary, as of a file of calibrations; time does not matter."""

    def __init__(self, table):
        super().__init__()
        self.table = table
        self.asked = []

    def lookup_transform(self, target_frame, source_frame, time, timeout=None):
        self.asked.append((target_frame, source_frame, type(time).__name__, type(timeout).__name__))
        if not self.can_transform(target_frame, source_frame, time):
            raise tf2_ros.LookupException(f"not in the table: {source_frame}")
        x, y, turned = self.table[target_frame, source_frame]
        t = TransformStamped(child_frame_id=source_frame)
        t.header.frame_id = target_frame
        t.transform.translation.x, t.transform.translation.y = x, y
        t.transform.rotation.z, t.transform.rotation.w = math.sin(turned / 2), math.cos(turned / 2)
        return t

    def can_transform(self, target_frame, source_frame, time, timeout=None):
        return (target_frame, source_frame) in self.table


def numbers(values):
    return " ".join(f"{value + 0.0:.3f}" for value in values)


def attempt(title, function, *args, **kwargs):
    try:
        result = function(*args, **kwargs)
    except (tf2_ros.TransformException, tf2_ros.TypeException, tf2_ros.NotImplementedException) as error:
        print(f"{title}: {type(error).__name__}")
        return None
    return result


def main():
    register()
    header = Header(frame_id="camera")
    header.stamp.sec = 4
    ray = Ray(header, (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    table = TableOfFrames({("base", "camera"): (0.5, 0.25, math.pi / 2), ("base", "lidar"): (0.0, 0.0, 0.0)})

    moved = table.transform(ray, "base", timeout=Duration(seconds=1))
    print(
        "ray:",
        type(moved).__name__,
        moved.header.frame_id,
        numbers(moved.origin),
        "|",
        numbers(moved.direction),
    )
    polar = table.transform(ray, "base", new_type=Polar)
    print("polar:", type(polar).__name__, numbers([polar.distance, polar.bearing]))
    print("in two steps:", numbers([tf2_ros.convert(tf2_ros.convert(moved, Polar), float)]))
    same = tf2_ros.convert(ray, Ray)
    print("the same type:", same == ray, same is not ray)
    for question in table.asked:
        print("asked:", *question[:3])

    point = tf2_ros.Stamped(PointStamped(), header.stamp, "lidar")
    print("stamped:", point.header.frame_id, point.header.stamp.sec)
    print("point:", numbers([table.transform(point, "base").point.x]))

    attempt("no entry", table.transform, ray, "moon")
    attempt("not of this class", table.transform_full, ray, "base", Time(), "base")
    attempt("not a known type", table.transform, Polar(header, 1.0, 2.0), "base")
    attempt("no conversion", tf2_ros.convert, ray, Header)
    attempt("interface", tf2_ros.BufferInterface().can_transform, "a", "b", Time())
    attempt("interface", tf2_ros.BufferInterface().lookup_transform, "a", "b", Time())
    print("registered:", TransformRegistration().get(Ray) is do_transform_ray)

    # A later registration replaces an earlier one, and a true buffer knows the type as well.
    TransformRegistration().add(Ray, lambda one, transform: "another function")
    print(table.transform(ray, "base"))
    register()
    buffer = tf2_ros.Buffer()
    buffer.set_transform_static(table.lookup_transform("base", "camera", Time()), "table")
    moved = buffer.transform(ray, "base")
    print("true buffer:", moved.header.stamp.sec, numbers(moved.origin), "|", numbers(moved.direction))


if __name__ == "__main__":
    main()
