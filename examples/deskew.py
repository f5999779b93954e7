# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Deskew a lidar's sweep: transform each point, at its own time, to where the sensor is when the sweep ends.

A lidar takes 0.1 s for one turn, and the robot moves during this time. So each point is measured from another
place. Here, the robot drives a curve between known walls, and the program prints how far the points lie from
the wall that they were measured on, before and after.

Run: python examples/deskew.py
Ends by itself. The exit status is 0 only if the deskewed points lie on the walls.
"""

import time

import numpy as np
from rclpy.duration import Duration
from rclpy.time import Time
from std_msgs.msg import Header

from tf2_ros import Buffer
from tf2_ros.numpy import from_matrix, to_matrix

POINTS = 100_000
SWEEP_NS = 100_000_000
ODOMETRY_NS = 10_000_000  # wheel odometry at 100 Hz
START_NS = 1_700_000_000_000_000_000
SPEED = 8.0  # m/s
TURN = 0.9  # rad/s
WALLS = np.array([30.0, 20.0])  # meters from the origin to the walls in x and y
MOUNT = to_matrix(([0.4, 0.0, 1.6], [0.0, 0.0, 0.0, 1.0]))  # of the lidar on the robot, meters


def robot(ns: np.ndarray) -> np.ndarray:
    """Where the robot is in ``odom``, as matrices: it drives along a circle at constant speed."""
    heading = TURN * (ns - START_NS) * 1e-9
    radius = SPEED / TURN
    zero = np.zeros(len(ns))
    xyz = np.stack([radius * np.sin(heading), radius * (1 - np.cos(heading)), zero], axis=1)
    return to_matrix((xyz, np.stack([zero, zero, np.sin(heading / 2), np.cos(heading / 2)], axis=1)))


def sweep(ns: np.ndarray) -> np.ndarray:
    """The points of one turn, each in the sensor's frame at its own time."""
    angle = np.linspace(0, 2 * np.pi, len(ns))
    beam = np.stack([np.cos(angle), np.sin(angle), np.zeros(len(ns))], axis=1)
    lidar = robot(ns) @ MOUNT
    origin, direction = lidar[:, :2, 3], (lidar[:, :2, :3] @ beam[:, :, None])[:, :, 0]
    with np.errstate(divide="ignore"):
        reach = np.min((np.copysign(WALLS, direction) - origin) / direction, axis=1)
    return reach[:, None] * beam


def distance_from_walls(points: np.ndarray, to_odom: np.ndarray) -> np.ndarray:
    in_odom = points @ to_odom[:3, :3].T + to_odom[:3, 3]
    return np.abs(np.min(WALLS - np.abs(in_odom[:, :2]), axis=1))


def main() -> None:
    times = np.linspace(START_NS, START_NS + SWEEP_NS, POINTS).astype(np.int64)
    end = Time(nanoseconds=int(times[-1]))
    points = sweep(times)

    buffer = Buffer(Duration(seconds=10))
    mount = from_matrix(MOUNT, header=Header(frame_id="base_link"), child_frame_id="lidar")
    buffer.set_transform_static(mount, "urdf")
    stamps = np.arange(START_NS - ODOMETRY_NS, START_NS + SWEEP_NS + 2 * ODOMETRY_NS, ODOMETRY_NS)
    for ns, matrix in zip(stamps, robot(stamps), strict=True):
        header = Header(frame_id="odom", stamp=Time(nanoseconds=int(ns)).to_msg())
        buffer.set_transform(from_matrix(matrix, header=header, child_frame_id="base_link"), "odometry")

    began = time.perf_counter()
    deskewed = buffer.transform_points(points, times, "lidar", "lidar", fixed_frame="odom", target_time=end)
    took = time.perf_counter() - began

    # Both clouds as seen from the end of the sweep.
    to_odom = to_matrix(buffer.lookup_transform("odom", "lidar", end))
    raw_error = distance_from_walls(points, to_odom)
    error = distance_from_walls(deskewed, to_odom)
    print(f"{POINTS} points, each with its own time, in {took * 1e3:.1f} ms")
    print(f"distance from the walls, as measured: up to {raw_error.max():.3f} m")
    print(f"distance from the walls, deskewed:    up to {error.max() * 1e3:.3f} mm")
    if error.max() > 0.002:
        raise SystemExit("the deskewed points do not lie on the walls")


if __name__ == "__main__":
    main()
