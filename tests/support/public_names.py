# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The public names: those of tf2 0.36, of which `tf2_names.json` was made, and those of this project."""

import json

from paths import TESTS

NAMES = json.loads((TESTS / "packaging" / "tf2_names.json").read_text())
# What later releases of tf2 add.
ADDED = {
    "tf2_ros": {"DEFAULT_STATIC_TF_TOPIC", "DEFAULT_TF_TOPIC"},
    "tf2_ros.transform_listener": {"DEFAULT_STATIC_TF_TOPIC", "DEFAULT_TF_TOPIC"},
}
# What tf2's modules import for themselves, and what no published program that was found takes from them.
_FROM_THE_PACKAGE = {
    "Clock",
    "FrameGraph",
    "JumpThreshold",
    "PointCloud2",
    "ReentrantCallbackGroup",
    "SingleThreadedExecutor",
    "Thread",
    "TimeJump",
    "TypeVar",
    "add_dll_directories_from_env",
    "builtin_interfaces",
    "deepcopy",
    "sleep",
    "warnings",
}
_FROM_ITS_MODULES = _FROM_THE_PACKAGE | {
    "Any",
    "Callable",
    "List",
    "Optional",
    "Tuple",
    "Union",
    "rclpy",
    "tf2_ros",
    "threading",
}
LEFT_OUT = {
    module: _FROM_ITS_MODULES if module.startswith("tf2_ros.") else _FROM_THE_PACKAGE
    for module in NAMES
    if module.startswith(("tf2_py", "tf2_ros"))
}
# What this project adds; imported by name, for `import *` must not hide what a program calls so.
GEOMETRY = {
    "do_transform_accel_stamped",
    "do_transform_odometry",
    "do_transform_path",
    "do_transform_polygon",
    "do_transform_pose_array",
    "do_transform_pose_with_covariance",
    "do_transform_quaternion",
    "do_transform_quaternion_stamped",
    "do_transform_transform",
    "do_transform_transform_stamped",
    "do_transform_twist_stamped",
    "do_transform_velocity_stamped",
    "do_transform_wrench",
    "do_transform_wrench_stamped",
    "quaternion_from_rpy",
    "rpy_from_quaternion",
}
SENSORS = {"do_transform_imu", "do_transform_magnetic_field", "from_msg_msg", "to_msg_msg", "PointCloud2"}
OURS = {
    "tf2_geometry_msgs": GEOMETRY
    | {"Quaternion", "QuaternionStamped", "Transform", "Vector3", "WrenchStamped"},
    "tf2_py": {
        *("Explanation", "FrameInfo", "History", "Hop"),
        *("__version__", "stored_name"),
    },
    "tf2_ros": {
        "BufferServer",
        "BufferSource",
        "Explanation",
        "FilterFailureReason",
        "FrameInfo",
        "History",
        "Hop",
        "MessageFilter",
        "StaticTransformListener",
        "__version__",
        "stored_name",
    },
    "tf2_sensor_msgs": SENSORS,
}
