"""Turn foxglove.FrameTransform and FrameTransforms, in protobuf or JSON, into TFMessages."""

import json
import struct
from collections.abc import Iterator
from typing import Any, TypeAlias

from tf2_ros_tools.serialised import EMPTY, Raw, tf_messages

TYPES = ("foxglove.FrameTransform", "foxglove.FrameTransforms")
ENCODINGS = ("protobuf", "json")

S = 1_000_000_000
SEC_BITS = 31  # of a time in CDR

# Stamp in ns, parent, child, translation and rotation.
Transform: TypeAlias = "tuple[int, str, str, list[float], list[float]]"


def tf_message(msgtype: str, encoding: str, raw: Raw) -> bytes:
    """
    Make a TFMessage of a message.

    :param msgtype: one of TYPES.
    :param encoding: one of ENCODINGS.
    :raises ValueError: it is malformed.
    """
    is_list = msgtype == TYPES[1]
    found = list((_of_json if encoding == "json" else _of_protobuf)(bytes(raw), is_list))
    if not found:
        return EMPTY
    stamps, parents, children, translations, rotations = zip(*found, strict=True)
    frames = [*zip(parents, children, strict=True)]
    [made] = tf_messages(frames, [stamps], [translations], [rotations])
    return made


def is_stamped(msgtype: str, encoding: str) -> bool:
    """Whether the messages of a type may have a ``timestamp``."""
    return msgtype.startswith("foxglove.") and encoding in ENCODINGS


def stamp_ns(encoding: str, raw: Raw) -> int:
    """
    Get the ``timestamp`` of a message of Foxglove, which is its first field.

    :raises ValueError: it is malformed, or has none.
    """
    if encoding == "json":
        content = _json(bytes(raw))
        found = content.get("timestamp") if isinstance(content, dict) else None
        return _time_of_json(found)
    found = next((value for number, value in _fields(bytes(raw)) if number == 1), None)
    if not isinstance(found, bytes):
        raise ValueError("it has no timestamp")
    return _time_of_protobuf(found)


def _checked(stamp_ns: int) -> int:
    if stamp_ns // S >> SEC_BITS not in (0, -1):
        raise ValueError(f"a time of {stamp_ns} ns does not fit into 32 bits of seconds")
    return stamp_ns


def _time_of_json(time: Any) -> int:
    try:
        return _checked(int(time["sec"]) * S + int(time["nsec"]))
    except (KeyError, TypeError, OverflowError):
        raise ValueError(f"a timestamp must have sec and nsec, not be {time!r}") from None


def _json(data: bytes) -> Any:
    try:
        return json.loads(data)
    except RecursionError:
        raise ValueError("its JSON is nested too deeply") from None


def _of_json(data: bytes, is_list: bool) -> Iterator[Transform]:
    content = _json(data)
    try:
        for one in content["transforms"] if is_list else [content]:
            parent, child = one["parent_frame_id"], one["child_frame_id"]
            if not isinstance(parent, str) or not isinstance(child, str):
                raise TypeError("a name of a frame is not a text")
            yield (
                _time_of_json(one["timestamp"]),
                parent,
                child,
                [float(one["translation"][name]) for name in "xyz"],
                [float(one["rotation"][name]) for name in "xyzw"],
            )
    except (KeyError, TypeError, OverflowError) as error:
        raise ValueError(f"not a {TYPES[is_list]}: {type(error).__name__}: {error}") from None


# Read protobuf. Its library would need generated code, which fits only one of its major versions, for
# messages of twelve fields.


def _of_protobuf(data: bytes, is_list: bool) -> Iterator[Transform]:
    for one in [value for number, value in _fields(data) if number == 1] if is_list else [data]:
        fields = dict(_fields(_bytes(one)))
        # A field that is not there has its default: 0, or no rotation.
        yield (
            _time_of_protobuf(_bytes(fields.get(1, b""))),
            _bytes(fields.get(2, b"")).decode(),
            _bytes(fields.get(3, b"")).decode(),
            _doubles(fields.get(4, b""), 3),
            _doubles(fields[5], 4) if 5 in fields else [0.0, 0.0, 0.0, 1.0],
        )


def _time_of_protobuf(data: bytes) -> int:
    time = dict(_fields(data))
    return _checked(_signed(time.get(1, 0)) * S + _signed(time.get(2, 0)))


def _fields(data: bytes) -> Iterator[tuple[int, int | float | bytes]]:
    """Yield the number and the value of each field."""
    place = 0
    while place < len(data):
        key, place = _varint(data, place)
        kind = key & 7
        if kind == 0:
            value, place = _varint(data, place)
            yield key >> 3, value
            continue
        size = {1: 8, 5: 4}.get(kind)
        if kind == 2:
            size, place = _varint(data, place)
        if size is None:
            raise ValueError(f"protobuf has no wire type {kind}")
        if size > len(data) - place:
            raise ValueError(f"a field of {size} bytes does not fit into a protobuf message")
        part = data[place : place + size]
        place += size
        yield key >> 3, struct.unpack("<d", part)[0] if kind == 1 else part


def _varint(data: bytes, place: int) -> tuple[int, int]:
    value = 0
    for i, byte in enumerate(data[place : place + 10]):
        value |= (byte & 0x7F) << 7 * i
        if byte < 0x80:
            return value, place + i + 1
    raise ValueError("a number of a protobuf message has no end")


def _signed(value: Any) -> int:
    if not isinstance(value, int):
        raise ValueError(OTHER_TYPE)
    return value - (1 << 64) if value >> 63 else value


def _bytes(value: Any) -> bytes:
    if not isinstance(value, bytes):
        raise ValueError(OTHER_TYPE)
    return value


def _doubles(message: Any, count: int) -> list[float]:
    fields = dict(_fields(_bytes(message)))
    found = [fields.get(i + 1, 0.0) for i in range(count)]
    if not all(isinstance(one, float) for one in found):
        raise ValueError(OTHER_TYPE)
    return found  # type: ignore[return-value]


OTHER_TYPE = "a field of a protobuf message has another type"
