# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Send chosen transforms on to other topics."""

from __future__ import annotations

import sys
from argparse import Namespace
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import NoReturn

from tf2_py.printable import printable
from tf2_ros_tools.common.program import EXIT_STATUS, SUCCESS, Parser, run

DESCRIPTION = """\
Send chosen transforms to other topics, by the rules in a YAML file, until interrupted. A rule can lower \
the rate, omit frames that did not move, send a chain of frames as one transform, rename frames, or send \
poses."""

EXAMPLE = """\
  tf2_relay relay.yaml

where relay.yaml contains, for example:
  - {to: [/remote/tf, /remote/tf_static], frames: [map, base_link], collapse: true, rate: 5}
  - {to: /robot1/pose, as: PoseStamped, frames: [map, base_link], rate: 20}

keys of a rule:
  to         two topics, for dynamic and static transforms; with `as`, one topic; required
  from       the two topics that are read; by default [/tf, /tf_static]
  name       the rule's name in logs and errors
  frames     send these frames, and all frames between them; without `frames` and `subtree`, all frames
  subtree    send this frame, or these, with all frames below
  exclude    leave out this frame, or these, with all frames below
  collapse   true: leave out the frames between the chosen ones
  rate       send at most this often, in Hz, from 0.0001 to 1000; 10 by default
  threshold  {translation: METERS, rotation: RADIANS, repeat: SECONDS}: send a frame only when it has
             moved by more than this, and at least every `repeat` seconds (1 by default)
  rename     {OLD: NEW}: new names for frames
  prefix     put this before the names of frames not in `rename`
  as         PoseStamped: send the pose of the second of two `frames` in the first one"""


PARSER = Parser("tf2_relay", f"{DESCRIPTION}\n\n{EXIT_STATUS}", EXAMPLE)
PARSER.add_argument("rules", metavar="FILE", type=Path, help="the YAML file with the rules")


def relay(options: Namespace) -> NoReturn:
    """Relay until interrupted."""
    from tf2_ros_tools.nodes.spun_node import spun_node

    from tf2_ros_tools.nodes.relay import Relaying

    with spun_node("tf2_relay", options) as node, ExitStack() as stack:
        relaying = Relaying(node, options.rules, stack)
        node.get_logger().info(printable(f"Relaying with the rules in {options.rules}"))
        relaying.run()


main = partial(run, PARSER, relay, interrupted=SUCCESS)

if __name__ == "__main__":
    sys.exit(main())
