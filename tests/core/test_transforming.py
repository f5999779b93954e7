"""Objects of every known type transformed by a buffer; tests/ros/test_buffer_interface.py has the others."""

import subprocess
import sys
import textwrap

import pytest
from geometry_msgs.msg import PointStamped
from known_types import STAMPED
from making import at, stamp_ns, transform
from random_messages import Maker, numbers
from sensor_msgs.msg import PointCloud2, PointField

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


@pytest.mark.parametrize("cls", STAMPED, ids=lambda cls: cls.__name__)
def test_every_type_with_a_header_is_transformed(tf2_ros, buffer, cls):
    message = stamped(Maker(1).message(cls), 2.5)
    got = buffer.transform(message, "map")
    wanted = tf2_ros.TransformRegistration().get(cls)(
        message, buffer.lookup_transform("map", "base", at(2.5))
    )
    assert got == wanted and type(got) is cls
    assert (got.header.frame_id, stamp_ns(got)) == ("map", 2_500_000_000)
    assert numbers(got) != numbers(message)


def test_a_cloud_without_a_time_is_transformed_by_the_latest_and_keeps_its_stamp(buffer):
    got = buffer.transform(stamped(cloud(), 0), "map")
    assert (got.header.frame_id, stamp_ns(got)) == ("map", 0)
    point = buffer.transform(stamped(PointStamped(), 0, "odom"), "map")  # which gets that of the transform
    assert (stamp_ns(point), point.point.x) == (3_000_000_000, 3.0)


def run(program):
    done = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(program)], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


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
    assert run(program) == ["False", "map", "True"]


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
    assert run(program) == ["True False"]
