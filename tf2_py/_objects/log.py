# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Log lines about what a buffer refused or could not read, and about what callbacks raise."""

from __future__ import annotations

import logging
import sys
import traceback
from collections.abc import Callable
from functools import partial
from typing import Any

from tf2_py._objects.errors import IN_1970, seconds
from tf2_py.printable import printable

# By bit of the engine's REFUSED_*: the tag that users search for, the key in statistics(), the reason.
REFUSALS = (
    ("TF_SELF_TRANSFORM", "self_transform", "frame_id and child_frame_id are the same"),
    ("TF_NO_FRAME_ID", "no_frame_id", "frame_id is not set"),
    ("TF_NO_CHILD_FRAME_ID", "no_child_frame_id", "child_frame_id is not set"),
    ("TF_NAN_INPUT", "nan_input", "a number is NaN"),
    (
        "TF_DENORMALIZED_QUATERNION",
        "denormalized_quaternion",
        "the rotation is too short or too long to be normalized",
    ),
    ("TF_INFINITE_INPUT", "infinite_input", "the translation is infinite"),
    ("TF_NEGATIVE_STAMP", "negative_stamp", "the stamp is negative"),
    ("TF_RESERVED_FRAME_ID", "reserved_frame_id", 'the frame name "NO_PARENT" is reserved'),
    ("TF_OLD_DATA", "old_data", "the stamp is more than cache_time older than the frame's newest stamp"),
    ("TF_STAMP_TOO_LATE", "stamp_too_late", "the stamp does not fit into a message"),
    (
        "TF_TOO_MANY_FRAMES",
        "too_many_frames",
        "the buffer already knows max_frames names, those of forgotten frames included: raise max_frames, or"
        " use such a name again",
    ),
    ("TF_TOO_MANY_BYTES", "too_many_bytes", "the buffer would exceed max_bytes"),
    (
        "TF_OTHER_KIND",
        "other_kind",
        "replacing does not change a frame from static to dynamic, or from dynamic to static",
    ),
    (
        "TF_REPLACED_TOGETHER",
        "replaced_together",
        "another transform that was to replace samples of this frame was refused",
    ),
)
OLD_DATA = 1 << 8


# In a thread that runs no code of a program, has another one call this, and returns True.
run_elsewhere: Callable[[Callable[[], object]], bool] | None = None


class _PythonsLogger:
    """Logs with Python's logger of this name, whose handlers may be code of a program."""

    def __init__(self, name: str) -> None:
        self._logger = logging.getLogger(name)

    def warning(self, text: str) -> None:
        self._log(logging.WARNING, text)

    def error(self, text: str) -> None:
        self._log(logging.ERROR, text)

    def _log(self, level: int, text: str) -> None:
        log = partial(self._logger.log, level, text)
        if run_elsewhere is None or not run_elsewhere(log):
            log()


def logger(name: str = "tf2_py") -> Any:
    """The logger of this name: rclpy's, or Python's if the program has not imported rclpy."""
    # Not imported here: in a forked child, that could wait forever for a thread of the parent.
    get_logger = getattr(sys.modules.get("rclpy.logging"), "get_logger", _PythonsLogger)
    return get_logger(name)


def raised(error: BaseException, where: str = "In a callback") -> None:
    """Log an exception with its traceback."""
    logger("tf2_ros").error(f"{where}: {''.join(traceback.format_exception(error))}")


def because(reasons: int) -> str:
    """The reasons for which a transform is refused, as text."""
    tags = {tag for tag, _, _ in _named(reasons)}
    # Two empty names are the same as well, and the length of a rotation with a NaN is none.
    explained = {"TF_SELF_TRANSFORM"} if {"TF_NO_FRAME_ID", "TF_NO_CHILD_FRAME_ID"} <= tags else set()
    explained |= {"TF_DENORMALIZED_QUATERNION"} if "TF_NAN_INPUT" in tags else set()
    return " and ".join(reason for tag, _, reason in _named(reasons) if tag not in explained)


def _named(reasons: int) -> list[tuple[str, str, str]]:
    return [REFUSALS[bit] for bit in range(len(REFUSALS)) if reasons >> bit & 1]


def refusal(reasons: int, happens: str, parent: str, child: str, details: str = "") -> str:
    """A sentence about why a transform is refused; ``happens`` is the verb before "the transform ..."."""
    tags = ", ".join(tag for tag, _, _ in _named(reasons))
    return printable(
        f"{tags}: {happens} the transform from frame_id '{parent}' to child_frame_id '{child}'{details}"
        f" because {because(reasons)}"
    )


def refused(reasons: int, parent: str, child: str, authority: str, stamp_ns: int) -> None:
    """Log one refused transform."""
    details = f" at time {seconds(stamp_ns)} from authority '{authority}'"
    text = refusal(reasons, "ignoring", parent, child, details)
    if reasons == OLD_DATA:
        logger().warning(text)
    else:
        logger().error(text)


def unnormalized(length: float, parent: str, child: str, authority: str) -> None:
    """Log the first transform of a frame whose rotation newer releases of ROS 2 refuse."""
    text = (
        f"The transform from frame_id '{parent}' to child_frame_id '{child}' from authority '{authority}' "
        f"has a rotation of length {length:.6g}. This buffer normalizes it, but tf2 of ROS 2 Kilted and "
        "later refuses it: publish length 1. This is logged once for each child_frame_id"
    )
    logger().warning(printable(text))


def in_1970(time_ns: int) -> None:
    """Log the time of a lookup without an answer, which a program that only waits would not see."""
    logger().warning(f"A lookup at {seconds(time_ns)} s has no answer. {IN_1970}")


def not_logged(count: int) -> None:
    """Log how many more transforms were refused than logged."""
    were = " was" if count == 1 else "s were"
    logger().warning(f"{count} more refused transform{were} not logged; statistics() counts all")


def displaced(count: int, max_bytes: int) -> None:
    """Log that histories are shorter than the cache time."""
    logger().warning(
        f"The buffer has reached max_bytes, {max_bytes} bytes: each new transform displaces the oldest one of"
        f" its frame, {count} so far. Raise max_bytes, or lower cache_time"
    )


def malformed(what: str, error: str) -> None:
    """Log one message that could not be read."""
    logger("tf2_ros").error(f"Ignoring a malformed message on {what}: {error}")


def receiving_failed(error: str) -> None:
    """Log an error in the thread of a receiver; ``error`` is a traceback."""
    logger("tf2_ros").error(f"Receiving transforms failed; please report this: {error}")
