# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read static transforms as users write them, in options and YAML files."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from math import hypot, inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tf2_ros_tools.common.roll_pitch_yaw import quaternion_from_rpy
from tf2_ros_tools.common.yaml_files import Key, frame_name, number_in, read_keys, read_list

if TYPE_CHECKING:
    from tf2_ros import TransformStamped

FRAMES = ("frame_id", "child_frame_id")
TRANSLATION = ("x", "y", "z")
QUATERNION = ("qx", "qy", "qz", "qw")
EULER = ("roll", "pitch", "yaw")
NUMBERS = (*TRANSLATION, *QUATERNION, *EULER)
ENTRY = "{frame_id: base_link, child_frame_id: camera, x: 0.3, yaw: -1.57}"  # of a file
# How far the squared length of a quaternion may differ from 1 if tf2's C++ is to accept it.
TOLERANCE = 0.01

_FRAME = Key("the name of a frame", frame_name, is_required=True)
_NUMBER = Key("a finite number", number_in(-sys.float_info.max, sys.float_info.max))
KEYS = {**dict.fromkeys(FRAMES, _FRAME), **dict.fromkeys(NUMBERS, _NUMBER)}


def read_file(path: Path) -> list[TransformStamped]:
    """
    Read a YAML file: a list of mappings with the names of FRAMES and NUMBERS.

    :raises UsageError: the file cannot be read.
    :raises ValueError: its contents are wrong.
    """
    entries = enumerate(read_list(path, "transforms", ENTRY), start=1)
    transforms = [transform_of(f"{path}: transform {place}", entry) for place, entry in entries]
    check_tree(str(path), transforms)
    return transforms


def check_tree(label: str, transforms: Iterable[TransformStamped]) -> None:
    """
    Check that each frame has one transform, and that no frame is its own ancestor.

    :param label: where they are from, for errors.
    :raises ValueError: a frame has several, or is.
    """
    from tf2_ros_tools.urdf import one_in_a_loop

    parents: dict[str, str] = {}
    for one in transforms:
        if one.child_frame_id in parents:
            raise ValueError(f"{label}: the frame {one.child_frame_id!r} has two transforms")
        parents[one.child_frame_id] = one.header.frame_id
    if (frame := one_in_a_loop(parents)) is not None:
        raise ValueError(f"{label}: the frame {frame!r} is its own ancestor")


def transform_of(label: str, given: Any) -> TransformStamped:
    """
    Make a transform from a mapping with the names of FRAMES and NUMBERS.

    :param label: what it is, for errors.
    :raises ValueError: its contents are wrong.
    """
    from tf2_ros import TransformStamped

    read = read_keys(label, given, KEYS, ENTRY)
    frame, child = (read[name] for name in FRAMES)
    if frame == child:
        raise ValueError(f"{label}: {' and '.join(FRAMES)} must differ, but both are {frame!r}")
    rotation = tuple(read.get(name, float(name == "qw")) for name in QUATERNION)
    if read.keys() & set(EULER):
        if read.keys() & set(QUATERNION):
            raise ValueError(f"{label}: quaternion and Euler angles are mutually exclusive")
        rotation = quaternion_from_rpy(*(read.get(name, 0.0) for name in EULER))
    if not 0.0 < hypot(*rotation) < inf:
        raise ValueError(f"{label}: expected a quaternion of finite, non-zero length, got {rotation}")
    made = TransformStamped()
    made.header.frame_id, made.child_frame_id = frame, child
    t, q = made.transform.translation, made.transform.rotation
    t.x, t.y, t.z = (read.get(name, 0.0) for name in TRANSLATION)
    q.x, q.y, q.z, q.w = rotation
    return made


def normalize(transform: TransformStamped) -> float | None:
    """Normalize a quaternion that tf2's C++ would refuse; return the length that it had, or None."""
    q = transform.transform.rotation
    length = hypot(q.x, q.y, q.z, q.w)
    if abs(length * length - 1.0) < TOLERANCE:
        return None
    q.x, q.y, q.z, q.w = (part / length for part in (q.x, q.y, q.z, q.w))
    return length
