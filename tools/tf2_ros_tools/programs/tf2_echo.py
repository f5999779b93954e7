# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Print the transform between two frames, repeatedly."""

from __future__ import annotations

import re
import sys
import time
from argparse import ArgumentTypeError, Namespace
from contextlib import suppress
from functools import partial
from math import degrees
from typing import TYPE_CHECKING, Any

from tf2_py.printable import printable
from tf2_ros_tools.common.options import add_live_option, nanoseconds, non_negative_number, positive_number
from tf2_ros_tools.common.output import first_names, show, show_json
from tf2_ros_tools.common.pace import Pace
from tf2_ros_tools.common.program import FAILURE, SUCCESS, Parser, UsageError, run
from tf2_ros_tools.common.roll_pitch_yaw import rpy_from_matrices

if TYPE_CHECKING:
    from geometry_msgs.msg import TransformStamped
    from rclpy.qos import QoSProfile

    from tf2_py import TransformException
    from tf2_ros_tools.listening.session import Session

S = 1_000_000_000  # ns
LATEST = 0  # the time that asks for the latest transform
RATE = 1.0  # prints per second, by default

DIGITS = 3  # after the point, by default
QUEUE_DEPTH = 100  # of dynamic transforms, as that of listeners
MOST_DIGITS = 17  # that a double has
WIDTH = 6  # of the columns of the matrix, at least
REPORT_S = 1.0  # between two log lines about a transform that is not available yet

DESCRIPTION = """\
Print the transform that maps data from the frame SOURCE to the frame TARGET, at 1 Hz or at RATE. Until it \
is available, log the reason and the known frames every second.

With --json, each line is {"header": {"stamp": {"sec", "nanosec"}, "frame_id"}, "child_frame_id", \
"transform": {"translation": {"x", "y", "z"}, "rotation": {"x", "y", "z", "w"}}, "rpy": {"roll", "pitch", \
"yaw"}}, with angles in radians. If a later lookup fails, "error": {"type", "text"} replaces transform \
and rpy.

Exit status: 0 if a transform was printed; 1 if none was available within --wait; 2 after wrong usage; 130 \
if Ctrl-C ended the command before the first transform."""

EXAMPLE = """\
  tf2_echo map base_link -r 10               ten times a second
  tf2_echo map base_link -t 1795608204.5     where it was at this time
  tf2_echo map base_link --once --wait 5     for scripts: check the exit status
  tf2_echo map base_link --json --once       one line, for programs to read"""


def _digits(text: str) -> int:
    if not re.fullmatch("[0-9]{1,2}", text) or int(text) > MOST_DIGITS:
        raise ArgumentTypeError(f"expected a whole number from 0 to {MOST_DIGITS}, got {text}")
    return int(text)


PARSER = Parser("tf2_echo", DESCRIPTION, EXAMPLE)
PARSER.add_argument("target", metavar="TARGET", help="the frame to which data is transformed")
PARSER.add_argument("source", metavar="SOURCE", help="the frame of the data")
PARSER.add_argument("old_rate", metavar="RATE", nargs="?", type=positive_number, help="the same as -r RATE")
PARSER.add_argument("-r", dest="rate", metavar="RATE", type=positive_number, help="rate in Hz; 1 by default")
PARSER.add_argument(
    "-t",
    dest="time_ns",
    metavar="TIME",
    type=nanoseconds,
    default=LATEST,
    help="print the transform at this time, in seconds since 1970; by default, and with 0, the latest one",
)
PARSER.add_argument(
    "-p",
    "--precision",
    metavar="DIGITS",
    type=_digits,
    default=DIGITS,
    help=f"number of decimals; {DIGITS} by default; not used with --json",
)
PARSER.add_argument("--once", action="store_true", help="exit after the first transform")
PARSER.add_argument(
    "--wait",
    metavar="SECONDS",
    type=non_negative_number,
    help="exit with status 1 if there is no transform after this time; by default, wait forever",
)
PARSER.add_argument("--json", action="store_true", help="print one JSON object per line")
PARSER.add_argument(
    "--qos-reliability",
    choices=["reliable", "best_effort"],
    help="reliability of the subscription to /tf; the default, reliable, excludes best-effort publishers",
)
add_live_option(PARSER)


def echo(options: Namespace) -> int:
    """Print until interrupted, or as the options say; return the exit status."""
    from tf2_py import TransformException
    from tf2_ros_tools.listening.session_choice import session

    if None not in (options.rate, options.old_rate):
        raise UsageError("expected RATE or -r RATE, got both")
    rate = options.rate or options.old_rate or RATE
    show_transform = _show_json if options.json else _show_text
    qos = _profile(options)
    with session("tf2_echo", options, qos=qos) as heard:
        buffer = heard.buffer
        transform = _first(heard, options)
        if transform is None:
            return FAILURE
        pace = Pace(1.0 / rate)
        with suppress(KeyboardInterrupt):
            show_transform(transform, options)
            while not options.once:
                time.sleep(pace.next_s())
                heard.require_open()
                try:
                    transform = buffer.lookup_transform(options.target, options.source, options.time_ns)
                    show_transform(transform, options)
                except TransformException as reason:
                    _print_failure(heard, options, reason)
        return SUCCESS


def _profile(options: Namespace) -> QoSProfile | None:
    """The profile for dynamic transforms; None: that of listeners."""
    if options.qos_reliability is None:
        return None
    from rclpy.qos import QoSProfile, ReliabilityPolicy

    return QoSProfile(depth=QUEUE_DEPTH, reliability=ReliabilityPolicy[options.qos_reliability.upper()])


def _first(heard: Session, options: Namespace) -> TransformStamped | None:
    """Wait for the first transform; None: there is none after the time that the options say."""
    from tf2_py import InvalidArgumentException, TransformException

    begin_s = time.monotonic()
    while True:
        heard.require_open()
        waited_s = time.monotonic() - begin_s
        timeout_s = REPORT_S if options.wait is None else min(REPORT_S, max(0.0, options.wait - waited_s))
        try:
            return heard.buffer.lookup_transform(options.target, options.source, options.time_ns, timeout_s)
        except InvalidArgumentException as refusal:
            raise UsageError(str(refusal)) from None
        except TransformException as reason:
            waited_s = time.monotonic() - begin_s
            why = re.sub(r" Waited \S+ s$", "", str(reason))  # the wait of this lookup, not of all
            heard.info(
                printable(f"Waiting for transform {options.target} ->  {options.source}: {why}") + "\n"
                f"Listening {heard.where} for {waited_s:.1f} s\n"
                f"Known frames: {first_names(sorted(heard.buffer.frames())) or 'none'}"
            )
            if options.wait is not None and waited_s >= options.wait:
                return None


def _print_failure(heard: Session, options: Namespace, reason: TransformException) -> None:
    sec, nanosec = divmod(heard.now_ns(), S)
    if options.json:
        content = {
            "header": {"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": options.target},
            "child_frame_id": options.source,
            "error": {"type": type(reason).__name__, "text": str(reason)},
        }
        show_json(content)
        return
    show(f"Failure at {sec + nanosec / S:.3f}", f"Exception thrown:{reason}")
    # The listing ends with a line break, and tf2's own program adds another one.
    show("The current list of frames is:", *heard.buffer.all_frames_as_string().split("\n"))


# What is printed of a transform: as tf2's own program does, or as JSON.


def _show_text(transform: TransformStamped, options: Namespace) -> None:
    from tf2_ros.numpy import to_matrix

    digits: int = options.precision

    def listed(*values: float) -> str:
        return "[" + ", ".join(f"{value:.{digits}f}" for value in values) + "]"

    stamp = transform.header.stamp
    v, q = transform.transform.translation, transform.transform.rotation
    matrix = to_matrix(transform)
    rpy = rpy_from_matrices(matrix).tolist()
    width = max(WIDTH, digits + len("-0."))
    show(
        f"At time {stamp.sec}.{stamp.nanosec:09d}",
        f"- Translation: {listed(v.x, v.y, v.z)}",
        f"- Rotation: in Quaternion (xyzw) {listed(q.x, q.y, q.z, q.w)}",
        f"- Rotation: in RPY (radian) {listed(*rpy)}",
        f"- Rotation: in RPY (degree) {listed(*map(degrees, rpy))}",
        "- Matrix:",
        *("".join(f" {value:{width}.{digits}f}" for value in row) for row in matrix.tolist()),
    )


def _show_json(transform: TransformStamped, _: Namespace) -> None:
    from tf2_ros.numpy import to_matrix

    moved, header = transform.transform, transform.header
    rpy = rpy_from_matrices(to_matrix(transform)).tolist()
    content = {
        "header": {"stamp": _fields(header.stamp), "frame_id": header.frame_id},
        "child_frame_id": transform.child_frame_id,
        "transform": {"translation": _fields(moved.translation), "rotation": _fields(moved.rotation)},
        "rpy": dict(zip(("roll", "pitch", "yaw"), rpy, strict=True)),
    }
    show_json(content)


def _fields(message: Any) -> dict[str, float]:
    """The numbers of a message of ROS, or of what stands in for one."""
    names = ("sec", "nanosec") if hasattr(message, "sec") else ("x", "y", "z", "w")
    return {name: getattr(message, name) for name in names if hasattr(message, name)}


main = partial(run, PARSER, echo)

if __name__ == "__main__":
    sys.exit(main())
