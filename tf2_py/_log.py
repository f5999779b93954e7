"""Owns what a buffer says about transforms it did not take."""

import logging
import time
from typing import Any

from tf2_py._errors import seconds

# By bit of the engine's REFUSED_*: the tag that users search for, the key in statistics(), the reason.
REFUSALS = (
    ("TF_SELF_TRANSFORM", "self_transform", "frame_id and child_frame_id are the same"),
    ("TF_NO_FRAME_ID", "no_frame_id", "frame_id is not set"),
    ("TF_NO_CHILD_FRAME_ID", "no_child_frame_id", "child_frame_id is not set"),
    ("TF_NAN_INPUT", "nan_input", "a number is NaN"),
    ("TF_DENORMALIZED_QUATERNION", "denormalized_quaternion", "the rotation has no finite length above zero"),
    ("TF_INFINITE_INPUT", "infinite_input", "the translation is infinite"),
    ("TF_NEGATIVE_STAMP", "negative_stamp", "the stamp is negative"),
    ("TF_RESERVED_FRAME_ID", "reserved_frame_id", 'the frame name "NO_PARENT" is reserved'),
    ("TF_OLD_DATA", "old_data", "the stamp is older than the newest one less the cache time"),
)
OLD_DATA = 1 << 8
PERIOD_S = 1.0
FORGET_ABOVE = 1024  # a sender of ever new names must not fill the memory


def _logger() -> Any:
    try:
        from rclpy.logging import get_logger
    except ModuleNotFoundError:
        return logging.getLogger("tf2_py")
    return get_logger("tf2_py")


class Throttle:
    """Lets each key pass once in PERIOD_S seconds of steady time."""

    def __init__(self) -> None:
        self._passed: dict[Any, float] = {}

    def passes(self, key: Any) -> bool:
        now = time.monotonic()
        if now - self._passed.get(key, float("-inf")) < PERIOD_S:
            return False
        if len(self._passed) >= FORGET_ABOVE:
            self._passed = {k: t for k, t in self._passed.items() if now - t < PERIOD_S}
        if len(self._passed) >= FORGET_ABOVE:
            return False
        self._passed[key] = now
        return True


def refused(throttle: Throttle, reasons: int, parent: str, child: str, authority: str, stamp_ns: int) -> None:
    """Log one refused transform, unless the same was said about its frame a moment ago."""
    if not throttle.passes((reasons, child)):
        return
    named = [refusal for bit, refusal in enumerate(REFUSALS) if reasons >> bit & 1]
    text = (
        f"{', '.join(tag for tag, _, _ in named)}: ignoring the transform from frame_id '{parent}' to "
        f"child_frame_id '{child}' at time {seconds(stamp_ns)} from authority '{authority}' because "
        f"{' and '.join(reason for _, _, reason in named)}"
    )
    if reasons == OLD_DATA:
        _logger().warning(text)
    else:
        _logger().error(text)


def malformed(throttle: Throttle, what: str, error: str) -> None:
    """Log one message that could not be read."""
    if throttle.passes(what):
        _logger().error(f"Ignoring a malformed message on {what}: {error}")
