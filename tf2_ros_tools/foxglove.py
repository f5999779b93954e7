"""Turn foxglove.FrameTransform and FrameTransforms in protobuf into TFMessages."""

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from operator import index
from typing import Any, TypeAlias

from tf2_ros_tools.serialised import EMPTY, tf_messages

TYPES = ("foxglove.FrameTransform", "foxglove.FrameTransforms")
ENCODING = "protobuf"

S = 1_000_000_000
SEC_BITS = 31  # of a time in CDR
VARINT_BYTES = 10  # of 64 bits
FIXED_SIZES = {1: 8, 5: 4}  # in bytes, of the wire types with a fixed size

# Parent and child, stamp in ns, translation and rotation.
Transform: TypeAlias = "tuple[tuple[str, str], int, list[float], list[float]]"


def tf_message(msgtype: str, raw: bytes | memoryview) -> bytes:
    """
    Make a TFMessage of a message.

    :param msgtype: one of TYPES.
    :raises ValueError: it is malformed.
    """
    data = bytes(raw)
    with _malformed(msgtype):
        is_list = msgtype == TYPES[1]
        parts = [value for number, value in _fields(data) if number == 1] if is_list else [data]
        if not parts:
            return EMPTY
        frames, stamps_ns, translations, rotations = zip(*map(_transform, parts), strict=True)
        [made] = tf_messages(frames, [stamps_ns], [translations], [rotations])
    return made


def is_stamped(msgtype: str, encoding: str) -> bool:
    """Whether the messages of a type may have a ``timestamp``."""
    return msgtype.startswith("foxglove.") and encoding == ENCODING


def stamp_ns(raw: bytes | memoryview) -> int:
    """
    Get the ``timestamp`` of a message of Foxglove, which is its first field.

    :raises ValueError: it is malformed, or has none.
    """
    with _malformed("message with a timestamp"):
        return _time(next(value for number, value in _fields(bytes(raw)) if number == 1))


@contextmanager
def _malformed(what: str) -> Iterator[None]:
    # Any bytes may be in a file: what is missing or has another type raises any kind of error.
    try:
        yield
    except Exception as error:
        raise ValueError(f"not a {what}: {type(error).__name__}: {error}") from None


# Read protobuf. Its library would need generated code, which fits only one of its major versions, for
# messages of twelve fields. A field that is not there has its default: 0, or no rotation.


def _transform(data: bytes) -> Transform:
    fields = dict(_fields(data))
    return (
        (fields.get(2, b"").decode(), fields.get(3, b"").decode()),
        _time(fields.get(1, b"")),
        _doubles(fields.get(4, b""), 3),
        _doubles(fields[5], 4) if 5 in fields else [0.0, 0.0, 0.0, 1.0],
    )


def _time(data: bytes) -> int:
    time = dict(_fields(data))
    stamp_ns = index(time.get(1, 0)) * S + index(time.get(2, 0))
    if stamp_ns // S >> SEC_BITS not in (0, -1):
        raise ValueError(f"a time of {stamp_ns} ns does not fit into 32 bits of seconds")
    return stamp_ns


def _doubles(data: bytes, count: int) -> list[float]:
    fields = dict(_fields(data))
    return [struct.unpack("<d", fields[i])[0] if i in fields else 0.0 for i in range(1, count + 1)]


def _fields(data: bytes) -> Iterator[tuple[int, Any]]:
    """Yield the number and the value of each field: an int, or bytes."""
    place = 0
    while place < len(data):
        key, place = _varint(data, place)
        number, wire_type = key >> 3, key & 7
        if wire_type == 0:
            value, place = _varint(data, place)
            yield number, value - (value >> 63 << 64)  # two's complement
            continue
        if wire_type == 2:
            size, place = _varint(data, place)
        else:
            size = FIXED_SIZES[wire_type]
        if size > len(data) - place:
            raise ValueError(f"a field of {size} bytes does not fit into a protobuf message")
        yield number, data[place : place + size]
        place += size


def _varint(data: bytes, place: int) -> tuple[int, int]:
    value = 0
    for i in range(VARINT_BYTES):
        byte = data[place + i]
        value |= (byte & 0x7F) << 7 * i
        if byte < 0x80:
            return value, place + i + 1
    raise ValueError("a number of a protobuf message has no end")
