"""
Turn Foxglove's messages into TFMessages.

They are in JSON, or in protobuf, which the library mcap-protobuf-support decodes.
"""

import json
from typing import Any, TypeAlias

from tf2_ros.serialization import serialize_arrays

TYPES = ("foxglove.FrameTransform", "foxglove.FrameTransforms")
PROTOBUF, JSON = "protobuf", "json"
ENCODINGS = (PROTOBUF, JSON)

S = 1_000_000_000
SEC_BITS = 31  # of a time in CDR

# Parent and child, stamp in ns, translation and rotation.
Transform: TypeAlias = "tuple[tuple[str, str], int, list[float], list[float]]"


def is_stamped(msgtype: str, encoding: str) -> bool:
    """Whether the messages of a type may have a ``timestamp``."""
    return msgtype.startswith("foxglove.") and encoding in ENCODINGS


def from_json(raw: bytes) -> dict[str, Any]:
    """Decode a message in JSON, for the functions below."""
    message = json.loads(raw.decode())
    if not isinstance(message, dict):
        raise ValueError(f"expected an object, got {type(message).__name__}")
    return message


def tf_message(message: Any) -> bytes:
    """Make a TFMessage of a decoded message, of one of TYPES."""
    if isinstance(message, dict):
        found = message["transforms"] if "transforms" in message else [message]
        if not isinstance(found, list):
            raise ValueError(f"transforms: expected an array, got {type(found).__name__}")
        parts = [_of_json(part) for part in found]
    else:
        found = message.transforms if hasattr(message, "transforms") else [message]
        parts = [_of_protobuf(part) for part in found]
    # To tf2, names are C strings.
    frames = [(parent.partition("\0")[0], child.partition("\0")[0]) for (parent, child), *_ in parts]
    stamps_ns = [part[1] for part in parts]
    return serialize_arrays(frames, stamps_ns, [[*xyz, *xyzw] for _, _, xyz, xyzw in parts])


def stamp_ns(message: Any) -> int:
    """Get the ``timestamp`` of a decoded message."""
    if isinstance(message, dict):
        time = _field(message, "timestamp", dict)
        sec, nanosec = _field(time, "sec", int), _field(time, "nsec", int)
    else:
        sec, nanosec = message.timestamp.seconds, message.timestamp.nanos
    stamp_ns: int = sec * S + nanosec
    if stamp_ns // S >> SEC_BITS not in (0, -1):
        raise ValueError(f"a time of {stamp_ns} ns does not fit into 32 bits of seconds")
    return stamp_ns


def _of_protobuf(part: Any) -> Transform:
    t, q = part.translation, part.rotation
    # A field that is not there has its default: 0, but no rotation is the identity.
    rotation = [q.x, q.y, q.z, q.w] if part.HasField("rotation") else [0.0, 0.0, 0.0, 1.0]
    return (part.parent_frame_id, part.child_frame_id), stamp_ns(part), [t.x, t.y, t.z], rotation


def _of_json(part: Any) -> Transform:
    parent, child = (_field(part, name, str) for name in ("parent_frame_id", "child_frame_id"))
    time_ns = stamp_ns(part)
    # Both are required, so that a pose in other fields, as before 2023, is not read as the identity.
    t = _field(part, "translation", dict)
    translation = [float(_field(t, name, int, float)) for name in "xyz"]
    q = _field(part, "rotation", dict)
    rotation = [float(_field(q, name, int, float)) for name in "xyzw"]
    return (parent, child), time_ns, translation, rotation


_KINDS = {dict: "an object", str: "a text", int: "an integer", float: "a number"}


def _field(message: Any, name: str, *kinds: type) -> Any:
    """Get a field of an object of JSON, of one of these types."""
    if not isinstance(message, dict):
        raise ValueError(f"expected an object, got {type(message).__name__}")
    if name not in message:
        raise ValueError(f"it has no {name}")
    value = message[name]
    if type(value) not in kinds:
        raise ValueError(f"{name}: expected {_KINDS[kinds[-1]]}, got {value!r:.40}")
    return value
