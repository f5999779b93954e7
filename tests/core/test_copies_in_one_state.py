# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""A copy holds what its buffer held when it was begun, whatever is written meanwhile."""

import io
import tempfile
from pathlib import Path

import pytest
from messages_with_or_without_ros import Duration
from pickles_and_copies import image_of
from times_and_transforms import at_ns, transform

from tf2_py import BufferCore, atomic_files


def image_during(buffer, write):
    """The file of a buffer into which `write` writes when its histories are pinned and not yet copied."""
    writes = [write]

    class File(io.FileIO):
        """The index is written first, then the samples are copied."""

        def write(self, data):
            if writes:
                writes.pop()(buffer)
            return super().write(data)

    with tempfile.TemporaryDirectory() as folder, pytest.MonkeyPatch.context() as patch:
        patch.setattr(atomic_files, "whole_file", lambda path: File(path, "w+"))
        buffer.freeze(path := Path(folder) / "frozen")
        assert not writes
        return path.read_bytes()


def filled(first_ns=1):
    """Longer than the cache time, so that the ring of `odom` has wrapped, unless the first stamp is 90 ns."""
    buffer = BufferCore(Duration(nanoseconds=80))
    for ns in range(first_ns, 170):
        buffer.set_transform(transform("map", "odom", ns=ns, xyz=(ns, 0, 0)), "x")
    for i in range(64):
        buffer.set_transform(transform("map", "base", ns=150, xyz=(i, 0, 0)), "x")
    buffer.set_transform(transform("odom", "base", ns=160), "x")
    buffer.set_transform_static(transform("base", "camera", xyz=(1, 0, 0)), "x")
    return buffer


def insert(parent, child, *stamps):
    def write(buffer):
        for ns in stamps:
            buffer.set_transform(transform(parent, child, ns=ns, xyz=(-ns, 0, 0)), "x")

    return write


def insert_static(parent, child):
    return lambda buffer: buffer.set_transform_static(transform(parent, child, xyz=(2, 0, 0)), "x")


def replace(parent, child, *stamps, static=False):
    links = [transform(parent, child, ns=ns, xyz=(-ns, 0, 0)) for ns in stamps]
    return lambda buffer: buffer.set_transforms(links, "x", static, replace=True)


WRITES = {
    "a sample": insert("map", "odom", 180),
    "many samples": insert("map", "odom", *range(180, 1000)),
    "samples that end all others": insert("map", "odom", 1000, 2000, 3000),
    "many that are written where they were": insert("map", "odom", 1000, 2000, *range(3000, 3100)),
    "a late sample": insert("map", "odom", 110),
    "many late samples": insert("map", "odom", *[110, 165] * 30, *range(101, 169)),
    "an older sample": insert("map", "odom", 90),
    "the 65th sample of a stamp": insert("map", "base", 150),
    "another parent": insert("map", "base", 155, 165),
    "another static transform": insert_static("odom", "camera"),
    "a static transform of a dynamic frame": insert_static("map", "odom"),
    "a dynamic transform of a static frame": insert("base", "camera", 100, 110),
    "samples that replace some": replace("map", "odom", 110, 120, 130),
    "samples that replace all": replace("map", "odom", *range(100, 181)),
    "a static transform that replaces another": replace("odom", "camera", 1, static=True),
    "clear": BufferCore.clear,
    "samples after a clear": lambda buffer: (buffer.clear(), insert("map", "odom", *range(180, 190))(buffer)),
    "init": BufferCore.__init__,
}


@pytest.mark.parametrize("write", WRITES)
def test_a_copy_holds_what_the_buffer_held_when_it_was_begun(write):
    for first_ns in range(1, 91, 3):  # the oldest sample is at many places of the ring
        buffer, twin = filled(first_ns), filled(first_ns)
        before = image_of(buffer)
        assert image_during(buffer, WRITES[write]) == before
        # And what was written is there.
        WRITES[write](twin)
        buffer._self_check()
        assert image_of(buffer) == image_of(twin)


def test_a_copy_within_a_copy_is_of_its_own_moment():
    buffer, twin = filled(), filled()
    inner = []

    def write(buffer):
        # The outer copy still reads what these end.
        insert("map", "odom", 180, 200, 220)(buffer)
        inner.append(image_of(buffer))
        insert("map", "odom", *range(221, 400, 2), 350)(buffer)

    assert image_during(buffer, write) == image_of(twin)
    insert("map", "odom", 180, 200, 220)(twin)
    assert inner == [image_of(twin)]


@pytest.mark.parametrize("ns", [50, 1050, 2000])
def test_a_full_buffer_takes_a_sample_while_it_is_read(ns):
    # Its ring has free slots, but may not grow; in other memory it is as large as before.
    def eighty(**limits):
        buffer = BufferCore(Duration(nanoseconds=10_000), **limits)
        for i in range(80):
            buffer.set_transform(transform("map", "odom", ns=100 + 20 * i), "x")
        return buffer

    size = eighty().statistics()["bytes"]
    buffer = eighty(max_bytes=size + 10)
    before = image_of(buffer)
    assert image_during(buffer, insert("map", "odom", ns)) == before
    statistics = buffer.statistics()
    assert (statistics["samples"], statistics["bytes"]) == (81, size)
    assert buffer.can_transform_core("map", "odom", at_ns(ns))[0]
    buffer._self_check()
