"""Write TFMessages in CDR from arrays, and read joint states and poses from CDR, many at once."""

import struct
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import ArrayLike, NDArray

Raw: TypeAlias = "bytes | memoryview"

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


def _string(text: str) -> bytes:
    encoded = text.encode()
    return struct.pack("<I", len(encoded) + 1) + encoded + b"\0"


def _align(data: bytearray, size: int) -> None:
    data += bytes(-(len(data) - len(LITTLE_ENDIAN)) % size)


class Reader:
    """
    Reads the fields of a message one after another.

    :raises ValueError: it is shorter than a field says.
    """

    def __init__(self, raw: Raw) -> None:
        self.raw = raw
        # The second byte is even for big-endian numbers.
        self.order = "<" if len(raw) > 1 and raw[1] & 1 else ">"
        self.place = len(LITTLE_ENDIAN)

    def align(self, size: int) -> None:
        """Skip the padding before a field of this size."""
        self.place += -(self.place - len(LITTLE_ENDIAN)) % size

    def take(self, form: str, size: int) -> tuple[float, ...]:
        """Read numbers in the form of ``struct``; ``size`` is that of one."""
        self.align(size)
        form = self.order + form
        try:
            found = struct.unpack_from(form, self.raw, self.place)
        except struct.error:
            raise ValueError(f"a message of {len(self.raw)} bytes is too short") from None
        self.place += struct.calcsize(form)
        return found

    def count(self) -> int:
        """Read the length of a string or sequence."""
        return int(self.take("I", 4)[0])

    def stamp_ns(self) -> int:
        """Read a time."""
        sec, nanosec = self.take("iI", 4)
        return int(sec) * S + int(nanosec)

    def text(self) -> str:
        """Read a string."""
        size = self.count()
        data = bytes(self.raw[self.place : self.place + size])
        if len(data) < size:
            raise ValueError(f"a message of {len(self.raw)} bytes is too short")
        self.place += size
        return data.rstrip(b"\0").decode()


@dataclass(frozen=True, eq=False)
class Layout:
    """What messages of one publisher have in common: everything between the stamp and the numbers."""

    head: bytes
    order: str
    names: tuple[str, ...]
    count: int  # of the numbers
    end: int  # of the numbers


class Series:
    """
    Reads serialised messages that begin with a stamp, texts and float64 numbers; reads equal texts once.

    :param read_names: gets a :class:`Reader` behind the stamp; returns the texts and the count of numbers.

    ``layouts`` has the latest ones.
    """

    def __init__(self, read_names: Callable[[Reader], tuple[tuple[str, ...], int]]) -> None:
        self._read_names = read_names
        self.layouts: list[Layout] = []

    def read(self, raw: Raw) -> tuple[int, Layout, bytes]:
        """
        Get the stamp in ns, the layout, and the bytes of the numbers of a message.

        :raises ValueError: it cannot be read.
        """
        reader = Reader(raw)
        stamp_ns = reader.stamp_ns()
        begin = reader.place
        for layout in self.layouts:
            end = begin + len(layout.head)
            if raw[begin:end] == layout.head and reader.order == layout.order:
                break
        else:
            names, count = self._read_names(reader)
            if count:
                reader.align(8)
            head = bytes(raw[begin : reader.place])
            layout = Layout(head, reader.order, names, count, reader.place + 8 * count)
            # A few publishers share a topic; one that sends other names each time must not fill the memory.
            self.layouts = [layout, *self.layouts[:9]]
        if len(raw) < layout.end:
            raise ValueError(f"a message of {len(raw)} bytes is too short for {layout.count} numbers")
        return stamp_ns, layout, bytes(raw[layout.end - 8 * layout.count : layout.end])


def joint_names(reader: Reader) -> tuple[tuple[str, ...], int]:
    """Read the beginning of a ``sensor_msgs/JointState``: the names and the count of positions."""
    reader.text()
    count = reader.count()
    names = tuple(reader.text() for _ in range(count))
    positions = reader.count()
    if positions not in (0, count):
        raise ValueError(f"{count} names, but {positions} positions")
    return names, positions


def pose_frames(reader: Reader) -> tuple[tuple[str, ...], int]:
    """Read the beginning of a ``geometry_msgs/PoseStamped``: the frame of the pose, which is 7 numbers."""
    return (reader.text(),), 7


def odometry_frames(reader: Reader) -> tuple[tuple[str, ...], int]:
    """Read the beginning of a ``nav_msgs/Odometry``: the parent and the child."""
    return (reader.text(), reader.text()), 7


def numbers_of(layout: Layout, data: Sequence[bytes]) -> NDArray[np.float64]:
    """Get the numbers of N messages of a layout, shape (N, count)."""
    numbers = np.frombuffer(b"".join(data), f"{layout.order}f8").astype(np.float64)
    return numbers.reshape(len(data), layout.count)
