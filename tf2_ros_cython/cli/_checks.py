"""Owns the options of the programs that say whether transforms are as they must be."""

from argparse import ArgumentParser

from tf2_ros_cython.cli._numbers import positive_number

__all__ = ["add_check_options"]


def add_check_options(made: ArgumentParser) -> None:
    """Add what is expected, what is ignored, and where the result is written."""
    made.add_argument("--expect", metavar="FILE", help="what frames must be like, in YAML")
    made.add_argument("--junit", metavar="FILE", help="write the result as JUnit's XML, too")
    made.add_argument(
        "--min-rate", type=positive_number, metavar="HZ", help="how often dynamic frames must be published"
    )
    made.add_argument(
        "--ignore",
        action="append",
        metavar="KIND",
        default=[],
        help="not wrong here; the first word of a line",
    )
