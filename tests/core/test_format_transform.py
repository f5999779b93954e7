# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A transform in one line."""

import math
import re

import numpy as np
import pytest
from geometry_msgs.msg import Pose, PoseStamped, Transform
from rotations import Turn
from times_and_transforms import about_z, transform


@pytest.fixture
def text(tf2_ros):
    return tf2_ros.format_transform


def test_what_is_shown_of_transforms_and_poses(text):
    m = transform("map", "base_link", ns=12_300_000_000, xyz=(1, 2, -0.0004), xyzw=about_z(math.pi / 2))
    assert text(m) == ("map -> base_link at 12.300000000: xyz [1.000 2.000 0.000] m, rpy [0.0 0.0 90.0] deg")
    pose = Pose()
    pose.position.x = -1.23456
    assert text(pose) == "xyz [-1.235 0.000 0.000] m, rpy [0.0 0.0 0.0] deg"
    stamped = PoseStamped(pose=pose)
    stamped.header.frame_id, stamped.header.stamp.sec = "map", 3
    assert text(stamped) == f"map at 3.000000000: {text(pose)}"


@pytest.mark.parametrize(
    "rpy",
    [
        *[(10, 20, 30), (-170, 45, 100), (0, -89, 0), (179.5, 0, -179.5), (5, 89.5, -120)],
        # At a pitch of ninety degrees the yaw is zero.
        *[(roll, pitch, 0) for pitch in (90, -90) for roll in (0, 30, -150, 179)],
    ],
    ids=str,
)
def test_the_angles_turn_about_the_fixed_axes_x_y_z_in_turn(text, rpy):
    m, length = Transform(), 3.0  # a rotation need not have length one
    m.rotation.x, m.rotation.y, m.rotation.z, m.rotation.w = (
        length * Turn.from_angles(*np.radians(rpy)).q
    ).tolist()
    angles = re.search(r"rpy \[(.*)\] deg", text(m))[1].split()
    assert [float(number) for number in angles] == pytest.approx(rpy, abs=0.051)


def test_what_is_no_transform_is_refused(text):
    with pytest.raises(TypeError, match="expected a TransformStamped"):
        text("map")
    m = Transform()
    m.rotation.w = 0.0
    with pytest.raises(ValueError, match="finite, non-zero length, got"):
        text(m)
