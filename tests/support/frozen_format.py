# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""The format of frozen files, written a second time, in Python; the chapter frozen_format describes it."""

import struct
import zlib
from typing import NamedTuple

HEADER = struct.Struct("<8sIIQQQqQIIIIQQ40s")
FRAME = struct.Struct("<QIHHIIIIQQqq")
NAME = struct.Struct("<QI4x")
LINE = 64
CHECKSUM_AT = 32  # in the header


class Header(NamedTuple):
    magic: bytes
    version: int
    flags: int
    file_bytes: int
    index_bytes: int
    checksum: int
    cache_time_ns: int
    max_bytes: int
    max_frames: int
    frame_count: int
    authority_count: int
    reserved: int
    sample_count: int
    samples_checksum: int
    reserved_line: bytes


class Frame(NamedTuple):
    name_start: int
    name_size: int
    kind: int
    flags: int
    authority: int
    newest_parent: int
    count: int
    parent_changes: int
    data_start: int
    reserved: int
    oldest_ns: int
    newest_ns: int

    @property
    def samples_start(self):
        return self.data_start + -(-8 * self.count // LINE) * LINE


class FrozenFile:
    """A frozen file as bytes that can be changed."""

    def __init__(self, data):
        self.data = bytearray(data)

    @property
    def header(self):
        return Header(*HEADER.unpack_from(self.data))

    def frame(self, number):
        """By its id, from 1 on."""
        return Frame(*FRAME.unpack_from(self.data, HEADER.size + (number - 1) * FRAME.size))

    @property
    def frames(self):
        return [self.frame(number) for number in range(1, self.header.frame_count + 1)]

    @property
    def authorities(self):
        start = HEADER.size + self.header.frame_count * FRAME.size
        places = [start + i * NAME.size for i in range(self.header.authority_count)]
        return [self.text(*NAME.unpack_from(self.data, place)) for place in places]

    def text(self, start, size):
        return self.data[start : start + size].decode()

    def name(self, number):
        frame = self.frame(number)
        return self.text(frame.name_start, frame.name_size)

    def number(self, name):
        """The id of a frame."""
        [found] = [i for i in range(1, self.header.frame_count + 1) if self.name(i) == name]
        return found

    def change_header(self, **changes):
        HEADER.pack_into(self.data, 0, *self.header._replace(**changes))

    def change_frame(self, number, **changes):
        FRAME.pack_into(
            self.data, HEADER.size + (number - 1) * FRAME.size, *self.frame(number)._replace(**changes)
        )

    def change(self, code, place, *values):
        struct.pack_into("<" + code, self.data, place, *values)

    def samples_checksum(self):
        return zlib.crc32(self.data[self.header.index_bytes :])

    def index_checksum(self):
        index = self.data[: self.header.index_bytes]
        index[CHECKSUM_AT : CHECKSUM_AT + 8] = bytes(8)
        return zlib.crc32(index)

    def renew_checksum(self):
        """As if it had been written like this."""
        size = self.header.index_bytes
        if HEADER.size <= size <= len(self.data) and size % LINE == 0:
            self.change_header(samples_checksum=self.samples_checksum())
            self.change_header(checksum=self.index_checksum())
