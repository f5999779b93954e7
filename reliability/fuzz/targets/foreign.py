"""Fuzz joint states, poses, Foxglove's messages and URDFs: damage is a ValueError."""

import json
import struct
from collections.abc import Callable, Iterator

import numpy as np

from reliability.fuzz.faults import Fault
from tf2_py import BufferCore
from tf2_ros_tools import foxglove
from tf2_ros_tools.serialised import (
    LITTLE_ENDIAN,
    Reader,
    Series,
    joint_names,
    numbers_of,
    odometry_frames,
    pose_frames,
)
from tf2_ros_tools.urdf import Robot, load

Names = Callable[[Reader], tuple[tuple[str, ...], int]]

URDF = """<robot name="arm"><link name="base"/><link name="hand"/><link name="tip"/>
<joint name="turn" type="revolute"><parent link="base"/><child link="hand"/><origin xyz="1 2 3" rpy="0 1 0"/>
<axis xyz="0 0 1"/><limit lower="-1" upper="1"/></joint>
<joint name="slide" type="prismatic"><parent link="hand"/><child link="tip"/>
<mimic joint="turn" multiplier="2"/></joint></robot>"""
ROTATION = {"x": 0.0, "y": 0.0, "z": 0.0, "w": 1.0}


def run(data: bytes) -> None:
    """Read one message or description; the first byte says of which kind."""
    try:
        _KINDS[data[0] % len(_KINDS) if data else 0](data[1:])
    except ValueError:
        pass


def _described(data: bytes) -> None:
    robot = load("<" + data.decode())
    names = [one.name for one in robot.joints]
    positions = np.linspace(-9, 9, 3 * len(names)).reshape(3, -1)
    joints, translations, rotations = robot.transforms(names, positions)
    if translations.shape != (3, len(joints), 3) or rotations.shape != (3, len(joints), 4):
        raise Fault(f"{translations.shape}, {rotations.shape}")
    _inserted(robot)


def _inserted(robot: Robot) -> None:
    buffer = BufferCore()
    for one in robot.static_transforms():
        buffer.set_transform_static(one, "fuzz")
    buffer._self_check()


def _converted(msgtype: str, encoding: str) -> Callable[[bytes], None]:
    def convert(data: bytes) -> None:
        BufferCore().set_transforms_cdr(foxglove.tf_message(msgtype, encoding, data), "fuzz")
        if msgtype == foxglove.TYPES[0]:
            foxglove.stamp_ns(encoding, data)

    return convert


def _read(names: Names) -> Callable[[bytes], None]:
    def read(data: bytes) -> None:
        series = Series(names)
        for _ in range(2):  # the second time from what is known of the first
            _, layout, numbers = series.read(data)
            if numbers_of(layout, [numbers]).shape != (1, layout.count):
                raise Fault(f"{layout}")

    return read


_KINDS: list[Callable[[bytes], None]] = [
    _described,
    *(_converted(msgtype, encoding) for msgtype in foxglove.TYPES for encoding in foxglove.ENCODINGS),
    *map(_read, (joint_names, pose_frames, odometry_frames)),
]


def _field(number: int, data: bytes) -> bytes:
    return bytes([number << 3 | 2, len(data)]) + data


def _text(text: bytes) -> bytes:
    return struct.pack("<I", len(text) + 1) + (text + b"\0").ljust(-(-(len(text) + 1) // 4) * 4, b"\0")


def seeds() -> Iterator[bytes]:
    """One of each kind."""
    vector = b"".join(bytes([i << 3 | 1]) + struct.pack("<d", i) for i in (1, 2, 3))
    fields = [_field(1, b"\x08\x05\x10\x07"), _field(2, b"map"), _field(3, b"odom"), _field(4, vector)]
    protobuf = b"".join([*fields, _field(5, vector + b"\x21" + struct.pack("<d", 1.0))])
    content = {
        "timestamp": {"sec": 5, "nsec": 7},
        "parent_frame_id": "map",
        "child_frame_id": "odom",
        "translation": ROTATION,
        "rotation": ROTATION,
    }
    stamp = LITTLE_ENDIAN + struct.pack("<iI", 5, 7)
    numbers = struct.pack("<7d", *range(7))
    messages = [
        URDF.encode()[1:],
        protobuf,
        json.dumps(content).encode(),
        _field(1, protobuf),
        json.dumps({"transforms": [content, content]}).encode(),
        stamp + _text(b"") + struct.pack("<I", 1) + _text(b"turn") + struct.pack("<II", 1, 0) + numbers,
        stamp + _text(b"map") + bytes(4) + numbers,
        stamp + _text(b"map") + _text(b"odom") + bytes(4) + numbers,
    ]
    for kind, message in enumerate(messages):
        yield bytes([kind]) + message
