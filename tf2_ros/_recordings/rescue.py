"""Owns what can be read of a broken recording: file by file, each from its beginning to the break."""

import re
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Collection, Iterator
from contextlib import AbstractContextManager, ExitStack
from io import BytesIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, BinaryIO, TypeAlias

from tf2_ros._recordings.problems import BagError, broken, explained, needing

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

__all__ = ["LAST_NS", "RawMessage", "Reader", "decompressed", "rescued"]

RawMessage: TypeAlias = "tuple[Connection, int, bytes | memoryview]"
# Of rosbags, or with what is used of these: `connections`, `start_time`, `end_time` (after the last message),
# `message_count`, and `messages(connections, start, stop)`.
Reader: TypeAlias = Any
# The number of a connection, log time, data.
Item: TypeAlias = tuple[int, int, bytes]

LAST_NS = (1 << 63) - 1  # log times are int64
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


def rescued(
    path: Path,
    stack: ExitStack,
    problems: list[str],
    opened: Callable[[Path], AbstractContextManager[Reader]],
) -> list[Reader]:
    """
    Readers of what can be read of a recording.

    :param stack: closes them.
    :param problems: what cannot be read is added to it.
    :param opened: opens a file that is whole, and raises a BagError for any other.
    """
    readers: list[Reader] = []
    for stored in _files(path):
        file = stored
        try:
            if stored.suffix == ".zstd":
                file = _decompressed_file(stored, stack, problems)
            readers.append(stack.enter_context(opened(file)))
        except BagError as error:
            problems.append(error.found.replace(str(file), str(stored)))
            kind = SCANS.get(file.suffix)
            scan = None if kind is None else kind(file)
            if scan is not None and scan.message_count:
                readers.append(scan)
    return readers


def _files(path: Path) -> list[Path]:
    # In the order in which a recorder splits them: their names end in numbers. Opening a pipe would wait.
    if not path.is_dir():
        return [path] if path.is_file() else []
    files = [one for one in path.iterdir() if one.suffix in (".mcap", ".db3", ".zstd") and one.is_file()]
    return sorted(files, key=lambda one: [int(part) for part in re.findall(r"\d+", one.name)])


def _decompressed_file(path: Path, stack: ExitStack, problems: list[str]) -> Path:
    # As far as it can be decompressed.
    file = Path(stack.enter_context(TemporaryDirectory()), path.stem)
    with open(path, "rb") as source, open(file, "wb") as copy:
        try:
            _zstandard().ZstdDecompressor().copy_stream(source, copy)
        except _zstandard().ZstdError as error:
            problems.append(broken(error, str(path)).found)
    return file


def decompressed(messages: Iterator[RawMessage]) -> Iterator[RawMessage]:
    """Messages that may be compressed one by one: only metadata.yaml would tell, and it may be lost."""
    for connection, log_ns, data in messages:
        if data[:4] == ZSTD_MAGIC:
            data = _zstandard().ZstdDecompressor().decompressobj().decompress(data)
        yield connection, log_ns, data


def _zstandard() -> Any:
    with needing("zstandard", "bag"):
        import zstandard
    return zstandard


class Scan(ABC):
    """
    A broken file, read from its beginning to the break; without an index, and without the rest.

    It has what is used of the readers of rosbags. Everything is read twice: first to count.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._known: dict[int, Connection] = {}
        counts: Counter[int] = Counter()
        self.start_time, self.end_time = 2**63 - 1, 0
        for number, log_ns, _ in self._items():
            counts[number] += 1
            self.start_time = min(self.start_time, log_ns)
            self.end_time = max(self.end_time, log_ns + 1)
        self.connections = [one._replace(msgcount=counts[one.id]) for one in self._known.values()]
        self.message_count = counts.total()

    def messages(
        self, connections: "Collection[Connection]", start: int | None, stop: int | None
    ) -> Iterator[RawMessage]:
        wanted = {one.id: one for one in connections}
        for number, log_ns, data in self._items():
            if number in wanted and (start is None or start <= log_ns) and (stop is None or log_ns < stop):
                yield wanted[number], log_ns, data

    def _items(self) -> Iterator[Item]:
        with open(self.path, "rb") as file:
            try:
                for item in self._read(file):
                    if item[1] > LAST_NS:
                        return  # spoiled, too
                    yield item
            except Exception as error:
                if not isinstance(explained(error, str(self.path)), BagError):
                    raise
                # The break, which opening the file has told of.

    @abstractmethod
    def _read(self, file: BinaryIO) -> Iterator[Item]:
        """All messages; raises at the break. What it learns of connections goes into ``_known``."""


class McapScan(Scan):
    """An .mcap."""

    def _read(self, file: BinaryIO) -> Iterator[Item]:
        with needing("mcap", "bag"):
            from mcap.records import Channel, Message, Schema
            from mcap.stream_reader import StreamReader

        schemas: dict[int, Schema] = {}
        for record in StreamReader(file, validate_crcs=True).records:
            if isinstance(record, Message):
                yield record.channel_id, record.log_time, record.data
            elif isinstance(record, Schema):
                schemas[record.id] = record
            elif isinstance(record, Channel) and record.id not in self._known:
                self._known[record.id] = self._connection(record, schemas.get(record.schema_id))

    def _connection(self, channel: Any, schema: Any) -> "Connection":
        from rosbags.interfaces import (
            Connection,
            ConnectionExtRosbag2,
            MessageDefinition,
            MessageDefinitionFormat,
        )

        form, text, msgtype = MessageDefinitionFormat.NONE, "", "__schemaless__"
        if schema is not None:
            msgtype = schema.name
            if schema.encoding == "ros2msg":
                form, text = MessageDefinitionFormat.MSG, schema.data.decode()
        definition = MessageDefinition(form, text)
        ext = ConnectionExtRosbag2(channel.message_encoding, [])
        return Connection(channel.id, channel.topic, msgtype, definition, "", 0, ext, self)


class Ros1Scan(Scan):
    """A .bag of ROS 1."""

    def _read(self, file: BinaryIO) -> Iterator[Item]:
        file.readline()
        yield from self._records(file)

    def _records(self, file: BinaryIO) -> Iterator[Item]:
        from rosbags.rosbag1.reader import (
            Header,
            ReaderError,
            RecordType,
            decompressors,
            read_bytes,
            read_uint32,
        )

        while file.read(1):
            file.seek(-1, 1)
            header = Header.read(file)
            data = read_bytes(file, read_uint32(file))
            kind = header.get_uint8("op")
            if kind == RecordType.CHUNK:
                compression = header.get_string("compression")
                if compression not in decompressors:
                    raise ReaderError(f"Compression {compression!r} is not supported.")
                yield from self._records(BytesIO(decompressors[compression](data)))
            elif kind == RecordType.CONNECTION:
                number = header.get_uint32("conn")
                about = Header.read(BytesIO(len(data).to_bytes(4, "little") + data))
                self._known.setdefault(number, self._connection(number, header.get_string("topic"), about))
            elif kind == RecordType.MSGDATA:
                yield header.get_uint32("conn"), header.get_time("time"), data

    def _connection(self, number: int, topic: str, about: Any) -> "Connection":
        from rosbags.interfaces import (
            Connection,
            ConnectionExtRosbag1,
            MessageDefinition,
            MessageDefinitionFormat,
        )
        from rosbags.rosbag1.reader import normalize
        from rosbags.typesys.msg import normalize_msgtype

        definition = MessageDefinition(MessageDefinitionFormat.MSG, about.get_string("message_definition"))
        msgtype = normalize_msgtype(about.get_string("type"))
        ext = ConnectionExtRosbag1(None, None)
        return Connection(number, normalize(topic), msgtype, definition, "", 0, ext, self)


SCANS: dict[str, type[Scan]] = {".mcap": McapScan, ".bag": Ros1Scan}
