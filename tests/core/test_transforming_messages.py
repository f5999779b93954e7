# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages transformed by a buffer, and types that nobody knows; test_buffer_interface.py has other types."""

import textwrap

import pytest
from geometry_msgs.msg import PointStamped, PolygonInstanceStamped
from making_objects import at, stamp_ns, transform
from processes import output_of
from sensor_msgs.msg import JointState, PointCloud2, PointField

pytestmark = pytest.mark.ours


@pytest.fixture
def buffer(tf2_ros):
    buffer = tf2_ros.Buffer()
    for seconds in (1, 2, 3):
        buffer.set_transform(transform("map", "odom", seconds, (seconds, 0, 0)), "x")
    buffer.set_transform_static(transform("odom", "base", 0, (0, 5, 0), (0.1, 0.2, 0.3, 0.9)), "x")
    return buffer


def stamped(message, seconds, frame="base"):
    message.header.frame_id, message.header.stamp = frame, at(seconds).to_msg()
    return message


def cloud():
    fields = [
        PointField(name=name, offset=offset, datatype=PointField.FLOAT32, count=1)
        for name, offset in (("x", 0), ("y", 4), ("z", 8))
    ]
    return PointCloud2(height=1, width=2, fields=fields, point_step=12, row_step=24, data=bytes(24))


def test_a_cloud_without_a_time_is_transformed_by_the_latest_and_keeps_its_stamp(buffer):
    got = buffer.transform(stamped(cloud(), 0), "map")
    assert (got.header.frame_id, stamp_ns(got)) == ("map", 0)
    point = buffer.transform(stamped(PointStamped(), 0, "odom"), "map")  # which gets that of the transform
    assert (stamp_ns(point), point.point.x) == (3_000_000_000, 3.0)


class Spot:
    """A type of a program's own."""

    def __init__(self, header, xyz):
        self.header, self.xyz = header, xyz


@pytest.mark.parametrize(
    ("message", "new_type", "cure"),
    [
        (JointState(), None, r"JointState'> is not .*TransformRegistration\(\)\.add"),
        (PolygonInstanceStamped(), None, r"PolygonInstanceStamped'> is not .*TransformRegistration\(\)\.add"),
        (Spot(PointStamped().header, []), None, r"Spot'> is not .*TransformRegistration\(\)\.add"),
        (PointStamped(), Spot, r"Spot'> is not .*ConvertRegistration\(\)\.add_from_msg"),
    ],
)
def test_an_unknown_type_is_refused_by_name_and_with_a_cure(tf2_ros, buffer, message, new_type, cure):
    message = stamped(message, 2)
    with pytest.raises(tf2_ros.TypeException, match=cure):
        buffer.transform(message, "map", new_type=new_type)


@pytest.mark.parametrize(
    ("package", "name", "provider"),
    [
        ("geometry_msgs", "PointStamped", "tf2_geometry_msgs"),
        ("nav_msgs", "Path", "tf2_geometry_msgs"),
        ("sensor_msgs", "Imu", "tf2_sensor_msgs"),
    ],
)
def test_importing_tf2_ros_alone_is_enough(package, name, provider):
    program = f"""
        import sys, tf2_ros
        from {package}.msg import {name}
        from geometry_msgs.msg import TransformStamped
        buffer = tf2_ros.Buffer()
        buffer.set_transform_static(
            TransformStamped(header=tf2_ros.Header(frame_id="map"), child_frame_id="base"), "x"
        )
        print("{provider}" in sys.modules)
        print(buffer.transform({name}(header=tf2_ros.Header(frame_id="base")), "map").header.frame_id)
        print("{provider}" in sys.modules)
    """
    assert output_of("-c", textwrap.dedent(program)).split() == ["False", "map", "True"]


def test_geometry_needs_no_nav_msgs():
    program = """
        import importlib.abc, sys
        class Without(importlib.abc.MetaPathFinder):
            def find_spec(self, name, path, target=None):
                if name.partition(".")[0] == "nav_msgs":
                    raise ModuleNotFoundError(f"No module named {name!r}", name="nav_msgs")
        sys.meta_path.insert(0, Without())
        from tf2_geometry_msgs import __all__ as names
        print("do_transform_pose" in names, "do_transform_path" in names)
    """
    assert output_of("-c", textwrap.dedent(program)).split() == ["True", "False"]
