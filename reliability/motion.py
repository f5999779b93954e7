"""Transforms whose numbers encode their stamps, and a check of answers about them."""

import math
from dataclasses import dataclass

import numpy as np
from geometry_msgs.msg import TransformStamped

S = 1_000_000_000
WORLD = "world"
ROBOTS = 4
TOLERANCE = 1e-9


@dataclass(frozen=True)
class Motion:
    """
    Robots that move and turn evenly from `epoch_ns` on, with sensors mounted on them.

    Between two samples tf2 interpolates, which is exact for an even motion: an answer is right or wrong
    whatever the network has lost. No transform is ever the identity.
    """

    epoch_ns: int

    def robot(self, index: int, stamp_ns: int) -> TransformStamped:
        position, yaw = self._pose(index, stamp_ns)
        return _transform(WORLD, robot_frame(index), stamp_ns, position, yaw)

    def _pose(self, index, stamp_ns):
        elapsed = (stamp_ns - self.epoch_ns) / S
        x = (index + 1) * (1.0 + 0.1 * elapsed)
        return np.array([x, 2.0 * x, -x]), 0.01 * (index + 1) * (1.0 + elapsed)

    def error_of(self, sensor: int, answer: TransformStamped, stamp_ns: int | None = None) -> str | None:
        """What is wrong with where the answer says a sensor is, at this time or the newest; or None."""
        stamp = answer.header.stamp.sec * S + answer.header.stamp.nanosec
        if (answer.header.frame_id, answer.child_frame_id) != (WORLD, sensor_frame(sensor)):
            return f"frames are {answer.header.frame_id!r} and {answer.child_frame_id!r}"
        if stamp_ns is not None and stamp != stamp_ns:
            return f"asked for time {stamp_ns}, got time {stamp}"
        position, yaw = self._pose(sensor % ROBOTS, stamp)
        offset, turn = mount(sensor)
        cosine, sine = math.cos(yaw), math.sin(yaw)
        turned = [cosine * offset[0] - sine * offset[1], sine * offset[0] + cosine * offset[1], offset[2]]
        expected = [*(position + turned), 0.0, 0.0, math.sin((yaw + turn) / 2), math.cos((yaw + turn) / 2)]
        place, rotation = answer.transform.translation, answer.transform.rotation
        got = [place.x, place.y, place.z, rotation.x, rotation.y, rotation.z, rotation.w]
        if np.dot(expected[3:], got[3:]) < 0.0:
            got[3:] = [-part for part in got[3:]]
        error = float(np.max(np.abs(np.subtract(expected, got)) / np.maximum(1.0, np.abs(expected))))
        return None if error <= TOLERANCE else f"at {stamp}: expected {expected}, got {got}"


def robot_frame(index: int) -> str:
    return f"robot{index}"


def sensor_frame(index: int) -> str:
    return f"sensor{index}"


def mount(sensor: int) -> tuple[list[float], float]:
    """Where a sensor is mounted on its robot: translation and yaw."""
    return [1.0 + 0.1 * sensor, 0.5, 0.25], 0.01 * (sensor % 100)


def mounted(sensor: int) -> TransformStamped:
    """The static transform of a sensor, below robot `sensor % ROBOTS`."""
    offset, yaw = mount(sensor)
    return _transform(robot_frame(sensor % ROBOTS), sensor_frame(sensor), 0, offset, yaw)


def _transform(parent, child, stamp_ns, position, yaw):
    transform = TransformStamped()
    transform.header.frame_id, transform.child_frame_id = parent, child
    transform.header.stamp.sec, transform.header.stamp.nanosec = divmod(stamp_ns, S)
    place, rotation = transform.transform.translation, transform.transform.rotation
    place.x, place.y, place.z = map(float, position)
    rotation.z, rotation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return transform
