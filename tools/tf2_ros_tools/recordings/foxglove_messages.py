# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Turn Foxglove's messages into TFMessages.

They are in protobuf, which the library mcap-protobuf-support decodes. A message that has another type than
expected somewhere raises whatever Python raises.
"""

from typing import Any

from tf2_ros.serialization import serialize_arrays

TYPES = ("foxglove.FrameTransform", "foxglove.FrameTransforms")
PROTOBUF = "protobuf"

S = 1_000_000_000
SEC_BITS = 31  # of a time in CDR


def is_stamped(msgtype: str) -> bool:
    """Whether the messages of a type may have a ``timestamp``."""
    return msgtype.startswith("foxglove.")


def tf_message(message: Any) -> bytes:
    """Make a TFMessage of a decoded message, of one of TYPES."""
    parts = message.transforms if hasattr(message, "transforms") else [message]
    # To tf2, names are C strings.
    frames = [
        (one.parent_frame_id.partition("\0")[0], one.child_frame_id.partition("\0")[0]) for one in parts
    ]
    return serialize_arrays(frames, [*map(stamp_ns, parts)], [*map(_numbers, parts)])


def stamp_ns(message: Any) -> int:
    """Get the ``timestamp`` of a decoded message."""
    time = message.timestamp
    stamp_ns: int = time.seconds * S + time.nanos
    if stamp_ns // S >> SEC_BITS not in (0, -1):
        raise ValueError(f"a time of {stamp_ns} ns does not fit into 32 bits of seconds")
    return stamp_ns


def _numbers(part: Any) -> list[float]:
    # A field that is not there has its default: 0, but no rotation is the identity.
    t, q = part.translation, part.rotation
    return [t.x, t.y, t.z, *((q.x, q.y, q.z, q.w) if part.HasField("rotation") else (0.0, 0.0, 0.0, 1.0))]
