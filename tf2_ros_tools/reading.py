"""Read recordings of all formats, including broken ones, as raw messages in CDR."""

import errno
import os
import re
import shutil
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import chain
from os import PathLike
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tf2_ros_tools import foxglove, serialised
from tf2_ros_tools.output import counted, printable

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.typesys.store import Typestore

RawMessage: TypeAlias = "tuple[Connection, int, bytes | memoryview]"
# A reader of rosbags, or an object with this part of its interface: `connections`, `start_time`, `end_time`
# (after the last message), `message_count`, and `messages(connections, start, stop)`.
Reader: TypeAlias = Any

LAST_NS = (1 << 63) - 1  # log times are int64
# The name of the metadata with which a file begins that a buffer has saved.
SAVED = b"tf2_ros_cython.buffer"


# The argument of `load` and the option of tf2_bag have this name.
IN_PART = "the option partial reads what can be read of it"
# What rosbags says about files without their end, which does not explain the cause. It reads a .bag only
# through the index at its end.
ENDLESS = "File end magic is invalid"
ENDLESS_ROS1 = ("Bag is not indexed", "Bag index looks damaged")


class BagError(ValueError):
    """
    A recording cannot be read; the text names the file, the topic, and what was found.

    ``found`` is the text without the advice to read the recording in part.
    """

    def __init__(self, found: str, *, readable_in_part: bool = False) -> None:
        super().__init__(f"{found}; {IN_PART}" if readable_in_part else found)
        self.found = found
        self.readable_in_part = readable_in_part


class BagWarning(UserWarning):
    """A recording was read, but not all of it."""


def explained(error: Exception, path: str, where: str = "") -> Exception:
    """
    Get the BagError for an error that a file's bytes caused, or the error itself if it has another cause.

    The libraries define error classes only for some kinds of damage.

    :param where: in the file.
    """
    if isinstance(error, (BagError, ImportError)):
        return error
    # About bad data, bz2 raises an OSError without a number; a damaged length leads to an invalid position.
    if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL):
        return error
    found = str(error).rstrip(".")
    if isinstance(error, MemoryError):
        found = "a part of it would need more memory than is available"
    is_lost = found.startswith(ENDLESS_ROS1)
    if is_lost or found.startswith(ENDLESS):
        found += " (its recorder did not finish, or its end was cut off)"
    if is_lost:
        found += "; `rosbag reindex` repairs it"
    text = f"{printable(path)} is broken{', ' * bool(where)}{where}: {printable(found or repr(error))}"
    return BagError(text, readable_in_part=not is_lost)


def listed(names: Iterable[str]) -> str:
    """List names in one line, each once; ``none`` if there are none."""
    return ", ".join(printable(name) for name in sorted(set(names))) or "none"


@contextmanager
def needing(library: str, extra: str) -> Iterator[None]:
    """In a ``with`` statement around an import: if the library is missing, raise what to install."""
    try:
        yield
    except ModuleNotFoundError as missing:
        if (missing.name or "").partition(".")[0] != library:
            raise
        text = f"{library} is not installed: pip install 'tf2-ros-cython[{extra}]'"
        raise ModuleNotFoundError(text, name=library) from missing


# How a file begins, by its extension.
MAGICS = {".mcap": b"\x89MCAP0\r\n", ".db3": b"SQLite format 3\0", ".bag": b"#ROSBAG V"}
PACKED = ".zstd"  # what rosbag2 adds to the name of a file that it compresses
PACKED_MAGIC = b"\x28\xb5\x2f\xfd"
SUFFIXES = (*MAGICS, *(f"{suffix}{PACKED}" for suffix in MAGICS))
# Files with these extensions are recordings or parts of them.
ADVICE = {
    ".yaml": "pass the path of its folder",
    ".active": "its recorder did not finish: `rosbag reindex` repairs it",
}
# The types of topics with transforms; ROS 1 has two names for the same message.
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
HEADER = "std_msgs/msg/Header"


@dataclass(frozen=True)
class Topic:
    """
    A recorded topic.

    ``count`` is the number of its messages. ``encoding`` is how they are serialised: ``cdr``, ``ros1``,
    ``protobuf``, ``json`` or something else.
    """

    name: str
    msgtype: str
    count: int
    encoding: str = "cdr"


class Recorded:
    """
    An open recording.

    ``path`` is its path, ``topics`` maps the names to a :class:`Topic` each, ``start_ns`` and ``end_ns`` are
    the log times of its first and last message of any topic; None if it has no messages. ``saved``: a buffer
    has saved it, so its log times are stamps.
    """

    def __init__(
        self, path: str, readers: list[Reader], partial: bool, problems: list[str], saved: bool
    ) -> None:
        self.path = path
        self.saved = saved
        self._partial = partial
        self._problems = problems
        # By topic: the first message that cannot be read, and how many there are.
        self._unreadable: dict[str, str] = {}
        self._counts: Counter[str] = Counter()
        self._readers = readers
        counts = sum(map(_counts, readers), Counter())
        found: dict[str, list[Connection]] = {}
        for one in chain.from_iterable(reader.connections for reader in readers):
            found.setdefault(one.topic, []).append(one)
        self.topics = {
            name: Topic(
                name, " and ".join({one.msgtype: None for one in ours}), counts[name], _encoding(ours[0])
            )
            for name, ours in found.items()
        }
        filled = [reader for reader in readers if reader.message_count]
        self.start_ns: int | None = min((reader.start_time for reader in filled), default=None)
        self.end_ns: int | None = max((reader.end_time - 1 for reader in filled), default=None)

    @property
    def problems(self) -> list[str]:
        """What could not be read until now, if the recording is read in part."""
        problems = self._problems.copy()
        for topic, text in self._unreadable.items():
            more = self._counts[topic] - 1
            problems.append(f"{text}, and {counted(more, 'later message')}" if more else text)
        return problems

    def broken(self, error: Exception, path: str, where: str) -> Exception | None:
        """
        Note that reading ended with an error.

        :return: what to raise instead; None if the recording is read in part.
        """
        told = explained(error, path, where)
        if not self._partial or not isinstance(told, BagError):
            return told
        self._problems.append(told.found)
        return None

    def unreadable(self, topic: str, log_ns: int, error: ValueError) -> None:
        """
        Note that one message cannot be read.

        :raises BagError: unless the recording is read in part.
        """
        text = f"{printable(self.path)}, topic {printable(topic)}, log time {log_ns} ns: {error}"
        if not self._partial:
            raise BagError(text) from error
        self._unreadable.setdefault(topic, text)
        self._counts[topic] += 1

    def connections(self, topic: str) -> "list[Connection]":
        """Get rosbags' connections of a topic, which may have several."""
        return [one for reader in self._readers for one in reader.connections if one.topic == topic]

    def messages(
        self,
        names: Iterable[str],
        start_ns: int | None = None,
        end_ns: int | None = None,
        *,
        convert: bool = True,
    ) -> "Iterator[Messages]":
        """
        Yield the messages of some topics, file by file.

        :param names: of the topics; topics that the recording does not have are ignored.
        :param start_ns: the log time of the first one; None: from the beginning.
        :param end_ns: the log time of the last one; None: to the end.
        :param convert: whether messages of ROS 1 are converted to CDR.
        """
        wanted = set(names)
        stop = None if end_ns is None or end_ns >= LAST_NS else end_ns + 1
        for reader in self._readers:
            connections = [one for one in reader.connections if one.topic in wanted]
            if connections:
                messages = reader.messages(connections, start_ns, stop)
                if convert and any(self.topics[one.topic].encoding != "cdr" for one in connections):
                    messages = _converted(messages)
                counts = _counts(reader)
                least = sum(counts[name] for name in wanted) if start_ns is None and end_ns is None else 0
                # The path of a single file may lead to an unpacked copy.
                path = self.path if os.path.isfile(self.path) else str(reader.path)
                yield Messages(self, path, {one.topic for one in connections}, messages, least)


class Messages:
    """
    Messages of one file, in the order of log times if it has an index.

    ``raw`` iterates over ``(connection, log time in ns, message in CDR)``; ``connection.topic`` is the name
    of the topic. ``least`` is the least number of messages. Iterating over this object explains errors of
    ``raw``.
    """

    def __init__(
        self, recorded: Recorded, path: str, topics: Iterable[str], raw: Iterator[RawMessage], least: int
    ) -> None:
        self._recorded = recorded
        self._path = path
        self._topics = f"topic {listed(topics)}"
        self.raw = raw
        self.least = min(least, LAST_NS)  # a damaged index may contain any number

    def explain(self, error: Exception, last_ns: int | None) -> Exception | None:
        """
        Get what to raise instead of an error of ``raw``; None if the recording is read in part.

        :param last_ns: the log time of the last message before, or None.
        """
        after = ", at the beginning" if last_ns is None else f", after log time {last_ns} ns"
        return self._recorded.broken(error, self._path, self._topics + after)

    def __iter__(self) -> Iterator[RawMessage]:
        last_ns, count = None, 0
        try:
            for message in self.raw:
                _check(message)
                yield message
                last_ns, count = message[1], count + 1
            if count < self.least:
                lost = counted(self.least - count, "message")
                raise ValueError(f"{lost} of its index cannot be found in it")
        except Exception as error:
            told = self.explain(error, last_ns)
            if told is error:
                raise
            if told is not None:
                raise told from error


def _check(message: RawMessage) -> None:
    # A database may contain values of any type, and a damaged file any number.
    _, log_ns, data = message
    if not -LAST_NS <= log_ns <= LAST_NS:
        raise ValueError(f"a log time of {log_ns} ns does not fit into 64 bits")
    if not isinstance(data, bytes | memoryview | bytearray):
        raise ValueError(f"a message must be bytes, not {type(data).__name__}")


def _counts(reader: Reader) -> Counter[str]:
    # Count the messages of each topic from the files themselves: metadata.yaml may count messages that were
    # never written, and if the index of a ROS 1 file is damaged, its list of chunks is more complete.
    if hasattr(reader, "chunk_infos"):
        return Counter({name: one.msgcount for name, one in reader.topics.items()})
    counts: Counter[str] = Counter()
    for source in _storages(reader) or [reader]:
        for one in source.connections:
            counts[one.topic] += one.msgcount
    return counts


def is_static(topic: str) -> bool:
    """Whether the transforms of a topic are static: whether its last component is ``tf_static``."""
    return topic.rpartition("/")[2] == "tf_static"


@contextmanager
def open_recording(path: "str | PathLike[str]", *, partial: bool = False) -> Iterator[Recorded]:
    """
    Open a recording of any format.

    :param path: a rosbag2 folder, or a file that ends in ``.mcap``, ``.db3`` or ``.bag`` (ROS 1), or in one
        of these and ``.zstd``.
    :param partial: read what can be read of a broken recording, and list the rest in ``problems``.
    :raises FileNotFoundError: the file does not exist.
    :raises BagError: the file is not a recording, or is broken.
    :raises ModuleNotFoundError: rosbags is not installed.
    """
    text = os.fspath(path)
    if not isinstance(text, str):
        raise TypeError(f"path must be a str or os.PathLike of str, not {type(path).__name__}")
    with needing("rosbags", "bag"):
        import rosbags  # noqa: F401
    if not os.path.exists(text):
        raise FileNotFoundError(errno.ENOENT, "the recording does not exist", text)
    with ExitStack() as stack:
        source = Path(text)
        problems: list[str] = []
        if source.suffix == PACKED:
            source = stack.enter_context(_unpacked(source, problems))
        try:
            if problems:
                raise BagError(problems[0], readable_in_part=True)
            readers = [stack.enter_context(_opened(source, text))]
        except BagError as error:
            if not partial:
                raise
            readers = _rescued(source, text, stack, problems)
            if not readers:
                lost = ", and nothing before that can be read" if error.readable_in_part else ""
                raise BagError(f"{error.found}{lost}") from error
            problems = list(dict.fromkeys([error.found, *problems]))
        files = _files(source)
        yield Recorded(text, readers, partial, problems, bool(files) and all(map(_is_saved, files)))


@contextmanager
def _unpacked(path: Path, problems: list[str]) -> Iterator[Path]:
    """
    Decompress a file, as far as it can be read, into a copy that exists during a ``with`` statement.

    :param problems: a list to which the reason is added if a part cannot be read.
    """
    _check_file(path, str(path))
    with needing("zstandard", "bag"):
        from zstandard import ZstdDecompressor

    with TemporaryDirectory(prefix="tf2-ros-cython-") as folder:
        copy = Path(folder, path.stem)
        with open(path, "rb") as packed, open(copy, "wb") as file:
            try:
                shutil.copyfileobj(ZstdDecompressor().stream_reader(packed, read_across_frames=True), file)
            except Exception as error:
                told = explained(error, str(path))
                if not isinstance(told, BagError):
                    raise
                problems.append(told.found)
        yield copy


@contextmanager
def _opened(path: Path, name: str | None = None) -> Iterator[Reader]:
    """
    Open one reader of rosbags.

    :param name: the name for errors, if it is not the path.
    :raises BagError: rosbags cannot read it.
    """
    from rosbags import rosbag1, rosbag2

    name = str(path) if name is None else name
    with ExitStack() as stack:
        try:
            if path.is_dir():
                _check_folder(path)
                reader: Reader = rosbag2.Reader(path)
            else:
                _check_file(path, name)
                reader = rosbag1.Reader(path) if path.suffix == ".bag" else rosbag2.Reader(path)
            try:
                stack.enter_context(reader)
            except (KeyError, rosbag2.ReaderError) as error:
                if path.suffix != ".mcap" or not _is_foreign(error):
                    raise
                reader = McapScan(path)
                if reader.broken is not None:
                    raise reader.broken if str(reader.broken) else ValueError(ENDLESS) from None
            _check_merged(reader)
            _check_times(reader, name)
        except Exception as error:
            told = _broken_file(path) or explained(error, name)
            if told is error:
                raise
            raise told from error
        _allow_any_order(reader)
        yield reader


def _is_foreign(error: Exception) -> bool:
    # rosbags refuses an .mcap whose profile, or one of whose schemas, is not of ROS 2.
    return isinstance(error, KeyError) or str(error).startswith("Profile is not")


def _check_folder(path: Path) -> None:
    for one in path.iterdir():
        if one.name == "metadata.yaml" or one.suffix in MAGICS:
            _refuse_special(one)
    if (path / "metadata.yaml").exists():
        return
    name = printable(str(path))
    inner = [one.parent.name for one in sorted(path.glob("*/metadata.yaml"))]
    files = sorted(one.name for one in path.iterdir() if one.suffix in MAGICS)
    parts = [one for one in files if not one.endswith(".bag")]
    if inner or len(parts) < len(files):
        raise BagError(
            f"{name} is not a recording: the folder has no metadata.yaml;"
            f" {printable((inner or files)[0])} in it is a recording"
        )
    if parts:
        raise BagError(
            f"{name} has no metadata.yaml, but {', '.join(map(printable, parts))}: if they are one recording,"
            " its recorder did not finish, and `ros2 bag reindex` repairs it",
            readable_in_part=True,
        )
    raise BagError(f"{name} is not a recording: the folder has no metadata.yaml")


def _is_saved(path: Path) -> bool:
    with open(path, "rb") as file:
        return SAVED in file.read(256)


def _check_file(path: Path, name: str) -> None:
    name = printable(name)
    magic = PACKED_MAGIC if path.name.endswith(SUFFIXES[len(MAGICS) :]) else MAGICS.get(path.suffix)
    if magic is None:
        advice = ADVICE.get(path.suffix, f"use a folder with a metadata.yaml, or {', '.join(MAGICS)}")
        raise BagError(f"{name} is not a recording: {advice}")
    _refuse_special(path)
    with open(path, "rb") as file:
        begin = file.read(16)
    if not begin:
        raise BagError(f"{name} is empty")
    if not begin.startswith(magic):
        other = next((suffix for suffix, one in MAGICS.items() if begin.startswith(one)), None)
        found = f"it is a {other} file" if other else f"it begins with {begin!r}"
        raise BagError(f"{name} is not a {path.suffix} file: {found}")


def _refuse_special(path: Path) -> None:
    # Opening a pipe waits for its writer, and no format can be read strictly from its beginning to its end.
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise BagError(f"{printable(str(path))} is not a recording: it is a pipe or a device")


def _check_times(reader: Reader, path: str) -> None:
    # A damaged file may contain any time, and metadata.yaml may have been edited.
    for told in (reader.start_time, reader.end_time - 1) if reader.message_count else ():
        if not isinstance(told, int) or abs(told) > LAST_NS:
            raise BagError(f"{printable(path)} is broken: it contains the log time {told!r} ns")


def _check_merged(reader: Reader) -> None:
    # rosbags reads only the file of a database. Until it is merged, what was written last is in a second
    # file.
    for storage in _storages(reader):
        path = storage.path
        log = path.with_name(f"{path.name}-wal")
        if path.suffix == ".db3" and log.exists() and log.stat().st_size:
            advice = f'`sqlite3 {printable(path.name)} "pragma wal_checkpoint"` merges it'
            raise BagError(f"{printable(str(path))} lacks what is in {printable(log.name)}: {advice}")


def _storages(reader: Reader) -> list[Any]:
    # The reader of a folder has a storage for each file; readers of other formats have no storage.
    storage = getattr(reader, "storage", None)
    return [] if storage is None else list(getattr(storage, "storages", [storage]))


def _allow_any_order(reader: Reader) -> None:
    # rosbags refuses an .mcap without an index whose log times are not sorted. A buffer accepts any order,
    # and recorders do write such files.
    for storage in _storages(reader):
        if hasattr(storage, "messages_scan") and not storage.chunks:
            storage.messages = storage.messages_scan


def _broken_file(path: Path) -> BagError | None:
    # rosbags does not say which file of a folder it could not open.
    for one in _files(path) if path.is_dir() and (path / "metadata.yaml").exists() else ():
        try:
            with _opened(one):
                pass
        except BagError as error:
            return error
    return None


def _converted(messages: Iterator[RawMessage]) -> Iterator[RawMessage]:
    # From ROS 1 to CDR, with the types of ROS 2: the conversion removes the `seq` of a header.
    store = _typestore()
    for connection, log_ns, raw in messages:
        msgtype, encoding = connection.msgtype, _encoding(connection)
        if msgtype in foxglove.TYPES:
            raw = foxglove.tf_message(msgtype, encoding, raw)
        elif encoding == "ros1":
            raw = store.ros1_to_cdr(raw, TF_TYPES[0] if msgtype in TF_TYPES else msgtype)
        yield connection, log_ns, raw


def _encoding(connection: "Connection") -> str:
    return getattr(connection.ext, "serialization_format", "ros1")


def _typestore() -> "Typestore":
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.LATEST)


def stamps_of(recorded: Recorded, topic: str) -> NDArray[np.int64]:
    """
    Read the stamps of all messages of a topic whose messages begin with a ``std_msgs/Header``, or are those
    of Foxglove.

    :return: nanoseconds, in the order of the recording.
    :raises BagError: the topic does not exist, its messages begin with something else, or one cannot be read.
    """
    name = f"{printable(recorded.path)}, topic {printable(topic)}"
    if topic not in recorded.topics:
        raise BagError(f"{name}: this topic does not exist; the topics are {listed(recorded.topics)}")
    about = recorded.topics[topic]
    if not foxglove.is_stamped(about.msgtype, about.encoding):
        try:
            stamped = all(_begins_with_header(one) for one in recorded.connections(topic))
        except Exception as error:  # the parsers define error classes only for some kinds of damage
            where = f"topic {printable(topic)}, definition of its type"
            raise explained(error, recorded.path, where) from error
        if not stamped:
            raise BagError(f"{name}: {printable(about.msgtype)} does not begin with a {HEADER}")
    stamps: list[int] = []
    for _, log_ns, raw in chain.from_iterable(recorded.messages([topic], convert=False)):
        try:
            stamps.append(_stamp_ns(about, raw))
        except ValueError as error:
            recorded.unreadable(topic, log_ns, error)
    return np.array(stamps, np.int64)


def _stamp_ns(about: Topic, raw: serialised.Raw) -> int:
    if foxglove.is_stamped(about.msgtype, about.encoding):
        return foxglove.stamp_ns(about.encoding, raw)
    # It begins behind four bytes: the encoding, in ROS 1 the `seq` of the header.
    reader = serialised.Reader(raw)
    if about.encoding == "ros1":
        reader.order = "<"
    return reader.stamp_ns()


def _begins_with_header(connection: "Connection") -> bool:
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    msgtype, (form, text) = connection.msgtype, connection.msgdef
    if form == MessageDefinitionFormat.MSG:
        types = get_types_from_msg(text, msgtype)
    elif form == MessageDefinitionFormat.IDL:
        # One definition, or several, each after a line that names it.
        types = {}
        for part in text.split("=" * 80 + "\n"):
            types.update(get_types_from_idl(re.sub(r"^IDL: .*\n", "", part)) if part.strip() else {})
    else:
        types = _typestore().fielddefs
    _, fields = types.get(msgtype, ([], []))
    return msgtype == HEADER or (bool(fields) and fields[0][1][1] == HEADER)


# Broken recordings.


def _rescued(path: Path, name: str, stack: ExitStack, problems: list[str]) -> list[Reader]:
    """
    Open readers of what can be read of a broken recording.

    :param name: the name of a file, for errors.
    :param stack: closes the readers.
    :param problems: a list to which is added what cannot be read.
    """
    readers: list[Reader] = []
    for file in _files(path):
        try:
            readers.append(stack.enter_context(_opened(file, None if path.is_dir() else name)))
        except BagError as error:
            problems.append(error.found)
            if file.suffix == ".mcap" and (scan := McapScan(file)).message_count:
                readers.append(scan)
    return readers


def _files(path: Path) -> list[Path]:
    # In the order in which a recorder splits a recording: the names end in numbers. Opening a pipe would
    # wait.
    if not path.is_dir():
        return [path] if path.is_file() else []
    files = [one for one in path.iterdir() if one.suffix in (".mcap", ".db3") and one.is_file()]
    return sorted(files, key=lambda one: [int(part) for part in re.findall(r"\d+", one.name)])


class McapScan:
    """
    Reads an .mcap from its beginning to its end, or to the break that a power cut leaves.

    It has the part of the interface of rosbags' readers that is used here. Everything is read twice, the
    first time for counting. ``broken`` is the error of the break, or None.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.broken: Exception | None = None
        self._known: dict[int, Connection] = {}
        counts: Counter[int] = Counter()
        self.start_time, self.end_time = LAST_NS, 0
        for number, log_ns, _ in self._read():
            counts[number] += 1
            self.start_time = min(self.start_time, log_ns)
            self.end_time = max(self.end_time, log_ns + 1)
        self.connections = [one._replace(msgcount=counts[one.id]) for one in self._known.values()]
        self.message_count = counts.total()

    def messages(
        self, connections: "Collection[Connection]", start: int | None, stop: int | None
    ) -> Iterator[RawMessage]:
        """Yield messages as rosbags' readers do, in the order of the file."""
        wanted = {one.id: one for one in connections}
        for number, log_ns, data in self._read():
            if number in wanted and (start is None or start <= log_ns) and (stop is None or log_ns < stop):
                yield wanted[number], log_ns, data

    def _read(self) -> Iterator[tuple[int, int, bytes]]:
        """Yield the connection's number, log time and data of each message; add connections to ``_known``."""
        with needing("mcap", "bag"):
            from mcap.records import Channel, Message, Schema
            from mcap.stream_reader import StreamReader

        schemas: dict[int, Schema] = {}
        with open(self.path, "rb") as file:
            try:
                for record in StreamReader(file, validate_crcs=True).records:
                    if isinstance(record, Message):
                        if record.log_time > LAST_NS:
                            raise ValueError(f"it contains the log time {record.log_time} ns")
                        yield record.channel_id, record.log_time, record.data
                    elif isinstance(record, Schema):
                        schemas[record.id] = record
                    elif isinstance(record, Channel) and record.id not in self._known:
                        self._known[record.id] = self._connection(record, schemas.get(record.schema_id))
            except Exception as error:
                if not isinstance(explained(error, str(self.path)), BagError):
                    raise
                self.broken = error

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
