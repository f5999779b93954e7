"""Deskew a lidar's sweep: transform each point, at its own time, to where the sensor is when the sweep ends.

A lidar takes 0.1 s to turn once. The robot drives meanwhile, so each point is measured from another place.
Here it drives a curve between known walls, and the program prints how far the points lie from the wall that
they were measured on, before and after.
"""

import time

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.time import Time
from scipy.spatial.transform import Rotation

from tf2_ros import Buffer

POINTS = 100_000
SWEEP_NS = 100_000_000
ODOMETRY_NS = 10_000_000  # wheel odometry at 100 Hz
START_NS = 1_700_000_000_000_000_000
SPEED = 8.0  # m/s
TURN = 0.9  # rad/s
WALLS = np.array([30.0, 20.0])  # metres from the origin to the walls in x and y
MOUNT = np.array([0.4, 0.0, 1.6])  # of the lidar on the robot, metres


def stamped(parent: str, child: str, ns: int, xyz: np.ndarray, turn: Rotation) -> TransformStamped:
    m = TransformStamped()
    m.header.frame_id, m.child_frame_id = parent, child
    m.header.stamp = Time(nanoseconds=ns).to_msg()
    t, q = m.transform.translation, m.transform.rotation
    t.x, t.y, t.z = map(float, xyz)
    q.x, q.y, q.z, q.w = map(float, turn.as_quat())
    return m


def pose(ns: np.ndarray) -> tuple[np.ndarray, Rotation]:
    """Where the robot is in ``odom``: it drives along a circle at constant speed."""
    heading = TURN * (ns - START_NS) * 1e-9
    radius = SPEED / TURN
    xyz = np.stack([radius * np.sin(heading), radius * (1 - np.cos(heading)), np.zeros(len(ns))], axis=1)
    return xyz, Rotation.from_rotvec(heading[:, None] * [0.0, 0.0, 1.0])


def sweep(times: np.ndarray) -> np.ndarray:
    """The points of one turn, each in the sensor's frame at its own time."""
    xyz, turn = pose(times)
    origin = xyz + turn.apply(MOUNT)
    beam = turn.apply(Rotation.from_rotvec(
        np.linspace(0, 2 * np.pi, len(times))[:, None] * [0.0, 0.0, 1.0]
    ).apply([1.0, 0.0, 0.0]))  # fmt: skip
    with np.errstate(divide="ignore"):
        reach = np.min((np.copysign(WALLS, beam[:, :2]) - origin[:, :2]) / beam[:, :2], axis=1)
    return turn.inv().apply(reach[:, None] * beam)


def distance_from_walls(points_in_odom: np.ndarray) -> np.ndarray:
    return np.abs(np.min(WALLS - np.abs(points_in_odom[:, :2]), axis=1))


def main() -> None:
    times = np.linspace(START_NS, START_NS + SWEEP_NS, POINTS).astype(np.int64)
    end = Time(nanoseconds=int(times[-1]))
    points = sweep(times)

    buffer = Buffer(Duration(seconds=10))
    buffer.set_transform_static(stamped("base_link", "lidar", 0, MOUNT, Rotation.identity()), "urdf")
    stamps = np.arange(START_NS - ODOMETRY_NS, START_NS + SWEEP_NS + 2 * ODOMETRY_NS, ODOMETRY_NS)
    for ns, xyz, turn in zip(stamps, *pose(stamps), strict=True):
        buffer.set_transform(stamped("odom", "base_link", int(ns), xyz, turn), "odometry")

    began = time.perf_counter()
    deskewed = buffer.transform_points(points, times, "lidar", "lidar", fixed_frame="odom", target_time=end)
    took = time.perf_counter() - began

    # Both clouds as seen from the end of the sweep.
    (xyz,), (turn,) = buffer.lookup_transforms("odom", "lidar", [end.nanoseconds])
    to_odom = Rotation.from_quat(turn)
    raw_error = distance_from_walls(to_odom.apply(points) + xyz)
    error = distance_from_walls(to_odom.apply(deskewed) + xyz)
    print(f"{POINTS} points, each with its own time, in {took * 1e3:.1f} ms")
    print(f"distance from the walls, as measured: up to {raw_error.max():.3f} m")
    print(f"distance from the walls, deskewed:    up to {error.max() * 1e3:.3f} mm")
    if error.max() > 0.002:
        raise SystemExit("the deskewed points do not lie on the walls")


if __name__ == "__main__":
    main()
