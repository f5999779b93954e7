"""Shared buffers for tests, and what must always be true of them."""

import itertools
import mmap
import os
import struct
import subprocess
import sys
import threading
import time
from contextlib import contextmanager
from unittest.mock import patch

from making_objects import S, transform
from paths import PROGRAMS

from tf2_py import TransformException
from tf2_ros import Buffer
from tf2_ros._shared import owner
from tf2_ros._shared.shared_names import segment_path

_numbers = itertools.count()


def new_name():
    """A name that no other test uses, in no other run."""
    return f"test-{os.getpid()}-{next(_numbers)}"


@contextmanager
def pair(*arguments):
    """A buffer that is shared, and one that is attached to it."""
    shared = Buffer(*arguments, share=new_name())
    reader = Buffer(attach=shared._tf2_sharing.name)
    try:
        yield shared, reader
    finally:
        shared._tf2_sharing.close()


def ring_threads():
    """How many attachments of this process follow a ring."""
    return sum(one.name == "tf2_ros ring" for one in threading.enumerate())


# What `programs/shares_as_ordered.py` inserts: a chain of frames whose place follows from the time.

LINKS = 5


def links(ns, first_ns):
    """The transforms of one time: each moves by 1 m/s."""
    x = (ns - first_ns) / S
    return [
        transform("map" if i == 0 else f"f{i - 1}", f"f{i}", ns=ns, xyz=(x, 0.0, 0.0)) for i in range(LINKS)
    ]


def is_sound(buffer, first_ns, ages_ns=(0,)):
    """Whether lookups of the newest time, and of times before it, answer what was inserted; some do."""
    found = False
    try:
        newest = buffer.get_latest_common_time("map", f"f{LINKS - 1}").nanoseconds
    except TransformException:
        return False
    for age_ns in ages_ns:
        try:
            answer = buffer.lookup_transform_core("map", f"f{LINKS - 1}", newest - age_ns)
        except TransformException:
            continue
        stamp_ns = answer.header.stamp.sec * S + answer.header.stamp.nanosec
        wanted = LINKS * (stamp_ns - first_ns) / S
        assert abs(answer.transform.translation.x - wanted) < 1e-6, (answer, wanted)
        found = True
    return found


class Intruder:
    """
    Writes into the file of a shared buffer, as another process of the same user can; for a `with` statement.

    It writes to mapped memory, so no other thread gets the GIL meanwhile. The layout is that of `ring.pyx`.
    """

    HEAD, OLDEST_AT, RECORD, RING_AT, UNIT = struct.Struct("=QQQ"), 24, struct.Struct("=QQqIIII"), 1 << 16, 64
    CAPACITY_AT, NO_CHILD = 16, 0xFFFFFFFF

    def __init__(self, path):
        with open(path, "r+b") as file:
            self.memory = mmap.mmap(file.fileno(), 0)
        (self.capacity,) = struct.unpack_from("=Q", self.memory, self.CAPACITY_AT)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.memory.close()

    def head(self):
        """The positions `oldest`, `next` and `cleared`."""
        return self.HEAD.unpack_from(self.memory, self.OLDEST_AT)

    def set_head(self, *positions):
        """Replace the first ones of these."""
        self.HEAD.pack_into(self.memory, self.OLDEST_AT, *(positions + self.head()[len(positions) :]))

    def place(self, position):
        """Where a position is in the file."""
        return self.RING_AT + position % self.capacity

    def copy(self, position, to):
        """Write the record at a position again, as a valid one, at another one."""
        length = 4096
        record = self.memory[self.place(position) : self.place(position) + length]
        self.memory[self.place(to) : self.place(to) + length] = struct.pack("=QQ", to, to) + record[16:]

    def write(self, position, kind, content):
        """Write a record; the position behind it."""
        head = self.RECORD.pack(position, position, time.monotonic_ns(), kind, self.NO_CHILD, len(content), 0)
        record = head + content
        self.memory[self.place(position) : self.place(position) + len(record)] = record
        return position + -(-len(record) // self.UNIT) * self.UNIT


def small_ring():
    """Have buffers that are shared inside this have a ring of 1 MiB."""
    return patch.object(owner, "MOST_BYTES", owner.LEAST_BYTES)


class Owner:
    """A process of `programs/shares_as_ordered.py`, for a `with` statement, which kills it in the end."""

    def __init__(self, name=None):
        self.name = name or new_name()
        self.path = segment_path(self.name)
        self.process = subprocess.Popen(
            [sys.executable, str(PROGRAMS / "shares_as_ordered.py"), self.name],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def __enter__(self):
        self.said()
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.communicate()
        self.path.unlink(missing_ok=True)

    def said(self):
        """Its next line."""
        line = self.process.stdout.readline().split()
        assert line, f"it ended with {self.process.wait()}"
        return line

    def tell(self, *words):
        """Give it a line; its answer."""
        print(*words, file=self.process.stdin, flush=True)
        return self.said()
