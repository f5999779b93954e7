# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Write the recordings in docs/samples, which pages of the documentation use: `python tools/docs/samples.py`.

A robot drives in a circle for 10 s and takes two pictures a second (`drive`, and as `two_robots`); in the
same drive, a second is missing and the camera has two parents (`faults`); an antenna has its poses (`gps`);
an arm moves for 2 s with a camera on its gripper (`runs`, with its joint states only). A robot drives an
eight in a minute, its odometry drifts, and a SLAM closes the loop at the end (`slam`).
"""

import math
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

SAMPLES = Path(__file__).resolve().parent / "samples"
S = 1_000_000_000  # ns
ARM = """\
<robot name="arm">
  <link name="base_link"/> <link name="arm"/> <link name="gripper"/> <link name="camera"/>
  <joint name="shoulder" type="revolute">
    <parent link="base_link"/> <child link="arm"/> <origin xyz="0 0 0.5"/> <axis xyz="0 0 1"/>
  </joint>
  <joint name="extension" type="prismatic">
    <parent link="arm"/> <child link="gripper"/> <axis xyz="1 0 0"/>
  </joint>
  <joint name="mount" type="fixed">
    <parent link="gripper"/> <child link="camera"/> <origin xyz="0 0 0.1"/>
  </joint>
</robot>
"""
types = get_typestore(Stores.ROS2_JAZZY)


def message(name: str, *fields: Any) -> Any:
    return types.types[name](*fields)


def header(ns: int, frame: str) -> Any:
    return message("std_msgs/msg/Header", message("builtin_interfaces/msg/Time", ns // S, ns % S), frame)


def turned(yaw: float) -> Any:
    return message("geometry_msgs/msg/Quaternion", 0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))


def transforms(ns: int, parent: str, child: str, x: float, y: float, yaw: float) -> Any:
    transform = message(
        "geometry_msgs/msg/Transform", message("geometry_msgs/msg/Vector3", x, y, 0.0), turned(yaw)
    )
    stamped = message("geometry_msgs/msg/TransformStamped", header(ns, parent), child, transform)
    return message("tf2_msgs/msg/TFMessage", [stamped])


class Recorder:
    """Writes messages to topics, which are made with their first message."""

    def __init__(self, writer: Writer) -> None:
        self._writer = writer
        self._connections: dict[str, Any] = {}

    def __call__(self, topic: str, ns: int, written: Any) -> None:
        kind = written.__msgtype__
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic, kind, typestore=types)
        self._writer.write(self._connections[topic], ns, types.serialize_cdr(written, kind))


@contextmanager
def recording(folder: Path) -> Iterator[Recorder]:
    writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    with writer:
        yield Recorder(writer)


def drive(record: Recorder, namespace: str = "", missing: range = range(0)) -> None:
    """:param missing: the tenths of a second in which nothing is recorded."""
    begin = 1000 * S
    record(f"{namespace}/tf_static", begin, transforms(begin, "base_link", "camera", 0.5, 0.0, 0.0))
    for tenth in (one for one in range(100) if one not in missing):
        ns, angle = begin + tenth * S // 10, tenth / 10
        pose = math.cos(angle), math.sin(angle), angle + math.pi / 2
        record(f"{namespace}/tf", ns, transforms(ns, "map", "base_link", *pose))
        if tenth % 5 == 0:  # of an image, only its header
            record(f"{namespace}/images", ns, header(ns + 30_000_000, "camera"))


def faults(record: Recorder) -> None:
    drive(record, missing=range(40, 51))
    late = 1006 * S
    record("/tf", late, transforms(late, "mast", "camera", 0.1, 0.0, 0.0))


def antenna(record: Recorder) -> None:
    for second in range(10):
        ns = (1000 + second) * S
        place = message("geometry_msgs/msg/Point", second * 2.0, 0.0, 1.5)
        pose = message("geometry_msgs/msg/Pose", place, turned(0.0))
        record("/gps/pose", ns, message("geometry_msgs/msg/PoseStamped", header(ns, "map"), pose))


def slam(record: Recorder) -> None:
    """An eight of 24 m by 10 m, whose odometry turns too little; the SLAM notices when the loop is closed."""
    begin, steps = 1000 * S, 300
    angles = 2.0 * math.pi * np.arange(steps + 1) / steps
    places = 12.0 * np.sin(angles) + 5.0j * np.sin(2.0 * angles)
    headings = np.unwrap(np.angle(12.0 * np.cos(angles) + 10.0j * np.cos(2.0 * angles)))
    # What the odometry measures is the motion in the robot's frame, with a bias of 0.25 degrees in a second.
    drifted = headings - math.radians(0.25) * 0.2 * np.arange(steps + 1)
    moves = np.diff(places) * np.exp(1j * (drifted - headings))[:-1]
    measured = places[0] + np.concatenate(([0.0], np.cumsum(moves)))
    poses = []
    for step in range(steps + 1):
        ns = begin + step * S // 5
        record(
            "/tf",
            ns,
            transforms(ns, "odom", "base_link", measured[step].real, measured[step].imag, drifted[step]),
        )
        if step % 5 == 0:  # it publishes what it believes; until the loop is closed, that there is no drift
            yaw = headings[step] - drifted[step] if step == steps else 0.0
            place = places[step] - measured[step] * np.exp(1j * yaw) if step == steps else 0.0j
            record("/tf", ns, transforms(ns, "map", "odom", place.real, place.imag, yaw))
        if step % 10 == 0:
            point = message("geometry_msgs/msg/Point", places[step].real, places[step].imag, 0.0)
            pose = message("geometry_msgs/msg/Pose", point, turned(headings[step]))
            poses.append(message("geometry_msgs/msg/PoseStamped", header(ns, "map"), pose))
    record("/slam/path", ns, message("nav_msgs/msg/Path", header(ns, "map"), poses))


def arm(record: Recorder, begin: int, speed: float) -> None:
    none = np.zeros(0)
    for step in range(41):
        ns = begin + step * S // 20
        positions = np.array([speed * step / 20, 0.3 + 0.01 * step])
        names = ["shoulder", "extension"]
        record(
            "/joint_states",
            ns,
            message("sensor_msgs/msg/JointState", header(ns, ""), names, positions, none, none),
        )
        if step and step % 2 == 0:
            late, pixels = ns + S // 100, np.full(8 * 8, step, np.uint8)
            image = message("sensor_msgs/msg/Image", header(late, "camera"), 8, 8, "mono8", 0, 8, pixels)
            record("/camera/image_raw", late, image)


def write(folder: Path) -> None:
    folder.mkdir()
    (folder / "arm.urdf").write_text(ARM)
    with recording(folder / "drive") as record:
        drive(record)
    with recording(folder / "two_robots") as record:
        for namespace in ("/robot1", "/robot2"):
            drive(record, namespace)
    with recording(folder / "faults") as record:
        faults(record)
    with recording(folder / "gps") as record:
        antenna(record)
    with recording(folder / "slam") as record:
        slam(record)
    (folder / "runs").mkdir()
    for number in range(3):
        with recording(folder / "runs" / f"run{number}") as record:
            arm(record, (1000 + 100 * number) * S, 0.5 + number)


if __name__ == "__main__":
    shutil.rmtree(SAMPLES, ignore_errors=True)
    write(SAMPLES)
