# PYTHON_ARGCOMPLETE_OK
"""Owns the command line of the program that shows who publishes which frame, how often, and how late."""

from tf2_ros_cython.cli._numbers import positive_number
from tf2_ros_cython.cli._program import Parser, run

__all__ = ["main"]


def parser() -> Parser:
    """Its command line."""
    made = Parser(
        "tf2_monitor",
        "Show for each frame its parent, its publisher, how often it is published, how old its transforms "
        "are when they are received, and what is wrong with it, until interrupted. On a terminal this is a "
        "table that is renewed every second, where rich is installed; otherwise a report every ten "
        "seconds.\n\n"
        "With two frames: what connects them, and how old the newest transform between them is.",
        "  tf2_monitor map base_link --interval 5",
    )
    made.add_argument("frames", nargs="*", metavar="FRAME", help="two frames, to show what connects them")
    made.add_argument(
        "--interval", type=positive_number, metavar="S", help="print a report every S seconds, and no table"
    )
    made.add_argument(
        "--window",
        type=positive_number,
        metavar="S",
        default=10.0,
        help="the figures are those of the last S seconds; 10 by default",
    )
    made.add_argument(
        "--min-rate",
        type=positive_number,
        metavar="HZ",
        help="warn of dynamic frames that are published less often",
    )
    made.add_argument("--json", action="store_true", help="print each report as one line of JSON")
    return made


def main(args: list[str] | None = None) -> int:
    """Run the program; see :func:`tf2_ros_cython.cli._program.run`."""
    return run(parser(), "tf2_ros.cli.tf2_monitor:monitor", args)
