# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Turn the bytes of a fuzzer into numbers and choices; beyond their end there are zeros."""

import struct
from collections.abc import Sequence
from typing import TypeVar

_Item = TypeVar("_Item")


class Input:
    """Reads bytes from the front, so that a change of one changes little of what was decided before it."""

    def __init__(self, data: bytes) -> None:
        self._data = data
        self._at = 0

    @property
    def left(self) -> int:
        """How many bytes are left."""
        return max(0, len(self._data) - self._at)

    def raw(self, size: int) -> bytes:
        """So many bytes, zeros beyond the end."""
        return self.some(size).ljust(size, b"\0")

    def some(self, size: int) -> bytes:
        """So many bytes, or fewer at the end."""
        found = self._data[self._at : self._at + size]
        self._at += size
        return found

    def byte(self) -> int:
        """0 to 255."""
        return self.raw(1)[0]

    def below(self, count: int) -> int:
        """0 to ``count`` - 1; ``count`` is 256 at most."""
        return self.byte() % count

    def whole(self, code: str) -> int:
        """An integer of this format of :mod:`struct`."""
        found: int = struct.unpack("<" + code, self.raw(struct.calcsize("<" + code)))[0]
        return found

    def double(self) -> float:
        """Any 64 bits as a float."""
        found: float = struct.unpack("<d", self.raw(8))[0]
        return found

    def choice(self, items: Sequence[_Item]) -> _Item:
        """One of up to 256 items."""
        return items[self.below(len(items))]

    def flag(self) -> bool:
        """True for half of all bytes."""
        return bool(self.byte() & 1)
