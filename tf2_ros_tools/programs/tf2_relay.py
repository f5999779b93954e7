"""Send chosen transforms on to other topics."""

from __future__ import annotations

import sys
from argparse import Namespace
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import NoReturn

from tf2_ros_tools.output import printable
from tf2_ros_tools.program import SUCCESS, Parser, run

DESCRIPTION = """\
Send transforms on to other topics, until interrupted, by the rules in a YAML file: chosen frames, at a \
lower rate, only what has moved, chains of frames as one transform, under other names, or as poses.

docs/programs/tf2_relay.md explains the rules."""

EXAMPLE = """\
  tf2_relay relay.yaml

where relay.yaml contains, for example:
  - {to: [/remote/tf, /remote/tf_static], frames: [map, base_link], collapse: true, rate: 5}"""


PARSER = Parser("tf2_relay", DESCRIPTION, EXAMPLE)
PARSER.add_argument("rules", metavar="FILE", type=Path, help="the YAML file with the rules")


def relay(options: Namespace) -> NoReturn:
    """Relay until interrupted."""
    from tf2_ros_tools.listening import spun_node

    from tf2_ros_tools.relay import Relaying

    with spun_node("tf2_relay", options) as node, ExitStack() as stack:
        relaying = Relaying(node, options.rules, stack)
        node.get_logger().info(printable(f"Relaying by the rules of {options.rules}"))
        relaying.run()


main = partial(run, PARSER, relay, interrupted=SUCCESS)

if __name__ == "__main__":
    sys.exit(main())
