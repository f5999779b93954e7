# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Publish the transforms of a robot's joints, from its URDF and joint states."""

from __future__ import annotations

import sys
from argparse import Namespace
from functools import partial
from pathlib import Path
from typing import NoReturn

from tf2_ros_tools.common.program import (
    EXIT_STATUS,
    SUCCESS,
    Parser,
    UsageError,
    run,
    wait_until_interrupted,
)

DESCRIPTION = """\
Publish a robot's transforms until interrupted: fixed joints on /tf_static, and movable joints on /tf, for \
each message on joint_states. The URDF is also published, on robot_description."""

EXAMPLE = """\
  tf2_state_publisher robot.urdf
  tf2_state_publisher robot.urdf --ros-args -p publish_frequency:=100.0 -p frame_prefix:=robot1/

parameters, as in robot_state_publisher:
  robot_description  the URDF, if no file is given
  publish_frequency  maximum rate of each joint, in Hz; 20 by default
  frame_prefix       a prefix for the names of all frames
  ignore_timestamp   publish every joint state, whatever its stamp"""


PARSER = Parser("tf2_state_publisher", f"{DESCRIPTION}\n\n{EXIT_STATUS}", EXAMPLE)
PARSER.add_argument(
    "file", nargs="?", type=Path, metavar="URDF", help="the URDF; by default, the parameter robot_description"
)


def publish(options: Namespace) -> NoReturn:
    """Publish until interrupted."""
    from tf2_ros_tools.nodes.spun_node import spun_node

    from tf2_ros_tools.nodes.state_publisher import StatePublisher
    from tf2_ros_tools.urdf import decoded

    description = ""
    if options.file is not None:
        try:
            description = decoded(options.file.read_bytes())
        except OSError as failure:
            raise UsageError(f"cannot read {options.file}: {failure.strerror}") from None
        except (ValueError, LookupError) as refusal:
            raise UsageError(f"{options.file}: {refusal}") from None
    # The name under which files of parameters configure it.
    with spun_node("robot_state_publisher", options) as node:
        StatePublisher(node, description)
        wait_until_interrupted()


main = partial(run, PARSER, publish, interrupted=SUCCESS)

if __name__ == "__main__":
    sys.exit(main())
