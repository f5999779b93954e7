# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Fuzz files of saved buffers: a ValueError, or a buffer that is sound."""

import tempfile
from collections.abc import Iterator
from io import BytesIO
from pathlib import Path

from mcap.records import Channel, Message, Metadata, Schema
from mcap.stream_reader import StreamReader
from mcap.writer import CompressionType, IndexType, Writer

from reliability.fuzz.buffer_checks import answers
from reliability.fuzz.targets import cdr
from reliability.fuzz.targets.frozen import buffers
from tf2_py import BufferCore
from tf2_ros_tools.bag import load_saved, save

MOST_BYTES = 8192
_folder = tempfile.TemporaryDirectory(prefix="tf2-fuzz-", dir="/dev/shm")
_path = Path(_folder.name, "saved.mcap")


def run(data: bytes) -> None:
    """Load a file."""
    _path.write_bytes(data)
    try:
        buffer = load_saved(_path, BufferCore)
    except (ValueError, MemoryError):
        return
    answers(buffer)
    buffer.set_transforms_cdr(cdr.TWO_TRANSFORMS, "after")
    buffer._self_check()


def _plain(path: Path) -> bytes:
    # The same records without compression and checksums, which a fuzzer cannot renew.
    made = BytesIO()
    written = Writer(
        made,
        compression=CompressionType.NONE,
        use_chunking=False,
        enable_crcs=False,
        index_types=IndexType.NONE,
        use_statistics=False,
        use_summary_offsets=False,
        repeat_channels=False,
        repeat_schemas=False,
    )
    written.start("ros2", "")
    schema = 0
    with open(path, "rb") as file:
        for record in StreamReader(file).records:
            match record:
                case Metadata():
                    written.add_metadata(record.name, record.metadata)
                case Schema() if not schema:
                    schema = written.register_schema(record.name, record.encoding, b"")
                case Channel() if record.id not in written._Writer__channels:
                    written.register_channel(record.topic, record.message_encoding, schema)
                case Message():
                    written.add_message(record.channel_id, record.log_time, record.data, 0)
    written.finish()
    return made.getvalue()


def seeds() -> Iterator[bytes]:
    """Saved buffers; most without checksums."""
    for number, buffer in enumerate(buffers()):
        save(buffer, _path)
        whole, plain = _path.read_bytes(), _plain(_path)
        yield plain
        if number == 1:
            yield whole
