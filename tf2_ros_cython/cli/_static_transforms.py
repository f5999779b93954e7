"""Owns static transforms as users write them, in options or in a file, and refuses contradictions."""

from argparse import ArgumentTypeError
from collections.abc import Mapping
from math import hypot, isinf
from pathlib import Path
from typing import Any, NamedTuple

from tf2_ros_cython.cli._numbers import finite_number
from tf2_ros_cython.cli._program import UsageError
from tf2_ros_cython.cli._rpy import quaternion_from_rpy

__all__ = [
    "EULER",
    "FRAMES",
    "NUMBERS",
    "QUATERNION",
    "TRANSLATION",
    "StaticTransform",
    "numbered",
    "read_file",
]

FRAMES = ("frame_id", "child_frame_id")
TRANSLATION = ("x", "y", "z")
QUATERNION = ("qx", "qy", "qz", "qw")
EULER = ("roll", "pitch", "yaw")
NUMBERS = (*TRANSLATION, *QUATERNION, *EULER)

# How far the squared length of a quaternion may be from 1 for tf2's C++ to take it.
TOLERANCE = 0.01


class StaticTransform(NamedTuple):
    """A transform from ``child_frame_id`` to ``frame_id``; the rotation is x y z w, of length one."""

    frame_id: str
    child_frame_id: str
    translation: tuple[float, ...]
    rotation: tuple[float, ...]
    was_normalised: bool  # the rotation had another length

    @classmethod
    def of(cls, fields: Mapping[str, Any]) -> "StaticTransform":
        """
        Make one of what a user gave.

        :param fields: the names, and floats, by FRAMES and NUMBERS; what is None was not given.
        :raises UsageError: a name is lacking, or two of them contradict each other.
        """
        given = {name: value for name, value in fields.items() if value is not None}
        frame, child = (given.get(name, "") for name in FRAMES)
        if not frame or not child:
            raise UsageError("frame_id and child_frame_id must be given, and must not be empty")
        if frame == child:
            raise UsageError(f"frame_id and child_frame_id must differ, both are {frame!r}")
        if given.keys() & set(QUATERNION) and given.keys() & set(EULER):
            raise UsageError("a rotation is a quaternion or Euler angles; both were given")
        if given.keys() & set(EULER):
            rotation = quaternion_from_rpy(*(given.get(name, 0.0) for name in EULER))
        else:
            rotation = tuple(given.get(name, float(name == "qw")) for name in QUATERNION)
        translation = tuple(given.get(name, 0.0) for name in TRANSLATION)
        return cls(frame, child, translation, *_normalised(rotation))


def _normalised(rotation: tuple[float, ...]) -> tuple[tuple[float, ...], bool]:
    length = hypot(*rotation)
    if length == 0.0 or isinf(length):
        raise UsageError(f"a quaternion must have a finite length above 0; this one is {rotation}")
    if abs(length * length - 1.0) < TOLERANCE:
        return rotation, False
    return tuple(part / length for part in rotation), True


def read_file(path: Path) -> list[StaticTransform]:
    """
    Read a YAML file: a list of mappings with the names of FRAMES and NUMBERS.

    :raises UsageError: it cannot be read, or says what cannot be.
    """
    transforms = []
    for place, entry in enumerate(_entries(path), start=1):
        try:
            transforms.append(StaticTransform.of(_fields(entry)))
        except UsageError as refusal:
            raise UsageError(f"{path}: transform {place}: {refusal}") from None
    try:
        _refuse_no_tree(transforms)
    except UsageError as refusal:
        raise UsageError(f"{path}: {refusal}") from None
    return transforms


def _entries(path: Path) -> list[Any]:
    try:
        import yaml
    except ModuleNotFoundError:
        raise UsageError("to read a file, PyYAML is needed: pip install PyYAML") from None
    try:
        entries = yaml.safe_load(path.read_text(encoding="utf-8"))
    except OSError as refusal:
        raise UsageError(f"cannot read {path}: {refusal.strerror}") from None
    except (UnicodeDecodeError, yaml.YAMLError) as refusal:
        raise UsageError(f"{path} is not YAML: {refusal}") from None
    if not isinstance(entries, list) or not entries:
        raise UsageError(f"{path} must hold a list of transforms")
    return entries


def _fields(entry: Any) -> dict[str, Any]:
    if not isinstance(entry, dict):
        raise UsageError(f"must be a mapping with the names {', '.join((*FRAMES, *NUMBERS))}")
    unknown = [str(name) for name in entry if name not in (*FRAMES, *NUMBERS)]
    if unknown:
        raise UsageError(f"does not have {', '.join(unknown)}, only {', '.join((*FRAMES, *NUMBERS))}")
    for name in FRAMES:
        if not isinstance(entry.get(name, ""), str):
            raise UsageError(f"{name} must be a text, not {entry[name]!r}; quote it")
    return numbered(entry)


def numbered(fields: Mapping[str, Any]) -> dict[str, Any]:
    """
    Make floats of the numbers, which may be texts: for YAML, 1e-3 is one.

    :param fields: by FRAMES and NUMBERS.
    :raises UsageError: one is not a finite number.
    """
    return {name: value if name in FRAMES else _number(name, value) for name, value in fields.items()}


def _number(name: str, value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise UsageError(f"{name} must be a number, not {value!r}")
    try:
        return finite_number(str(value))
    except ArgumentTypeError as refusal:
        raise UsageError(f"{name}: {refusal}") from None


def _refuse_no_tree(transforms: list[StaticTransform]) -> None:
    parents: dict[str, str] = {}
    for one in transforms:
        if one.child_frame_id in parents:
            raise UsageError(f"the frame {one.child_frame_id!r} has two transforms")
        parents[one.child_frame_id] = one.frame_id
    for start in parents:
        seen = {start}
        frame = start
        while frame in parents:
            frame = parents[frame]
            if frame in seen:
                raise UsageError(f"the frame {frame!r} is above itself")
            seen.add(frame)
