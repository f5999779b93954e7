"""Show the frames of a running robot in 3D."""

import subprocess
import sys
import time
from argparse import Namespace
from collections.abc import Callable
from functools import partial
from itertools import count
from typing import TYPE_CHECKING

from tf2_py.printable import printable
from tf2_ros_tools.output import not_known, write_whole
from tf2_ros_tools.program import SUCCESS, Parser, RunError, ending_in, run

if TYPE_CHECKING:
    from tf2_ros_tools.listening import Pace
    from tf2_ros_tools.rerun import Live

PERIOD_S = 0.1  # from one batch to the next
CHECK_AFTER = 50  # batches, by which publishers are found

DESCRIPTION = """\
Show the frames of a running robot in 3D in the viewer rerun: their axes, their names, and a timeline of the \
past. The command runs until the viewer is closed, or until it is interrupted.

Exit status: 0 at the end; 1 if the viewer did not open; 2 after wrong usage."""

EXAMPLE = """\
  tf2_view                            all frames, in a window
  tf2_view --web                      in a browser; the address is printed
  tf2_view --trail base_link camera   with the paths of two frames
  tf2_view -o live.rrd                into a file, which rerun live.rrd opens"""


PARSER = Parser("tf2_view", DESCRIPTION, EXAMPLE)
where = PARSER.add_mutually_exclusive_group()
where.add_argument("--web", action="store_true", help="serve the viewer to browsers on this machine")
where.add_argument(
    "-o",
    "--output",
    metavar="FILE",
    type=ending_in("rrd"),
    help="write this .rrd file instead of opening the viewer",
)
PARSER.add_argument(
    "--trail",
    nargs="+",
    metavar="FRAME",
    default=[],
    help="draw the paths of these frames over the last 10 seconds",
)
PARSER.add_argument(
    "--origin", metavar="FRAME", help="the frame that does not move; by default the root of the largest tree"
)


def view(options: Namespace) -> int:
    """Listen, and send what arrives; return the exit status."""
    from tf2_ros_tools.node_session import NodeSession, filled_buffer
    from tf2_ros_tools.spun_node import spun_node

    from tf2_py import stored_name
    from tf2_ros_tools.listening import TOPICS, Pace
    from tf2_ros_tools.rerun import Live, ViewerError, open_viewer

    trails = [*map(stored_name, options.trail)]
    origin = None if options.origin is None else stored_name(options.origin)
    try:
        with spun_node("tf2_view", options) as node, filled_buffer(node) as buffer:

            def check_names() -> None:
                known = buffer.frames()
                for name in {*trails, *([] if origin is None else [origin])} - known.keys():
                    node.get_logger().warning(not_known(name, known))
                if not known:
                    where = NodeSession(node, buffer, TOPICS).where
                    node.get_logger().warning(f"no transform was received {where}")

            live = Live(buffer, origin=origin, trails=trails)
            if options.output is not None:
                write_whole(options.output, b"")  # rerun would raise its own error
                live.recording.save(options.output)
                node.get_logger().info(printable(f"Writing {options.output} until interrupted"))
                _send(live, Pace(PERIOD_S), check_names)
            with open_viewer(live.recording, web=options.web) as (viewer, page):
                if page is not None:
                    node.get_logger().info(f"The viewer is at {page}")
                _send(live, Pace(PERIOD_S), check_names, viewer)
    except ViewerError as failure:
        advice = "" if options.web else "; --web and -o FILE do not need a screen"
        raise RunError(f"{failure}{advice}") from None
    return SUCCESS


def _send(
    live: "Live",
    pace: "Pace",
    check_names: Callable[[], None],
    viewer: "subprocess.Popen[bytes] | None" = None,
) -> None:
    """Send batches until interrupted, or until the viewer is closed; check the names once."""
    for number in count():
        if viewer is not None and viewer.poll() is not None:
            return
        live.send()
        if number == CHECK_AFTER:
            check_names()
        time.sleep(pace.next_s())


main = partial(run, PARSER, view, interrupted=SUCCESS)

if __name__ == "__main__":
    sys.exit(main())
