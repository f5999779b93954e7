"""Write TFMessages in CDR from arrays, many at once."""

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

S = 1_000_000_000
LITTLE_ENDIAN = b"\x00\x01\x00\x00"  # the encapsulation; alignment is relative to its end
EMPTY = LITTLE_ENDIAN + bytes(4)  # a TFMessage without transforms
STAMP, NUMBERS = 8, 56  # bytes


def tf_messages(
    frames: Sequence[tuple[str, str]], stamps_ns: ArrayLike, translations: ArrayLike, rotations: ArrayLike
) -> list[bytes]:
    """
    Serialise N TFMessages with M transforms each.

    :param frames: M pairs of parent and child.
    :param stamps_ns: shape (N, M), or (N,) where the transforms of a message share a stamp.
    :param translations: metres, shape (N, M, 3).
    :param rotations: x y z w, shape (N, M, 4).
    """
    stamps = np.asarray(stamps_ns, np.int64)
    stamps = np.broadcast_to(stamps.reshape(len(stamps), -1), (len(stamps), len(frames)))
    parts = np.stack((stamps // S, stamps % S), axis=-1).astype("<i4").view(np.uint8)
    numbers = np.concatenate((translations, rotations), axis=-1).astype("<f8")
    one = bytearray(LITTLE_ENDIAN + struct.pack("<I", len(frames)))
    places: list[tuple[int, int]] = []
    for parent, child in frames:
        _align(one, 4)
        begin = len(one)
        one += bytes(STAMP) + _string(parent)
        _align(one, 4)
        one += _string(child)
        _align(one, 8)
        places.append((begin, len(one)))
        one += bytes(NUMBERS)
    rows = np.tile(np.frombuffer(bytes(one), np.uint8), (len(stamps), 1))
    for i, (stamp, number) in enumerate(places):
        rows[:, stamp : stamp + STAMP] = parts[:, i]
        rows[:, number : number + NUMBERS] = np.ascontiguousarray(numbers[:, i]).view(np.uint8)
    return [row.tobytes() for row in rows]


def tf_message(frames: Sequence[tuple[str, str]], stamps_ns: ArrayLike, transforms: ArrayLike) -> bytes:
    """
    Serialise one TFMessage.

    :param frames: M pairs of parent and child.
    :param stamps_ns: shape (M,).
    :param transforms: metres and quaternion: x y z qx qy qz qw, shape (M, 7).
    """
    stamps = np.asarray(stamps_ns, np.int64)
    parts = np.stack((stamps // S, stamps % S), axis=-1).astype("<i4").tobytes()
    numbers = np.asarray(transforms).astype("<f8").tobytes()
    one = bytearray(LITTLE_ENDIAN + struct.pack("<I", len(frames)))
    for i, (parent, child) in enumerate(frames):
        _align(one, 4)
        one += parts[i * STAMP : (i + 1) * STAMP] + _string(parent)
        _align(one, 4)
        one += _string(child)
        _align(one, 8)
        one += numbers[i * NUMBERS : (i + 1) * NUMBERS]
    return bytes(one)


def _string(text: str) -> bytes:
    encoded = text.encode()
    return struct.pack("<I", len(encoded) + 1) + encoded + b"\0"


def _align(data: bytearray, size: int) -> None:
    data += bytes(-(len(data) - len(LITTLE_ENDIAN)) % size)
