"""A transform in one line."""

import math
import re

import pytest
from geometry_msgs.msg import Pose, PoseStamped, Transform
from making import about_z, transform
from scipy.spatial.transform import Rotation

pytestmark = pytest.mark.ours


@pytest.fixture
def text(tf2_ros):
    return tf2_ros.format_transform


def angles(line):
    return [float(number) for number in re.search(r"rpy \[(.*)\] deg", line)[1].split()]


def turned(roll, pitch, yaw):
    m = Transform()
    q = Rotation.from_euler("xyz", [roll, pitch, yaw], degrees=True).as_quat()
    m.rotation.x, m.rotation.y, m.rotation.z, m.rotation.w = q.tolist()
    return m


def test_a_stamped_transform_is_shown_with_frames_and_stamp(text):
    m = transform("map", "base_link", ns=12_300_000_000, xyz=(1, 2, -0.0004), xyzw=about_z(math.pi / 2))
    assert text(m) == ("map -> base_link at 12.300000000: xyz [1.000 2.000 0.000] m, rpy [0.0 0.0 90.0] deg")


def test_poses_are_shown_with_their_frame(text):
    pose = Pose()
    pose.position.x = -1.23456
    assert text(pose) == "xyz [-1.235 0.000 0.000] m, rpy [0.0 0.0 0.0] deg"
    stamped = PoseStamped(pose=pose)
    stamped.header.frame_id, stamped.header.stamp.sec = "map", 3
    assert text(stamped) == f"map at 3.000000000: {text(pose)}"


@pytest.mark.parametrize(
    "rpy", [(10, 20, 30), (-170, 45, 100), (0, -89, 0), (179.5, 0, -179.5), (5, 89.5, -120)], ids=str
)
def test_the_angles_turn_about_the_fixed_axes_x_y_z_in_turn(text, rpy):
    assert angles(text(turned(*rpy))) == pytest.approx(rpy, abs=0.051)


@pytest.mark.parametrize("pitch", [90, -90])
@pytest.mark.parametrize("yaw", [0, 30, -150, 179])
def test_at_a_pitch_of_ninety_degrees_the_roll_is_zero(text, pitch, yaw):
    assert angles(text(turned(0, pitch, yaw))) == pytest.approx((0, pitch, yaw), abs=0.051)


def test_a_rotation_need_not_have_length_one(text):
    m = Transform()
    m.rotation.z, m.rotation.w = 3.0, 3.0
    assert angles(text(m)) == [0.0, 0.0, 90.0]


def test_what_is_no_transform_is_refused(text):
    with pytest.raises(TypeError, match="expected a TransformStamped"):
        text("map")
    m = Transform()
    m.rotation.w = 0.0
    with pytest.raises(ValueError, match="length above zero"):
        text(m)
