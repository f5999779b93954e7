# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A URDF with a joint of each type, its joint states, and what they mean, computed with matrices by SciPy."""

import numpy as np
from making_bags import STRING, S, Sent, header
from scipy.spatial.transform import Rotation

JOINT_STATE = "sensor_msgs/msg/JointState"

ARM = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/> <link name="shoulder"/> <link name="wheel"/> <link name="slide"/> <link name="finger"/>
  <link name="thumb"/> <link name="cart"/> <link name="drone"/> <link name="camera"/>
  <joint name="lift" type="revolute">
    <parent link="base"/> <child link="shoulder"/>
    <origin xyz="0.1 -0.2 0.3" rpy="0.4 -0.5 0.6"/> <axis xyz="0 2 1"/>
    <limit lower="-1.5" upper="1.5" effort="1" velocity="1"/>
  </joint>
  <joint name="roll" type="continuous">
    <parent link="shoulder"/> <child link="wheel"/> <origin rpy="0 0 1.5707963267948966"/>
    <axis xyz="-1 0 0"/>
  </joint>
  <joint name="extend" type="prismatic">
    <parent link="wheel"/> <child link="slide"/> <origin xyz="1 0 0" rpy="0 1 0"/> <axis xyz="1 1 0"/>
  </joint>
  <joint name="grip" type="prismatic">
    <parent link="slide"/> <child link="finger"/> <mimic joint="extend" multiplier="-0.5" offset="0.02"/>
  </joint>
  <joint name="pinch" type="revolute">
    <parent link="slide"/> <child link="thumb"/> <axis xyz="0 0 1"/> <mimic joint="grip" multiplier="3"/>
  </joint>
  <joint name="drive" type="planar">
    <parent link="base"/> <child link="cart"/> <origin xyz="0 0 1" rpy="0 0 0.3"/> <axis xyz="0 0 1"/>
  </joint>
  <joint name="fly" type="floating">
    <parent link="base"/> <child link="drone"/> <origin xyz="0 1 0" rpy="0.2 0 0"/>
  </joint>
  <joint name="mount" type="fixed">
    <parent link="shoulder"/> <child link="camera"/> <origin xyz="0 0 0.5" rpy="0.1 0.2 0.3"/>
  </joint>
  <transmission name="motor"><joint name="lift"/></transmission>
</robot>
"""
NAMES = ("lift", "roll", "extend")  # of the joints that others do not move
FRAMES = ("shoulder", "wheel", "slide", "finger", "thumb")  # that move


def pose(xyz=(0, 0, 0), rotation=None):
    matrix = np.eye(4)
    matrix[:3, 3] = xyz
    if rotation is not None:
        matrix[:3, :3] = rotation.as_matrix()
    return matrix


def origin(xyz=(0, 0, 0), rpy=(0, 0, 0)):
    return pose(xyz, Rotation.from_euler("xyz", rpy))


def about(axis, angle):
    return pose(rotation=Rotation.from_rotvec(np.array(axis) / np.linalg.norm(axis) * angle))


def along(axis, way):
    return pose(np.array(axis) / np.linalg.norm(axis) * way)


def expected(lift, roll, extend):
    """For each moving frame of ARM, its parent and its pose there, a matrix."""
    grip = -0.5 * extend + 0.02
    return {
        "shoulder": ("base", origin((0.1, -0.2, 0.3), (0.4, -0.5, 0.6)) @ about((0, 2, 1), lift)),
        "wheel": ("shoulder", origin(rpy=(0, 0, np.pi / 2)) @ about((-1, 0, 0), roll)),
        "slide": ("wheel", origin((1, 0, 0), (0, 1, 0)) @ along((1, 1, 0), extend)),
        "finger": ("slide", along((1, 0, 0), grip)),
        "thumb": ("slide", about((0, 0, 1), 3 * grip)),
    }


# Those that do not move; a planar joint is one.
FIXED = {
    "camera": ("shoulder", origin((0, 0, 0.5), (0.1, 0.2, 0.3))),
    "cart": ("base", origin((0, 0, 1), (0, 0, 0.3))),
}


def random_states(count):
    """Positions of NAMES, shape (count, 3)."""
    return np.random.default_rng(1).uniform(-3, 3, (count, len(NAMES)))


def joint_state(ns, names, positions, topic="/joint_states", ros=2):
    """A recorded joint state."""
    fields = {
        "header": header(ns, "", ros),
        "name": list(names),
        "position": np.array(positions, np.float64),
        "velocity": np.zeros(len(names)),
        "effort": np.zeros(0),
    }
    return Sent(ns, topic, fields, JOINT_STATE)


def description(text=ARM, topic="/robot_description"):
    """The recorded topic of a robot_state_publisher."""
    return Sent(100 * S, topic, {"data": text}, STRING)
