# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Messages, times and durations for tests that also run without ROS: those of ROS, if there is one."""

try:
    import rclpy.logging  # noqa: F401  once it is imported, buffers log through it, to stderr
    from geometry_msgs.msg import TransformStamped
    from rclpy.duration import Duration
    from rclpy.time import Time
except ModuleNotFoundError:
    from dataclasses import dataclass

    from tf2_ros._messages import TransformStamped, time_msg

    @dataclass(frozen=True)
    class Duration:
        """What a buffer and the tests read of a duration or a time."""

        nanoseconds: int

        def __init__(self, *, seconds=0, nanoseconds=0):
            object.__setattr__(self, "nanoseconds", round(seconds * 1_000_000_000) + nanoseconds)

        def to_msg(self):
            return time_msg(self, "time")

    Time = Duration

__all__ = ["Duration", "Time", "TransformStamped"]
