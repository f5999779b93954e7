# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fuzz frozen files, and the same bytes in pickles: a ValueError, or a buffer that is sound."""

import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from geometry_msgs.msg import TransformStamped

from reliability.fuzz.buffer_checks import Fault, answers, holds_the_same
from reliability.fuzz.targets import ROOT, cdr
from tf2_py import BufferCore

# The format, written a second time.
sys.path.insert(0, str(ROOT / "tests" / "support"))
from frozen_format import HEADER, FrozenFile

MOST_BYTES = 4096
_folder = tempfile.TemporaryDirectory(prefix="tf2-fuzz-", dir="/dev/shm")
_path = Path(_folder.name, "frozen.tf2")


def run(data: bytes) -> None:
    """Read bytes as they are, and with the right size and checksums, which a fuzzer cannot find."""
    _read(data)
    if len(data) >= HEADER.size:
        file = FrozenFile(data)
        file.change_header(file_bytes=len(data))
        file.renew_checksum()
        _read(bytes(file.data))


def _read(data: bytes) -> None:
    opened, unpickled = _result(_opened, data), _result(_unpickled, data)
    if opened is None or unpickled is None:
        if opened is not unpickled:
            raise Fault(f"of the same bytes, the file gives {opened}, the pickle {unpickled}")
        return
    if not holds_the_same(opened, unpickled):
        raise Fault("a file and a pickle of the same bytes hold different samples")
    _change(opened)
    _change(unpickled)


def _result(read: Callable[[bytes], BufferCore], data: bytes) -> BufferCore | None:
    try:
        return read(data)
    except ValueError:
        return None


def _opened(data: bytes) -> BufferCore:
    _path.write_bytes(data)
    try:
        return BufferCore.open(_path)
    finally:
        _path.unlink()  # otherwise its state is only the path


def _unpickled(data: bytes) -> BufferCore:
    buffer = BufferCore()
    buffer.__setstate__({"image": data})
    return buffer


def _change(buffer: BufferCore) -> None:
    buffer._self_check()
    answers(buffer)
    buffer.set_transforms_cdr(cdr.TWO_TRANSFORMS, "after")
    buffer._self_check()
    answers(buffer)
    for frame in buffer.frames():
        link = TransformStamped(child_frame_id=frame)
        link.header.frame_id, link.header.stamp.sec = "replacing", 1
        buffer.set_transform(link, "after", replace=True)
    buffer._self_check()
    answers(buffer)
    buffer.clear()
    buffer._self_check()


def buffers() -> Iterator[BufferCore]:
    """Make buffers with static and moving frames, parents that change, and loops."""
    yield BufferCore()
    turn = (0.0, 0.0, 0.6, 0.8)
    for count in (1, 2, 5):
        for parents in ((b"map",), (b"map", b"odom"), (b"map", b"base"), (b"//map", b"camera")):
            buffer = BufferCore()
            rows = [(b"base", b"camera", 0, 0, (1.0, 2.0, 3.0), turn)]
            buffer.set_transforms_cdr(cdr.encoded(rows), "a", True)
            for i in range(count):
                rows = [
                    (b"map", b"odom", 100 + i, 0, (float(i), 0.0, 0.0), turn),
                    (parents[i % len(parents)], b"base", 100 + i, 5, (float(i), 1.0, 0.0), turn),
                ]
                buffer.set_transforms_cdr(cdr.encoded(rows), f"authority {i}")
            yield buffer


def seeds() -> Iterator[bytes]:
    """Frozen buffers."""
    for buffer in buffers():
        buffer.freeze(_path)
        yield _path.read_bytes()
        _path.unlink()
