# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fuzz the parser of serialized TFMessage: it must accept what ROS itself reads, and nothing else."""

import struct
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message, serialize_message

from reliability.fuzz.buffer_checks import Fault, holds_the_same
from tf2_msgs.msg import TFMessage
from tf2_py import BufferCore
from tf2_py._tf2_py import serialize_as_ros
from tf2_ros.serialization import MessageSource, insert_messages, read_transforms
from tf2_ros_cython._ros_in_use import running_release

MOST_BYTES = 1024
_TF = MessageSource("/tf", False)
_PREFIXED = MessageSource("/robot/tf", False, "robot/")
_EMPTY = BufferCore()


def run(data: bytes) -> None:
    """Read a message in each of the ways that there are."""
    # Of its exact size: a sanitizer sees what is read behind it.
    exact = np.frombuffer(data, np.uint8).copy()
    static = len(data) > 3 and data[3] & 1 == 1  # the options of the header, which mean nothing here
    core = BufferCore()
    try:
        taken = core.set_transforms_cdr(exact, "/tf", static)
    except ValueError:
        _check_refused(core, exact)
        return
    core._self_check()
    try:
        theirs = deserialize_message(data, TFMessage)
    except RuntimeError:
        if _READS_ALL:
            raise
        return
    ours = read_transforms(exact, _TF)
    if list(map(_bits, ours)) != list(map(_bits, theirs.transforms)):
        raise Fault(f"read {ours}, ROS reads {theirs.transforms}")
    _check_prefix(exact, ours)
    _check_written(ours)
    other = BufferCore()
    other.set_transforms(theirs.transforms, "/tf", static)
    if not holds_the_same(core, other):
        raise Fault(f"a buffer holds {core.histories()}, of ROS's messages {other.histories()}")
    other.set_transforms(theirs.transforms, "/tf", static, replace=True)
    other._self_check()
    refused = sum(core.statistics()["refused"].values())
    if taken > len(ours) or (taken < len(ours)) != (refused > 0):
        raise Fault(f"{taken} of {len(ours)} transforms taken, {core.statistics()}")


def _check_refused(core: BufferCore, exact: NDArray[Any]) -> None:
    core._self_check()
    counts = _EMPTY.statistics() | {"malformed_messages": 1}
    if core.statistics() != counts or not holds_the_same(core, _EMPTY):
        raise Fault("a malformed message has changed the buffer")
    for source in (_TF, _PREFIXED):
        try:
            read_transforms(exact, source)
        except ValueError:
            continue
        raise Fault("read_transforms takes what set_transforms_cdr refuses")
    skipped: list[ValueError] = []
    good = TWO_TRANSFORMS
    messages = [("/tf", 1, good), ("/tf", 2, exact), ("/tf", 3, good)]
    read = insert_messages(
        core, messages, [_TF], on_malformed=lambda topic, log_ns, error: skipped.append(error)
    )
    if read != 3 or len(skipped) != 1 or core.statistics()["taken"] != 4:
        raise Fault(f"of three messages, one of them malformed, {core.statistics()} {skipped}")


def _check_prefix(exact: NDArray[Any], ours: list[Any]) -> None:
    for plain, prefixed in zip(ours, read_transforms(exact, _PREFIXED), strict=True):
        for name, found in (
            (plain.header.frame_id, prefixed.header.frame_id),
            (plain.child_frame_id, prefixed.child_frame_id),
        ):
            bare = name[1:] if name.startswith("/") else name
            if found != (f"robot/{bare}" if bare else bare):
                raise Fault(f"{name!r} becomes {found!r}")


def _check_written(ours: list[Any]) -> None:
    if not all(-(2**31) <= one.header.stamp.sec < 2**31 for one in ours):
        return  # nanoseconds of more than a second were carried
    written = serialize_as_ros(ours)
    # Byte by byte they need not be the same: ROS leaves in the padding what its memory held before.
    theirs = serialize_message(TFMessage(transforms=ours))
    if written is None or len(written[0]) != len(theirs):
        raise Fault(f"written as {written}, ROS writes {theirs!r}")
    if list(map(_bits, deserialize_message(written[0], TFMessage).transforms)) != list(map(_bits, ours)):
        raise Fault(f"{ours} written as {written}")


def _bits(message: Any) -> tuple[Any, ...]:
    t, q = message.transform.translation, message.transform.rotation
    stamp = message.header.stamp
    return (
        stamp.sec * 10**9 + stamp.nanosec,
        message.header.frame_id,
        message.child_frame_id,
        struct.pack("7d", t.x, t.y, t.z, q.x, q.y, q.z, q.w),
    )


# Parent, child, sec, nanosec, translation, rotation.
_Row = tuple[bytes, bytes, int, int, tuple[float, ...], tuple[float, ...]]


def encoded(rows: list[_Row], order: str = "<", options: int = 0) -> bytes:
    """A TFMessage in either byte order; the alignment is that of plain CDR."""
    body = bytearray(struct.pack(order + "I", len(rows)))

    def put(code: str, value: Any) -> None:
        size = struct.calcsize(code)
        body.extend(bytes(-len(body) % size))
        body.extend(struct.pack(order + code, value))

    for parent, child, sec, nanosec, xyz, xyzw in rows:
        put("i", sec)
        put("I", nanosec)
        for name in (parent, child):
            put("I", len(name) + 1)
            body.extend(name + b"\0")
        for number in (*xyz, *xyzw):
            put("d", number)
    return bytes([0, order == "<", 0, options]) + bytes(body)


def seeds() -> Iterator[bytes]:
    """Valid messages of either byte order; the first has two transforms."""
    turn = (0.0, 0.0, 0.6, 0.8)
    rows: list[_Row] = [
        (b"map", b"odom", 100, 5, (1.0, 2.0, 3.0), turn),
        (b"odom", b"base_link", 100, 7, (0.0, -0.0, 1e-300), (0.0, 0.0, 0.0, 1.0)),
    ]
    odd: list[_Row] = [
        ("/k\u00fcche".encode(), "\u6771\U0001f916".encode(), -1, 0, (float("nan"), 0.0, 0.0), turn),
        (b"", b"a", 0, 1_500_000_000, (float("inf"), 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)),
        (b"a", b"a", 2**31 - 1, 2**32 - 1, (0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 0.0)),
        (b"NO_PARENT", b"b", 5, 0, (0.0, 0.0, 0.0), turn),
    ]
    for order in "<>":
        for some in (rows, [], rows[:1], odd):
            for options in (0, 1):
                yield encoded(some, order, options)


VALID = list(seeds())
TWO_TRANSFORMS = VALID[0]


# Kilted's Fast CDR refuses the other byte order, and options in the header.
_READS_ALL = running_release() == "Jazzy"
