# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Provide the options of a check, and the kinds of findings."""

from argparse import ArgumentParser
from pathlib import Path

from tf2_ros_tools.common.options import non_negative_number, positive_number

# The kinds of findings, in the order in which they are reported; docs/programs/tf2_check.md explains them.
# Causes come first: of what follows from them, there may be one finding for each frame.
KINDS = tuple(
    "nothing qos clock clocks malformed lost parents publishers mixed values refused unnormalized unset "
    "missing parent static headers roots loop future delay stale gap rate".split()
)


def add_check_options(made: ArgumentParser) -> None:
    """Add the options for expectations, limits and ignored kinds."""
    summary = "report differences from this YAML file; tf2_check -h ends with an example"
    made.add_argument("--expect", metavar="FILE", type=Path, help=summary)
    summary = "minimum rate of each dynamic frame"
    made.add_argument("--min-rate", type=positive_number, metavar="HZ", help=summary)
    made.add_argument(
        "--max-delay",
        type=non_negative_number,
        metavar="S",
        help="maximum delay of each dynamic transform; by default, the average delay of a frame may be 1 s "
        "or 3 of its periods, whichever is longer",
    )
    made.add_argument(
        "--ignore",
        action="append",
        choices=KINDS,
        metavar="KIND",
        default=[],
        help="do not report this kind of problem; may be given several times; the kinds are "
        f"{', '.join(KINDS)}",
    )
