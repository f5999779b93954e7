# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Copy recordings message by message, with all that describes their topics, to .mcap files."""

from __future__ import annotations

import re
import struct
from collections import Counter
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from itertools import islice
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory
from typing import IO, TYPE_CHECKING, Any, NamedTuple, TypeAlias

from tf2_py.printable import counted, printable
from tf2_ros_tools.recordings.bag_reader import (
    PACKED,
    STORAGES,
    ZSTD,
    BagError,
    Raw,
    Recorded,
    connection_of,
    decompressed,
    encoding_of,
    explained,
    full_name,
    open_recording,
    typestore,
)
from tf2_ros_tools.recordings.frame_names import HEADER
from tf2_ros_tools.recordings.saved_buffers import QOS, TYPE

if TYPE_CHECKING:
    from rosbags.interfaces import Connection, Qos
    from rosbags.typesys.store import Typestore

CHUNK_BYTES = 1 << 20
MESSAGE = struct.Struct("<HIQQ")  # of a message in mcap: channel, sequence, log time, time of publication
RECORD = struct.Struct("<BQ")  # what each record begins with: what it is, and its size
ABOUT = "rosbag2"  # the metadata that rosbag2 itself writes
COMPRESSED = re.compile(
    r"(\bcompression_(?:format|mode): *)['\"]?(?:zstd|message|file)\b['\"]?", re.IGNORECASE
)
LATCHED = re.compile(r"\bdurability: *['\"]?(?:transient_local|1)\b")
# Humble writes the numbers of rosbag2's constants; a player of Jazzy reads all channels in the same way.
OLD_QOS = re.compile(r"history: *['\"]?\d")
NUMBERS = {"keep_last": 1, "reliable": 1, "transient_local": 1, "automatic": 1}

Key: TypeAlias = tuple[int, int]  # a file, and a channel in it
Schema: TypeAlias = tuple[str, str, bytes]  # name, encoding and text


class Item(NamedTuple):
    """A recorded message, and what it was recorded with."""

    channel: Key
    log_ns: int
    publish_ns: int
    sequence: int
    raw: Raw


class Channel(NamedTuple):
    """How a topic, or one publisher of it, was recorded."""

    connection: Connection
    schema: Schema
    metadata: dict[str, str]

    @property
    def qos(self) -> str:
        return self.metadata.get("offered_qos_profiles", "")

    @property
    def is_latched(self) -> bool:
        """Whether late subscribers get its last messages."""
        return LATCHED.search(self.qos) is not None


# Where the messages come from.


@contextmanager
def in_ros_2(path: Path, place: Path) -> Iterator[Path]:
    """
    Get a recording itself, or a copy in ROS 2's format if it is of ROS 1, during a ``with`` statement.

    :param place: the folder with the copy.
    """
    if not path.is_file() or not path.name.endswith((".bag", f".bag{PACKED}")):
        yield path
        return
    from rosbags.convert.converter import ConverterError, convert
    from rosbags.highlevel import AnyReaderError

    with _folder_in(place) as folder:
        copy = folder / "copy"
        with open_recording(path) as recorded:  # explains what is wrong with it
            [bag] = recorded.files
            try:
                convert([bag], copy, STORAGES[".mcap"], 9, None, "", None, _types_of(bag), (), (), (), ())
            except (ConverterError, AnyReaderError) as error:
                if isinstance(error.__cause__, OSError):  # of the copy
                    raise error.__cause__ from None
                raise BagError(f"{printable(str(path))}: {printable(str(error))}") from error
        yield copy


@contextmanager
def _folder_in(place: Path) -> Iterator[Path]:
    """Make a folder that exists during a ``with`` statement."""
    folder = TemporaryDirectory(prefix=".tf2-ros-cython-", dir=place)
    try:
        with folder:
            yield Path(folder.name)
    finally:  # if an interrupt has ended its removal
        rmtree(folder.name, ignore_errors=True)


def _types_of(bag: Path) -> Typestore:
    """
    Get the types of a recording of ROS 1, as those of ROS 2.

    The converter would make the same ones, but print which type it has renamed.
    """
    from rosbags.convert.converter import STATIC_MSGTYPE_RENAMES
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([bag]) as reader:
        found = {**reader.typestore.fielddefs}
    for old, new in STATIC_MSGTYPE_RENAMES.items():
        if old in found:
            found.setdefault(new, found[old])
    store = get_typestore(Stores.EMPTY)
    store.register({**found, HEADER: typestore().fielddefs[HEADER]})
    return store


class Mcaps:
    """The files of a recording in mcap, one after the other, each in the order of the file."""

    def __init__(self, recorded: Recorded) -> None:
        from mcap.reader import make_reader

        self._files, self._counts, self.channels = recorded.files, list[int | None](), dict[Key, Channel]()
        self.compression, self.profile = "", ""
        counts = {one.name: one.count for one in recorded.topics.values()}
        for number, path in enumerate(self._files):
            with open(path, "rb") as file:
                reader = make_reader(file)
                header, summary = reader.get_header(), reader.get_summary()
            if summary is None:
                raise explained(ValueError("it has no index"), str(path))
            self.profile = self.profile or header.profile
            # Writers leave small chunks as they are, such as the first one.
            self.compression = self.compression or next(
                (one.compression for one in summary.chunk_indexes if one.compression), ""
            )
            about = summary.statistics
            self._counts.append(None if about is None else about.message_count)
            # A file need not count the messages of each channel; any may then have some.
            unknown = about.message_count if about and not about.channel_message_counts else 0
            for one in summary.channels.values():
                schema = summary.schemas.get(one.schema_id)
                own = ("", "", b"") if schema is None else (schema.name, schema.encoding, schema.data)
                connection = connection_of(one, schema, counts.get(one.topic, 0) + unknown, self)
                self.channels[number, one.id] = Channel(_defined(recorded, connection), own, one.metadata)

    def items(self, writer: Any) -> Iterator[Item]:
        """Yield the messages, and write what else the files have."""
        from mcap.records import Attachment, Metadata

        written: set[tuple[str, tuple[tuple[str, str], ...]]] = set()
        for number, (path, count) in enumerate(zip(self._files, self._counts, strict=True)):
            read = 0
            for one in _records(path, number):
                if isinstance(one, Item):
                    yield self._decompressed(one)
                    read += 1
                elif isinstance(one, Attachment):
                    about = one.create_time, one.log_time, one.name, one.media_type
                    writer.add_attachment(*about, one.data)
                elif isinstance(one, Metadata):
                    # Each file of a folder has that of rosbag2, about itself.
                    same = one.name, () if one.name == ABOUT else tuple(one.metadata.items())
                    if same not in written:
                        written.add(same)
                        writer.add_metadata(one.name, _described(one))
            if count is not None and read < count:
                # What is not recognized as a message is skipped.
                raise ValueError(f"its index counts {counted(count, 'message')}, but {read} can be read")

    def _decompressed(self, item: Item) -> Item:
        if item.channel not in self.channels:
            raise ValueError("a message of no topic: its index does not repeat all channels")
        # No message in CDR begins like this.
        if item.raw[:4] != ZSTD or encoding_of(self.channels[item.channel].connection) != "cdr":
            return item
        return item._replace(raw=decompressed(item.raw))


def _records(path: Path, number: int) -> Iterator[Any]:
    """Yield the messages of a file as items, and its other records as those of the library mcap."""
    from mcap.records import Chunk, Message
    from mcap.stream_reader import StreamReader, get_chunk_data_stream

    with open(path, "rb") as file:
        for record in StreamReader(file, emit_chunks=True, validate_crcs=True).records:
            if isinstance(record, Chunk):
                stream, size = get_chunk_data_stream(record, validate_crc=True)
                yield from _in_chunk(number, memoryview(stream.read(size)))
            elif isinstance(record, Message):
                about = record.log_time, record.publish_time, record.sequence
                yield Item((number, record.channel_id), *about, record.data)
            else:
                yield record


def _in_chunk(number: int, chunk: memoryview) -> Iterator[Item]:
    from mcap.opcode import Opcode

    begin, message = 0, int(Opcode.MESSAGE)
    while begin < len(chunk):
        kind, size = RECORD.unpack_from(chunk, begin)
        begin += RECORD.size
        if kind == message:
            channel, sequence, log_ns, publish_ns = MESSAGE.unpack_from(chunk, begin)
            raw = chunk[begin + MESSAGE.size : begin + size]
            yield Item((number, channel), log_ns, publish_ns, sequence, raw)
        begin += size


def _described(record: Any) -> dict[str, str]:
    """Get a record of metadata; rosbag2's no longer says that the messages are compressed."""
    if record.name != ABOUT:
        return {**record.metadata}
    return {key: COMPRESSED.sub(r'\1""', text) for key, text in record.metadata.items()}


class Others:
    """The messages of any other recording, in the order of log times."""

    compression, profile = "zstd", "ros2"

    def __init__(self, recorded: Recorded) -> None:
        self._recorded = recorded
        own = [_defined(recorded, one) for one in recorded.connections(recorded.topics)]
        self.channels = {(id(one.owner), one.id): Channel(one, _schema(one), _metadata(one)) for one in own}

    def items(self, writer: Any) -> Iterator[Item]:
        """Yield the messages."""
        for one, log_ns, raw in self._recorded.raw(self._recorded.topics, convert=False):
            yield Item((id(one.owner), one.id), log_ns, log_ns, 0, raw)


def _defined(recorded: Recorded, connection: Connection) -> Connection:
    """Give a connection ROS 2's definition of its type, if it has none and its first message is like that."""
    from rosbags.interfaces import MessageDefinition
    from rosbags.interfaces import MessageDefinitionFormat as Format

    store, msgtype = typestore(), full_name(connection.msgtype)
    is_defined = connection.msgdef.format != Format.NONE or msgtype not in store.fielddefs
    if is_defined or encoding_of(connection) != "cdr":
        return connection
    try:
        for _, _, raw in islice(recorded.raw([connection.topic]), 1):
            store.deserialize_cdr(raw, msgtype)
    except Exception:  # of an earlier ROS 2, or damaged, which is found when it is copied
        return connection
    text, _ = store.generate_msgdef(msgtype, ros_version=2)
    return connection._replace(msgdef=MessageDefinition(Format.MSG, text))


def _schema(connection: Connection) -> Schema:
    from rosbags.interfaces import MessageDefinitionFormat as Format

    form, text = connection.msgdef  # players that have the type do not need it
    encoding = {Format.MSG: "ros2msg", Format.IDL: "ros2idl"}.get(form, "")
    return full_name(connection.msgtype), encoding, text.encode()


def _metadata(connection: Connection) -> dict[str, str]:
    offered: list[Qos] = getattr(connection.ext, "offered_qos_profiles", [])
    found = {"offered_qos_profiles": "\n".join(map(_qos_text, offered))}
    if connection.digest.startswith("RIHS"):
        found["topic_type_hash"] = connection.digest
    return found


def _qos_text(qos: Qos) -> str:
    def time(one: Any) -> str:
        return f"{{sec: {one.sec}, nsec: {one.nsec}}}"

    return f"""\
- history: {qos.history.name.lower()}
  depth: {qos.depth}
  reliability: {qos.reliability.name.lower()}
  durability: {qos.durability.name.lower()}
  deadline: {time(qos.deadline)}
  lifespan: {time(qos.lifespan)}
  liveliness: {qos.liveliness.name.lower()}
  liveliness_lease_duration: {time(qos.liveliness_lease_duration)}
  avoid_ros_namespace_conventions: {str(qos.avoid_ros_namespace_conventions).lower()}"""


# Where they go.


class Output:
    """
    An .mcap file that is written.

    ``numbers`` has the numbers of the channels that were copied, by those of the recording.

    :param source: has the messages.
    """

    def __init__(self, file: IO[bytes], source: Mcaps | Others) -> None:
        from mcap.writer import CompressionType, Writer

        self._writer = Writer(
            file, CHUNK_BYTES, compression=CompressionType[(source.compression or "none").upper()]
        )
        self._writer.start(profile=source.profile, library="tf2_bag rewrite")
        self._source, self.numbers = source, dict[Key, int]()
        self._schemas: dict[Schema, int] = {}
        self._channels: dict[Any, int] = {}
        self._alike = Counter[Any]()

    def items(self) -> Iterator[Item]:
        """Get the messages of the recording."""
        return self._source.items(self._writer)

    def add_channel(self, key: Key, one: Channel) -> int:
        """Copy a channel of the recording."""
        # The files of a folder repeat them, with other ids; a file may have several for a topic.
        encoding = encoding_of(one.connection)
        same = one.connection.topic, encoding, one.schema, tuple(sorted(one.metadata.items()))
        self._alike[key[0], same] += 1
        nth = same, self._alike[key[0], same]
        if nth not in self._channels:
            schema = self._schema(one.schema) if one.schema[0] else 0
            self._channels[nth] = self._writer.register_channel(
                one.connection.topic, encoding, schema, one.metadata
            )
        self.numbers[key] = self._channels[nth]
        return self.numbers[key]

    def add_transforms(self, topic: str, like: str) -> int:
        """
        Add a channel with transforms.

        :param like: the topic, ``/tf`` or ``/tf_static``, whose QoS it has.
        """
        definition, _ = typestore().generate_msgdef(TYPE, ros_version=2)
        qos = {"offered_qos_profiles": _in_style_of(self._source.channels, QOS[like])}
        schema = self._schema((TYPE, "ros2msg", definition.encode()))
        return self._writer.register_channel(topic, "cdr", schema, qos)

    def _schema(self, schema: Schema) -> int:
        if schema not in self._schemas:
            self._schemas[schema] = self._writer.register_schema(*schema)
        return self._schemas[schema]

    def write(self, number: int, item: Item, raw: Raw) -> None:
        """Write the data ``raw`` to a channel, with all else that an item has."""
        self._writer.add_message(number, item.log_ns, raw, item.publish_ns, item.sequence)  # type: ignore[arg-type]

    def finish(self) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]


def _in_style_of(channels: Mapping[Key, Channel], qos: str) -> str:
    """Write the constants in a QoS as numbers if those of the recording are, which a player then expects."""
    if any(OLD_QOS.search(one.qos) for one in channels.values()):
        for name, number in NUMBERS.items():
            qos = qos.replace(f": {name}", f": {number}")
    return qos
