# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Publish static transforms from options, from a file, or of a recording."""

from __future__ import annotations

import secrets
import sys
from argparse import Namespace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from tf2_py.printable import counted, printable
from tf2_ros_tools.common.options import add_topic_option, by_topic, finite_number
from tf2_ros_tools.common.program import SUCCESS, Parser, RunError, UsageError, run, wait_until_interrupted
from tf2_ros_tools.common.static_transforms import (
    ENTRY,
    EULER,
    FRAMES,
    NUMBERS,
    QUATERNION,
    TRANSLATION,
    normalize,
    read_file,
    transform_of,
)

if TYPE_CHECKING:
    from geometry_msgs.msg import TransformStamped

DESCRIPTION = """\
Publish the transform from a child frame to its parent on /tf_static, until interrupted. Omitted values \
default to the identity. Lengths are in meters, angles in radians. Give the rotation either as a quaternion \
(--qx, --qy, --qz, --qw) or as angles (--roll, --pitch, --yaw).

The old form, X Y Z YAW PITCH ROLL FRAME_ID CHILD_FRAME_ID or X Y Z QX QY QZ QW FRAME_ID CHILD_FRAME_ID, \
also works, with a warning.

--recording publishes all static transforms of a recording, also those that 'ros2 bag play' omits because \
it starts later.

Exit status: 0 when interrupted; 1 if publishing failed, or if the recording cannot be read or has no static \
transforms; 2 after wrong usage."""

EXAMPLE = f"""\
  static_transform_publisher --x 0.3 --yaw -1.57 --frame-id base_link --child-frame-id camera
  static_transform_publisher --file transforms.yaml
  static_transform_publisher --recording drive.mcap
  static_transform_publisher --recording drive.mcap --topic /robot1/tf_static=robot1/

where transforms.yaml has the options as keys, with _ for -:
  - {ENTRY}
  - {{frame_id: base_link, child_frame_id: lidar, z: 0.5, qx: 0.0, qy: 0.0, qz: 1.0, qw: 0.0}}"""

# The meaning of the values of the old form, by their number: with Euler angles, or with a quaternion.
OLD_FORMS = {8: (*TRANSLATION, *reversed(EULER), *FRAMES), 9: (*TRANSLATION, *QUATERNION, *FRAMES)}

PARSER = Parser("static_transform_publisher", DESCRIPTION, EXAMPLE)
WITHOUT = "required without --file and --recording"
PARSER.add_argument("--frame-id", metavar="FRAME_ID", help=f"the parent frame; {WITHOUT}")
PARSER.add_argument("--child-frame-id", metavar="CHILD_FRAME_ID", help=f"the child frame; {WITHOUT}")
meanings = {
    **{name: f"{name} of the translation" for name in TRANSLATION},
    **{name: f"{name[1]} of the rotation, a quaternion" for name in QUATERNION},
    **{name: f"rotation about the fixed {axis} axis" for name, axis in zip(EULER, "xyz", strict=True)},
}
for name, meaning in meanings.items():
    PARSER.add_argument(f"--{name}", type=finite_number, help=meaning)
PARSER.add_argument(
    "--file",
    metavar="YAML",
    type=Path,
    help="publish the transforms in this file, instead of the options above",
)
PARSER.add_argument(
    "--recording",
    metavar="RECORDING",
    type=Path,
    help="publish the static transforms of this recording (a rosbag2 folder, .mcap, .db3 or .bag) instead: "
    "of each frame, the last one on /tf_static",
)
add_topic_option(PARSER, "with --recording: publish the transforms on this topic instead of /tf_static")
PARSER.add_argument("old", metavar="VALUE", nargs="*", help="the old form; see above")


def transforms_of(options: Namespace) -> list[TransformStamped]:
    """
    Get the transforms that the command line asks to publish.

    :raises UsageError: it contradicts itself, or lacks something.
    :raises RunError, OSError: the recording cannot be read, or has no static transforms.
    """
    given = {name: value for name in (*FRAMES, *NUMBERS) if (value := getattr(options, name)) is not None}
    if sum(map(bool, (given, options.old, options.file, options.recording))) > 1:
        expected = "options, values of the old form, --file, or --recording"
        raise UsageError(f"expected {expected}, got several of these")
    if options.recording is not None:
        return _recorded(options)
    if options.topics is not None:
        raise UsageError("--topic chooses topics of a recording, which --recording names")
    try:
        if options.file is not None:
            return read_file(options.file)
        if not options.old:
            for name in FRAMES:
                if name not in given:
                    raise UsageError(f"--{name.replace('_', '-')} is {WITHOUT}")
            return [transform_of("the options", given)]
        names = OLD_FORMS.get(len(options.old))
        if names is None:
            raise UsageError(f"expected 8 or 9 values in the old form, got {len(options.old)}")
        return [transform_of("the old form", dict(zip(names, options.old, strict=True)))]
    except ValueError as refusal:
        raise UsageError(str(refusal)) from None


def _recorded(options: Namespace) -> list[TransformStamped]:
    from tf2_ros_tools.recordings.bag_loader import TOPICS, static_transforms
    from tf2_ros_tools.recordings.bag_reader import BagError

    try:
        topics = TOPICS if options.topics is None else by_topic("--topic", options.topics)
        transforms, notes = static_transforms(options.recording, topics)
    except BagError as failure:
        raise RunError(str(failure)) from None
    for text in notes:
        options.parser.warn(text)
    return transforms


def publish(options: Namespace) -> NoReturn:
    """Publish until interrupted."""
    from tf2_ros_tools.nodes.node_session import spun_node

    from tf2_ros import StaticTransformBroadcaster

    transforms = transforms_of(options)
    # Many of them run on one robot.
    with spun_node(f"static_transform_publisher_{secrets.token_hex(8)}", options) as node:
        log, stamp = node.get_logger(), node.get_clock().now().to_msg()
        if options.old:
            log.warning("Old-style arguments are deprecated; see --help for new-style arguments")
        for one in transforms:
            one.header.stamp = stamp
            if (length := normalize(one)) is not None:
                text = f"Normalized the quaternion of {one.child_frame_id}, whose length is {length:g}"
                log.warning(printable(text))
        log.info(_summary(options, transforms))
        StaticTransformBroadcaster(node).sendTransform(transforms)
        wait_until_interrupted()


def _summary(options: Namespace, transforms: list[TransformStamped]) -> str:
    if (origin := options.file or options.recording) is not None:
        return printable(
            f"Spinning until stopped - publishing {counted(len(transforms), 'transform')} of {origin}"
        )
    [one] = transforms
    t, q = one.transform.translation, one.transform.rotation
    return (
        "Spinning until stopped - publishing transform\n"
        f"translation: {tuple(f'{number:f}' for number in (t.x, t.y, t.z))}\n"
        f"rotation: {tuple(f'{number:f}' for number in (q.x, q.y, q.z, q.w))}\n"
        f"from '{printable(one.header.frame_id)}' to '{printable(one.child_frame_id)}'"
    )


main = partial(run, PARSER, publish, interrupted=SUCCESS)

if __name__ == "__main__":
    sys.exit(main())
