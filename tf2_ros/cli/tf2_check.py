"""Owns the program that says whether the transforms of a robot are as they must be."""

import sys

from tf2_ros_cython.cli.tf2_check import main

if __name__ == "__main__":  # before what needs ROS: `main` says in one line what is missing
    sys.exit(main())

from tf2_ros_cython import _requirement  # noqa: F401

# isort: split

from argparse import Namespace

from tf2_py._internal import counted
from tf2_ros._traffic.findings import Limits
from tf2_ros.cli._listening import listening
from tf2_ros.cli._node import spun_node
from tf2_ros.cli._verdicts import (
    expected_by,
    line_of,
    not_ignored,
    refuse_unknown_kinds,
    verdict_of,
    write_junit,
)
from tf2_ros_cython.cli._program import FAILURE, SUCCESS

__all__ = ["check", "main"]


def check(options: Namespace) -> int:
    """Listen, print what is wrong, and return the exit status."""
    expected = expected_by(options)
    refuse_unknown_kinds(options)
    with spun_node("tf2_check", options) as node, listening(node) as heard:
        heard.listen(options.t)
        report = heard.report(Limits(min_rate=options.min_rate), expected)
    wrong = not_ignored(report.findings, options)
    for finding in wrong:
        print(line_of(finding))
    print(verdict_of(wrong, report.streams, f"{counted(report.messages, 'message')} and {options.t:g} s"))
    for count, what in (
        (report.lost, "transforms arrived too fast to be checked"),
        (report.malformed, "messages could not be read"),
    ):
        if count:
            print(f"{count} {what}", file=sys.stderr)
    if options.junit is not None:
        write_junit(options.junit, "tf2_check", wrong, options.ignore, options.t)
    return FAILURE if wrong else SUCCESS
