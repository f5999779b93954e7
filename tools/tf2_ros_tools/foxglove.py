"""Turn Foxglove's messages in protobuf, which the library mcap-protobuf-support decodes, into TFMessages."""

from typing import Any, TypeAlias

from tf2_ros_tools.serialised import EMPTY, tf_messages

TYPES = ("foxglove.FrameTransform", "foxglove.FrameTransforms")
ENCODING = "protobuf"

S = 1_000_000_000
SEC_BITS = 31  # of a time in CDR

# Parent and child, stamp in ns, translation and rotation.
Transform: TypeAlias = "tuple[tuple[str, str], int, list[float], list[float]]"


def is_stamped(msgtype: str, encoding: str) -> bool:
    """Whether the messages of a type may have a ``timestamp``."""
    return msgtype.startswith("foxglove.") and encoding == ENCODING


def tf_message(message: Any) -> bytes:
    """Make a TFMessage of a decoded message, of one of TYPES."""
    parts = message.transforms if hasattr(message, "transforms") else [message]
    if not parts:
        return EMPTY
    frames, stamps_ns, translations, rotations = zip(*map(_transform, parts), strict=True)
    [made] = tf_messages(frames, [stamps_ns], [translations], [rotations])
    return made


def stamp_ns(message: Any) -> int:
    """Get the ``timestamp`` of a decoded message."""
    stamp_ns: int = message.timestamp.seconds * S + message.timestamp.nanos
    if stamp_ns // S >> SEC_BITS not in (0, -1):
        raise ValueError(f"a time of {stamp_ns} ns does not fit into 32 bits of seconds")
    return stamp_ns


def _transform(part: Any) -> Transform:
    t, q = part.translation, part.rotation
    # A field that is not there has its default: 0, but no rotation is the identity.
    rotation = [q.x, q.y, q.z, q.w] if part.HasField("rotation") else [0.0, 0.0, 0.0, 1.0]
    return (part.parent_frame_id, part.child_frame_id), stamp_ns(part), [t.x, t.y, t.z], rotation
