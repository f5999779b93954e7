"""Fuzz shared memory: a reader of bytes that no owner wrote answers, whatever they are; it never crashes."""

import itertools
import os
import struct
from collections.abc import Iterator
from unittest.mock import patch

from reliability.fuzz.buffer_checks import answers, ask
from reliability.fuzz.fuzzer_input import Input
from reliability.fuzz.targets import cdr
from tf2_ros import Buffer, SharedBufferError
from tf2_ros._shared import owner as sharing
from tf2_ros._shared.shared_names import segment_path

MOST_BYTES = 512
_numbers = itertools.count()
# As in tf2_ros/_shared/ring.pyx: the head, the description, the ring.
TEXT_AT, RING_AT = 4096, 1 << 16
HEAD_BYTES, ARRIVALS_AT, RECORD_BYTES = 72, 12, 64
CAPACITY_AT, OLDEST_AT = 16, 24
MOST_STEPS = 16
# Positions around which those of the head are moved: where sums wrap, and where signs change.
PLACES = (0, 2**46, 2**62, 2**63, 2**64 - 2**17, 2**64)
ODD = (0, 1, 2, 0xFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 2**62, 2**63 - 1, 2**63, 2**64 - 1, 64, 4096, 5)


def run(data: bytes) -> None:
    """Change the memory of an owner, below readers that attached before and ones that attach after it."""
    given = Input(data)
    name = f"fuzz-{os.getpid()}-{next(_numbers)}"
    # The least size: spoiled numbers lead to less memory, and mapping it is quicker.
    with patch.object(sharing, "MOST_BYTES", sharing.LEAST_BYTES):
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
            reader._tf2_attachment.close()
            answers(reader)
            _insert(reader, 50)
            reader._self_check()
    finally:
        owner._tf2_sharing.close()


def _step(given: Input, memory: "_Memory", owner: Buffer, reader: Buffer, name: str, step: int) -> None:
    match given.below(8):
        case 0 | 1 | 2:
            memory.change(given)
        case 3:
            memory.move(given)
            _ask(reader)
        case 4:
            memory.publish()
            _ask(reader)
        case 5:
            _insert(owner, step)
            _ask(reader)
        case 6:
            owner.clear()
            _ask(reader)
        case _:
            memory.publish()
            try:
                _ask(Buffer(attach=name))
            except SharedBufferError:
                pass


def _insert(buffer: Buffer, step: int) -> None:
    turn = (0.0, 0.0, 0.6, 0.8)
    rows = [(b"map", b"odom", 101 + i + step, 0, (float(i), 0.0, 0.0), turn) for i in range(3)]
    rows.append((b"odom", f"f{step}".encode(), 5, 5, (1.0, 0.0, 0.0), turn))
    buffer.set_transforms_cdr(cdr.encoded(rows), "owner")
    buffer.set_transforms_cdr(cdr.encoded([(b"odom", b"base", 0, 0, (0.0,) * 3, turn)]), "fixed", True)


def _ask(reader: Buffer) -> None:
    reader._self_check()
    ask(reader, 3)
    reader.__getstate__()


class _Memory:
    # Of an owner, as a hostile process of the same user may change it.

    def __init__(self, name: str) -> None:
        self._descriptor = os.open(segment_path(name), os.O_RDWR)

    def __enter__(self) -> "_Memory":
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._descriptor)

    def change(self, given: Input) -> None:
        """Write something somewhere."""
        where = given.below(16)
        spot = given.byte()
        if where < 6:
            at = 4 * (spot % (HEAD_BYTES // 4))
        elif where == 6:
            at = TEXT_AT + spot
        elif where < 12:
            at = RING_AT + 4 * spot
        else:
            at = RING_AT + RECORD_BYTES * spot + 4 * given.below(16)
        os.pwrite(self._descriptor, self._value(given), at)

    def move(self, given: Input) -> None:
        """Move the positions of the head far away, perhaps with the oldest record, which is valid there."""
        capacity, oldest, newest = struct.unpack("<QQQ", os.pread(self._descriptor, 24, CAPACITY_AT))
        places = (*PLACES, oldest, newest)
        moved = [(given.choice(places) + 64 * (given.byte() - 128)) % 2**64 for _ in range(2)]
        if given.flag() and 0 < capacity < 2**40:
            record = os.pread(self._descriptor, 1024, RING_AT + oldest % capacity)
            os.pwrite(
                self._descriptor,
                struct.pack("<QQ", moved[0], moved[0]) + record[16:],
                RING_AT + moved[0] % capacity,
            )
        os.pwrite(self._descriptor, struct.pack("<QQ", *moved), OLDEST_AT)

    def _value(self, given: Input) -> bytes:
        kind = given.byte()
        if kind < 128:
            return given.some(1 + kind % 8) or b"\0"
        return struct.pack("<Q", ODD[kind % len(ODD)])[: 4 if kind & 16 else 8]

    def publish(self) -> None:
        """As an owner does after a record: those who sleep look at what has arrived."""
        (arrivals,) = struct.unpack("<I", os.pread(self._descriptor, 4, ARRIVALS_AT))
        os.pwrite(self._descriptor, struct.pack("<I", (arrivals + 1) % 2**32), ARRIVALS_AT)


def seeds() -> Iterator[bytes]:
    """Each kind of change, and a look at it by an old reader and a new one."""
    for where in range(16):
        for spot in (0, 5, 21, 33):
            for value in (bytes([3, 1, 0, 0, 0]), bytes([135 + 11 * where]) if where < 11 else bytes([146])):
                yield bytes([0, where, spot, spot % 16]) + value + bytes([4, 7, 5])
    for oldest in range(len(PLACES)):
        for newest in range(len(PLACES)):
            # To a far record, to the end of all positions behind it, and back to the beginning.
            far = [3, oldest, 128, oldest, 132, 1]
            yield bytes([*far, 3, oldest, 128, newest, 127, 0, 3, 0, 128, 0, 255, 0, 5])
