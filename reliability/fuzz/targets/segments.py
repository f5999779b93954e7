"""Owns fuzzing shared memory: a reader of bytes that no owner wrote leaves, or answers; it never crashes."""

import itertools
import mmap
import os
import resource
import struct
from collections.abc import Iterator
from contextlib import contextmanager

from reliability.fuzz.faults import Fault, answers, ask
from reliability.fuzz.reading import Input
from reliability.fuzz.targets import cdr_ros
from tf2_ros import Buffer, SharedBufferError
from tf2_ros._shared.names import segment_path

_numbers = itertools.count()
# As in tf2_py/_core/segment.pxd.
SEQUENCE_AT, FACTS_AT, FACTS_BYTES, ABOUT_AT = 32, 40, 176, 1024
BOARD_AT, LOG_AT, ROWS_AT, ROW_BYTES = 4096, 8192, 131072, 64
NAMES, AUTHORITIES, RINGS = 1, 2, 3  # sixteenths of its size
RING_BYTES = 8192
SEGMENT_BYTES = 1 << 28  # the least of SIZES in tf2_ros/_shared/segment.pyx
MOST_STEPS = 16
ODD = (0, 1, 2, 0xFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 2**62, 2**63 - 1, 2**63, 2**64 - 1, 64, 4096, 5)


def run(data: bytes) -> None:
    """Change the memory of an owner, below readers that attached before and ones that attach after it."""
    given = Input(data)
    name = f"fuzz-{os.getpid()}-{next(_numbers)}"
    with _small_files():
        owner = Buffer(share=name)
    try:
        _insert(owner, 0)
        with _Memory(name) as memory:
            reader = Buffer(attach=name)
            for step in range(MOST_STEPS):
                if not given.left:
                    break
                _step(given, memory, owner, reader, name, step)
            _ask(reader)
            reader._leave()
            answers(reader)
            _insert(reader, 50)
            reader._self_check()
    finally:
        owner._sharing.close()


@contextmanager
def _small_files() -> Iterator[None]:
    # The segment is then of the least size: spoiled numbers lead to less memory, and mapping it is quicker.
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (SEGMENT_BYTES, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def _step(given: Input, memory: "_Memory", owner: Buffer, reader: Buffer, name: str, step: int) -> None:
    match given.below(8):
        case 0 | 1 | 2 | 3:
            memory.change(given)
        case 4:
            memory.end_write()
            _ask(reader)
        case 5:
            _insert(owner, step)
            _ask(reader)
        case 6:
            owner.clear()
            _ask(reader)
        case _:
            memory.end_write()
            try:
                _ask(Buffer(attach=name))
            except SharedBufferError:
                pass


def _insert(buffer: Buffer, step: int) -> None:
    turn = (0.0, 0.0, 0.6, 0.8)
    rows = [(b"map", b"odom", 101 + i + step, 0, (float(i), 0.0, 0.0), turn) for i in range(3)]
    rows.append((b"odom", f"f{step}".encode(), 5, 5, (1.0, 0.0, 0.0), turn))
    buffer.set_transforms_cdr(cdr_ros.encoded(rows), "owner")
    buffer.set_transforms_cdr(cdr_ros.encoded([(b"odom", b"base", 0, 0, (0.0,) * 3, turn)]), "fixed", True)


def _ask(reader: Buffer) -> None:
    try:
        reader._self_check()
    except AssertionError:
        # What another process says of its samples need not be true, only never lead outside of the memory.
        if not reader._is_attached:
            raise
    ask(reader, 3)
    reader.__getstate__()
    if reader._is_attached and not isinstance(reader._why_left, type(None)):
        raise Fault(f"attached, and left because {reader._why_left}")


class _Memory:
    # Of an owner, as a hostile process of the same user may change it.

    def __init__(self, name: str) -> None:
        descriptor = os.open(segment_path(name), os.O_RDWR)
        try:
            self.size = os.fstat(descriptor).st_size
            self._maps = {
                begin: mmap.mmap(descriptor, size, offset=begin)
                for begin, size in (
                    (0, ROWS_AT + 16 * ROW_BYTES),
                    (self.size // 16 * NAMES, 4096),
                    (self.size // 16 * AUTHORITIES, 4096),
                    (self.size // 16 * RINGS, RING_BYTES),
                )
            }
        finally:
            os.close(descriptor)
        # Beyond what was committed the file has holes, which reading them fills with zeros.

    def __enter__(self) -> "_Memory":
        return self

    def __exit__(self, *_: object) -> None:
        for one in self._maps.values():
            one.close()

    def change(self, given: Input) -> None:
        """Write something somewhere."""
        where = given.below(16)
        spot = given.byte()
        if where < 2:
            at = 8 * (spot % 6)  # the head; a sequence that stays odd costs a third of a second
            if at == SEQUENCE_AT and spot < 200:
                at = FACTS_AT
        elif where < 6:
            at = FACTS_AT + 4 * (spot % (FACTS_BYTES // 4))
        elif where == 6:
            at = ABOUT_AT + spot
        elif where == 7:
            at = (BOARD_AT if spot & 1 else LOG_AT) + spot // 2 * 4
        elif where < 12:
            at = ROWS_AT + ROW_BYTES * (spot % 12) + 4 * given.below(16)
        else:
            part = (NAMES, AUTHORITIES, RINGS, RINGS)[where - 12]
            at = self.size // 16 * part + 2 * spot
            if where == 15:
                at += given.byte() * 16
        self._write(at, self._value(given))

    def _value(self, given: Input) -> bytes:
        kind = given.byte()
        if kind < 128:
            return given.some(1 + kind % 8) or b"\0"
        return struct.pack("<Q", ODD[kind % len(ODD)])[: 4 if kind & 16 else 8]

    def _write(self, at: int, value: bytes) -> None:
        begin = max(begin for begin in self._maps if begin <= at)
        memory = self._maps[begin]
        at = min(at - begin, len(memory) - len(value))
        memory[at : at + len(value)] = value

    def end_write(self) -> None:
        """As an owner ends a write: those who follow look at what has changed."""
        head = self._maps[0]
        (sequence,) = struct.unpack_from("<Q", head, SEQUENCE_AT)
        struct.pack_into("<Q", head, SEQUENCE_AT, (sequence + 2 & ~1) % 2**64)


def seeds() -> Iterator[bytes]:
    """Each kind of change, and a look at it by an old reader and a new one."""
    for where in range(16):
        for spot in (0, 5, 21, 33):
            for value in (bytes([3, 1, 0, 0, 0]), bytes([135 + 11 * where]) if where < 11 else bytes([146])):
                yield bytes([0, where, spot, spot % 16]) + value + bytes([4, 7, 5])
