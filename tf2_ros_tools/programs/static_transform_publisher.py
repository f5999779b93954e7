# PYTHON_ARGCOMPLETE_OK
"""Publish static transforms from options or from a file."""

from __future__ import annotations

import secrets
import string
import sys
from argparse import Namespace
from collections.abc import Mapping
from math import hypot, isinf
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, NoReturn

from tf2_ros_tools.program import (
    SUCCESS,
    Parser,
    UsageError,
    finite_number,
    run,
)
from tf2_ros_tools.yaml_files import Key, nonempty_text, number_in, read_keys, read_list

if TYPE_CHECKING:
    from geometry_msgs.msg import TransformStamped
    from rclpy.node import Node

__all__ = ["main"]

FRAMES = ("frame_id", "child_frame_id")
TRANSLATION = ("x", "y", "z")
QUATERNION = ("qx", "qy", "qz", "qw")
EULER = ("roll", "pitch", "yaw")
NUMBERS = (*TRANSLATION, *QUATERNION, *EULER)

# How far the squared length of a quaternion may differ from 1 if tf2's C++ is to accept it.
TOLERANCE = 0.01


DESCRIPTION = """\
Publish the transform from a child frame to its parent on /tf_static, until interrupted. Omitted values \
default to the identity. Lengths are in metres, angles in radians.

The old form, X Y Z YAW PITCH ROLL FRAME_ID CHILD_FRAME_ID or X Y Z QX QY QZ QW FRAME_ID CHILD_FRAME_ID, \
also works, with a warning."""

EXAMPLE = """\
  static_transform_publisher --x 0.3 --yaw -1.57 --frame-id base_link --child-frame-id camera
  static_transform_publisher --file transforms.yaml

where transforms.yaml uses the names of the options:
  - {frame_id: base_link, child_frame_id: camera, x: 0.3, yaw: -1.57}
  - {frame_id: base_link, child_frame_id: lidar, z: 0.5, qx: 0.0, qy: 0.0, qz: 1.0, qw: 0.0}"""

# The meaning of the values of the old form, by their number: with Euler angles, or with a quaternion.
OLD_FORMS = {
    8: (*TRANSLATION, *reversed(EULER), *FRAMES),
    9: (*TRANSLATION, *QUATERNION, *FRAMES),
}


def parser() -> Parser:
    """Its command line."""
    made = Parser("static_transform_publisher", DESCRIPTION, EXAMPLE)
    made.add_argument("--frame-id", metavar="FRAME_ID", help="the parent frame; required without --file")
    made.add_argument(
        "--child-frame-id", metavar="CHILD_FRAME_ID", help="the child frame; required without --file"
    )
    for names, meaning in (
        (TRANSLATION, "of the translation"),
        (QUATERNION, "of the rotation, a quaternion"),
    ):
        for name in names:
            made.add_argument(f"--{name}", type=finite_number, help=f"{name[-1]} {meaning}")
    for name, axis in zip(EULER, "xyz", strict=True):
        made.add_argument(
            f"--{name}", type=finite_number, help=f"turn about the fixed axis {axis}, instead of a quaternion"
        )
    made.add_argument("--file", metavar="YAML", type=Path, help="publish all transforms of a file")
    made.add_argument("old", metavar="VALUE", nargs="*", help="the old form; see above")
    return made


def transforms_of(options: Namespace) -> list[StaticTransform]:
    """
    Get the transforms that the command line asks to publish.

    :raises UsageError: it contradicts itself, or lacks something.
    """
    given = [name for name in (*FRAMES, *NUMBERS) if getattr(options, name) is not None]
    if options.old:
        return [_of_old_form(options.old, given, options.file)]
    if options.file is None:
        return [StaticTransform.of(vars(options))]
    if given:
        raise UsageError("--file cannot be combined with other transforms")
    return read_file(options.file)


def _of_old_form(values: list[str], given: list[str], file: Path | None) -> StaticTransform:
    names = OLD_FORMS.get(len(values))
    if names is None:
        raise UsageError(f"there are {len(values)} values without options; the old form has 8 or 9")
    if given or file is not None:
        raise UsageError("either options or the old form; both were given")
    return read_transform("the old form", dict(zip(names, values, strict=True)))


def publish(options: Namespace) -> NoReturn:
    """Publish until interrupted."""
    from tf2_ros_tools.listening import spun_node, wait

    # isort: split
    from tf2_ros import StaticTransformBroadcaster

    transforms = transforms_of(options)
    with spun_node(_unique_name(), options) as node:
        if options.file is None:
            _declare_parameters(node, transforms[0])
        _warn(node, options, transforms)
        stamp = node.get_clock().now().to_msg()
        node.get_logger().info(_summary(options, transforms))
        StaticTransformBroadcaster(node).sendTransform([_message(one, stamp) for one in transforms])
        wait()


def _unique_name() -> str:
    # Many of them run on one robot.
    end = "".join(secrets.choice(string.ascii_letters + string.digits) for _ in range(16))
    return f"static_transform_publisher_{end}"


def _declare_parameters(node: Node, transform: StaticTransform) -> None:
    """Declare the parameters that show what the node publishes; only the command line sets them."""
    from rcl_interfaces.msg import ParameterDescriptor

    (x, y, z), (qx, qy, qz, qw) = transform.translation, transform.rotation
    values: dict[str, Any] = {
        "translation.x": x,
        "translation.y": y,
        "translation.z": z,
        "rotation.x": qx,
        "rotation.y": qy,
        "rotation.z": qz,
        "rotation.w": qw,
        "frame_id": transform.frame_id,
        "child_frame_id": transform.child_frame_id,
    }
    for name, value in values.items():
        node.declare_parameter(name, value, ParameterDescriptor(read_only=True), ignore_override=True)


def _warn(node: Node, options: Namespace, transforms: list[StaticTransform]) -> None:
    log = node.get_logger()
    if options.old:
        log.warning("Old-style arguments are deprecated; see --help for new-style arguments")
    for one in transforms:
        if one.was_normalised:
            log.warning(
                f"The quaternion of {one.child_frame_id} does not have length one; what is published does: "
                f"{one.rotation}"
            )


def _message(transform: StaticTransform, stamp: Any) -> TransformStamped:
    from geometry_msgs.msg import Quaternion, TransformStamped, Vector3

    message = TransformStamped(child_frame_id=transform.child_frame_id)
    message.header.frame_id = transform.frame_id
    message.header.stamp = stamp
    message.transform.translation = Vector3(**dict(zip("xyz", transform.translation, strict=True)))
    message.transform.rotation = Quaternion(**dict(zip("xyzw", transform.rotation, strict=True)))
    return message


def _summary(options: Namespace, transforms: list[StaticTransform]) -> str:
    if options.file is not None:
        return f"Spinning until stopped - publishing {len(transforms)} transforms of {options.file}"
    [one] = transforms
    return (
        "Spinning until stopped - publishing transform\n"
        f"translation: {_quoted(one.translation)}\n"
        f"rotation: {_quoted(one.rotation)}\n"
        f"from '{one.frame_id}' to '{one.child_frame_id}'"
    )


def _quoted(numbers: tuple[float, ...]) -> str:
    return "(" + ", ".join(f"'{number:f}'" for number in numbers) + ")"


# Read static transforms as users write them.


class StaticTransform(NamedTuple):
    """A transform from ``child_frame_id`` to ``frame_id``; the rotation is x y z w, of length one."""

    frame_id: str
    child_frame_id: str
    translation: tuple[float, ...]
    rotation: tuple[float, ...]
    was_normalised: bool  # the rotation had another length

    @classmethod
    def of(cls, fields: Mapping[str, Any]) -> StaticTransform:
        """
        Make a transform from what a user gave.

        :param fields: names and floats, by FRAMES and NUMBERS; None: not given.
        :raises UsageError: a name is missing, or two fields contradict each other.
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
            from tf2_ros_tools.urdf import quaternion_from_rpy

            rotation: tuple[float, ...] = quaternion_from_rpy(*(given.get(name, 0.0) for name in EULER))
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

    :raises UsageError: the file cannot be read, or its contents are wrong.
    """
    entries = enumerate(read_list(path, "--file", "transforms"), start=1)
    transforms = [read_transform(f"{path}: transform {place}", entry) for place, entry in entries]
    try:
        _refuse_no_tree(transforms)
    except UsageError as refusal:
        raise UsageError(f"{path}: {refusal}") from None
    return transforms


_FRAME = Key("a text (quote what looks like a number)", nonempty_text, is_required=True)
_NUMBER = Key("a finite number", number_in(-sys.float_info.max, sys.float_info.max))
KEYS = {**dict.fromkeys(FRAMES, _FRAME), **dict.fromkeys(NUMBERS, _NUMBER)}


def read_transform(label: str, given: Any) -> StaticTransform:
    """
    Read a mapping with the names of FRAMES and NUMBERS.

    :param label: what it is, for errors.
    :raises UsageError: its contents are wrong.
    """
    try:
        return StaticTransform.of(read_keys(label, given, KEYS))
    except ValueError as refusal:
        raise UsageError(str(refusal)) from None
    except UsageError as refusal:
        raise UsageError(f"{label}: {refusal}") from None


def _refuse_no_tree(transforms: list[StaticTransform]) -> None:
    from tf2_ros_tools.urdf import one_in_a_loop

    parents: dict[str, str] = {}
    for one in transforms:
        if one.child_frame_id in parents:
            raise UsageError(f"the frame {one.child_frame_id!r} has two transforms")
        parents[one.child_frame_id] = one.frame_id
    if (frame := one_in_a_loop(parents)) is not None:
        raise UsageError(f"the frame {frame!r} is its own ancestor")


def main(args: list[str] | None = None) -> int:
    """Run the program; see :func:`tf2_ros_tools.program.run`."""
    return run(parser(), publish, args, interrupted=SUCCESS)


if __name__ == "__main__":
    sys.exit(main())
