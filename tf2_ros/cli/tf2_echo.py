"""Owns the program that prints a transform again and again."""

import sys

from tf2_ros_cython.cli.tf2_echo import STAMPS_END_NS, main

if __name__ == "__main__":  # before what needs ROS: `main` says in one line what is missing
    sys.exit(main())

from tf2_ros_cython import _requirement  # noqa: F401

# isort: split

import json
import time
from argparse import Namespace
from math import degrees, isfinite
from typing import Any

from geometry_msgs.msg import TransformStamped
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.time import Time

from tf2_py import InvalidArgumentException, TransformException
from tf2_py._internal import printable
from tf2_ros.buffer import Buffer
from tf2_ros.cli._node import filled_buffer, spun_node
from tf2_ros.numpy import to_matrix
from tf2_ros_cython.cli._program import ENDINGS, FAILURE, SUCCESS, UsageError, sleep
from tf2_ros_cython.cli._rpy import rpy_from_matrix

__all__ = ["echo", "main"]

S = 1_000_000_000  # ns
DIGITS = 3  # after the point
REPORT_NS = 1 * S  # between two lines about a transform that is not available yet
MOST_NAMES = 20  # in such a line
LONGEST_NS = 365 * 86400 * S  # of a wait


def echo(options: Namespace) -> int:
    """Print until interrupted, or as the options say; return the exit status."""
    with spun_node("tf2_echo", options) as node, filled_buffer(node) as buffer:
        echoing = _Echo(node, buffer, options)
        try:
            echoing.run()
        except ENDINGS:
            if not echoing.found:
                raise
        return SUCCESS if echoing.found else FAILURE


class _Echo:
    """The lookups of one run."""

    def __init__(self, node: Node, buffer: Buffer, options: Namespace) -> None:
        self.found = False  # a transform, at least once
        self._node = node
        self._buffer = buffer
        self._options = options
        self._format = _Json(options) if options.json else _Text(options)
        wait_ns = None if options.wait is None else round(min(options.wait * S, LONGEST_NS))
        self._give_up_ns = None if wait_ns is None else time.monotonic_ns() + wait_ns

    def run(self) -> None:
        """Look up and print, until there was one transform if that is all, or none for too long."""
        period_ns = max(1, round(min(S / self._options.rate, LONGEST_NS)))
        next_ns = time.monotonic_ns()
        while True:
            next_ns = max(next_ns + (period_ns if self.found else REPORT_NS), time.monotonic_ns())
            if not self.found and self._give_up_ns is not None:
                next_ns = min(next_ns, self._give_up_ns)
            try:
                transform = self._look_up(next_ns)
            except InvalidArgumentException as refusal:
                raise UsageError(str(refusal)) from None
            except TransformException as reason:
                if self.found:
                    print(self._format.failure(self._now(), reason, self._buffer))
                else:
                    self._log_waiting(reason)
                    if self._give_up_ns is not None and time.monotonic_ns() >= self._give_up_ns:
                        return
            else:
                if not self.found:
                    next_ns = time.monotonic_ns() + period_ns
                self.found = True
                print(self._format.success(transform))
                if self._options.once:
                    return
            sleep(max(0, next_ns - time.monotonic_ns()) / S)

    def _look_up(self, until_ns: int) -> TransformStamped:
        # It is printed when it arrives, and not at a moment that has nothing to do with that.
        timeout = Duration(nanoseconds=max(0, until_ns - time.monotonic_ns()))
        return self._buffer.lookup_transform(
            self._options.target, self._options.source, self._when(), timeout
        )

    def _when(self) -> Time:
        if self._options.offset_ns is None:
            return Time(nanoseconds=self._options.time_ns)
        # Not 0, which is the latest time: simulated time begins there.
        time_ns = self._now().nanoseconds + self._options.offset_ns
        return Time(nanoseconds=min(max(1, time_ns), STAMPS_END_NS - 1))

    def _now(self) -> Time:
        return self._node.get_clock().now()

    def _log_waiting(self, reason: TransformException) -> None:
        names = sorted(self._buffer._getFrameStrings())
        known = printable(", ".join(names[:MOST_NAMES])) or "none"
        if len(names) > MOST_NAMES:
            known += f" and {len(names) - MOST_NAMES} more"
        self._node.get_logger().info(
            f"Waiting for transform {self._options.target} ->  {self._options.source}: {reason}\n"
            f"Known frames: {known}"
        )


class _Text:
    """What tf2's own program prints, field by field."""

    def __init__(self, options: Namespace) -> None:
        self._digits = DIGITS if options.precision is None else options.precision

    def success(self, transform: TransformStamped) -> str:
        stamp = transform.header.stamp
        v, q = transform.transform.translation, transform.transform.rotation
        matrix = to_matrix(transform)
        rpy = rpy_from_matrix(matrix)
        lines = [
            f"At time {stamp.sec}.{stamp.nanosec:09d}",
            f"- Translation: {self._list(v.x, v.y, v.z)}",
            f"- Rotation: in Quaternion {self._list(q.x, q.y, q.z, q.w)}",
            f"- Rotation: in RPY (radian) {self._list(*rpy)}",
            f"- Rotation: in RPY (degree) {self._list(*map(degrees, rpy))}",
            "- Matrix:",
        ]
        width = self._digits + len("-0.")
        for row in matrix.tolist():
            lines.append("".join(f" {value:{width}.{self._digits}f}" for value in row))
        return "\n".join(lines)

    def failure(self, now: Time, reason: TransformException, buffer: Buffer) -> str:
        return (
            f"Failure at {now.nanoseconds / S:.3f}\n"
            f"Exception thrown:{reason}\n"
            f"The current list of frames is:\n{buffer.all_frames_as_string()}"
        )

    def _list(self, *values: float) -> str:
        return "[" + ", ".join(f"{value:.{self._digits}f}" for value in values) + "]"


class _Json:
    """One object per line, with the fields of the message."""

    def __init__(self, options: Namespace) -> None:
        self._options = options

    def success(self, transform: TransformStamped) -> str:
        stamp = transform.header.stamp
        v, q = transform.transform.translation, transform.transform.rotation
        return self._line(
            header={
                "stamp": {"sec": stamp.sec, "nanosec": stamp.nanosec},
                "frame_id": transform.header.frame_id,
            },
            child_frame_id=transform.child_frame_id,
            transform={
                "translation": self._numbers(x=v.x, y=v.y, z=v.z),
                "rotation": self._numbers(x=q.x, y=q.y, z=q.z, w=q.w),
            },
            rpy=self._numbers(
                **dict(zip(("roll", "pitch", "yaw"), rpy_from_matrix(to_matrix(transform)), strict=True))
            ),
        )

    def failure(self, now: Time, reason: TransformException, buffer: Buffer) -> str:
        sec, nanosec = divmod(now.nanoseconds, S)
        return self._line(
            header={"stamp": {"sec": sec, "nanosec": nanosec}, "frame_id": self._options.target},
            child_frame_id=self._options.source,
            error={"type": type(reason).__name__, "text": str(reason)},
        )

    def _numbers(self, **values: float) -> dict[str, float | None]:
        digits = self._options.precision  # JSON has no infinity: a translation may overflow
        return {
            name: None
            if not isfinite(value)
            else float(value)
            if digits is None
            else round(float(value), digits)
            for name, value in values.items()
        }

    def _line(self, **fields: Any) -> str:
        return json.dumps(fields)
