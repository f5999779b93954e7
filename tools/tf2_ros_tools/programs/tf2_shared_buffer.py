"""Share one buffer with all processes on a machine."""

import os
import sys
from argparse import Namespace
from functools import partial
from typing import NoReturn

from tf2_ros_tools.program import EXIT_STATUS, SUCCESS, Parser, RunError, UsageError, non_negative_number, run

DESCRIPTION = """\
Receive transforms into a buffer, and share it with all processes of this user on this machine, until \
interrupted. Processes whose environment contains TF2_SHARED_BUFFER=auto, or =NAME, read this buffer instead \
of subscribing on their own."""

EXAMPLE = """\
  tf2_shared_buffer                                      named domain-N, where N is the ROS domain
  tf2_shared_buffer --name simulated --cache-time 30 --ros-args -p use_sim_time:=true"""


PARSER = Parser("tf2_shared_buffer", f"{DESCRIPTION}\n\n{EXIT_STATUS}", EXAMPLE)
PARSER.add_argument(
    "--name",
    metavar="NAME",
    default="auto",
    help="name of the shared buffer; by default auto, which stands for domain-N in the ROS domain N",
)
PARSER.add_argument(
    "--cache-time",
    type=non_negative_number,
    metavar="S",
    help="how far each frame's history reaches back, in seconds; 10 by default",
)


def share(options: Namespace) -> NoReturn:
    """Share what is received until interrupted."""
    from tf2_ros_tools.spun_node import spun_node

    from tf2_ros import Buffer, SharedBufferError, TransformListener
    from tf2_ros_tools.listening import TOPICS, wait

    with spun_node("tf2_shared_buffer", options) as node:
        domain = node.context.get_domain_id()
        name = f"domain-{domain}" if options.name == "auto" else options.name
        try:
            buffer = Buffer(options.cache_time, node, share=name)
        except ValueError as refusal:
            raise UsageError(str(refusal)) from None
        except (SharedBufferError, NotImplementedError) as failure:  # the second is not on Linux
            raise RunError(str(failure)) from None
        with TransformListener(buffer, node):
            topics = " and ".join(map(node.resolve_topic_name, TOPICS))
            node.get_logger().info(
                f"Sharing {topics} of ROS domain {domain} as {name!r}: process {os.getpid()}, "
                f"keeps {buffer.cache_time_ns / 1e9:g} s"
            )
            wait()


main = partial(run, PARSER, share, interrupted=SUCCESS)

if __name__ == "__main__":
    sys.exit(main())
