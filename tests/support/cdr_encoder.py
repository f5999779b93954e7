# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Serialize transforms as TFMessages in CDR, by the book: an encoder to compare others with."""

import struct

from times_and_transforms import rotation, translation


def encode(transforms):
    """Plain CDR by the book, in little-endian order."""
    body = bytearray()

    def align(size):
        body.extend(b"\0" * (-len(body) % size))

    def number(code, *values):
        for value in values:
            align(struct.calcsize(code))
            body.extend(struct.pack("<" + code, value))

    def string(text):
        raw = text.encode() + b"\0"
        number("I", len(raw))
        body.extend(raw)

    number("I", len(transforms))
    for m in transforms:
        number("i", m.header.stamp.sec)
        number("I", m.header.stamp.nanosec)
        string(m.header.frame_id)
        string(m.child_frame_id)
        number("d", *translation(m), *rotation(m))
    return b"\0\1\0\0" + bytes(body)
