# PYTHON_ARGCOMPLETE_OK
"""Owns the command line of the program that publishes static transforms."""

from argparse import Namespace
from pathlib import Path

from tf2_ros_cython.cli._numbers import finite_number
from tf2_ros_cython.cli._program import Parser, UsageError, run
from tf2_ros_cython.cli._static_transforms import (
    EULER,
    FRAMES,
    NUMBERS,
    QUATERNION,
    TRANSLATION,
    StaticTransform,
    numbered,
    read_file,
)

__all__ = ["main", "transforms_of"]

DESCRIPTION = """\
Publish the transform from a child frame to its parent on /tf_static, until interrupted. What is not given \
is that of the identity. Lengths are in metres, angles in radians.

The old form, X Y Z YAW PITCH ROLL FRAME_ID CHILD_FRAME_ID or X Y Z QX QY QZ QW FRAME_ID CHILD_FRAME_ID, \
works, too, with a warning."""

EXAMPLE = """\
  static_transform_publisher --x 0.3 --yaw -1.57 --frame-id base_link --child-frame-id camera
  static_transform_publisher --file transforms.yaml

where transforms.yaml has the names of the options:
  - {frame_id: base_link, child_frame_id: camera, x: 0.3, yaw: -1.57}
  - {frame_id: base_link, child_frame_id: lidar, z: 0.5, qx: 0.0, qy: 0.0, qz: 1.0, qw: 0.0}"""

# What a value of the old form is, by how many values there are: Euler angles, or a quaternion.
OLD_FORMS = {
    8: (*TRANSLATION, *reversed(EULER), *FRAMES),
    9: (*TRANSLATION, *QUATERNION, *FRAMES),
}


def parser() -> Parser:
    """Its command line."""
    made = Parser("static_transform_publisher", DESCRIPTION, EXAMPLE)
    made.add_argument("--frame-id", metavar="FRAME_ID", help="the parent frame; required without --file")
    made.add_argument("--child-frame-id", metavar="CHILD_FRAME_ID", help="the child frame; the same")
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
    What a command line asks to publish.

    :raises UsageError: it contradicts itself, or lacks something.
    """
    given = [name for name in (*FRAMES, *NUMBERS) if getattr(options, name) is not None]
    if options.old:
        return [_of_old_form(options.old, given, options.file)]
    if options.file is None:
        return [StaticTransform.of(vars(options))]
    if given:
        raise UsageError("with --file, the file alone says what to publish")
    return read_file(options.file)


def _of_old_form(values: list[str], given: list[str], file: Path | None) -> StaticTransform:
    names = OLD_FORMS.get(len(values))
    if names is None:
        raise UsageError(f"there are {len(values)} values without options; the old form has 8 or 9")
    if given or file is not None:
        raise UsageError("either options or the old form; both were given")
    return StaticTransform.of(numbered(dict(zip(names, values, strict=True))))


def main(args: list[str] | None = None) -> int:
    """Run the program; see :func:`tf2_ros_cython.cli._program.run`."""
    return run(parser(), "tf2_ros.cli.static_transform_publisher:publish", args)
