# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read recordings of all formats as raw messages in CDR, with rosbags, and explain its errors."""

import errno
import os
import re
import shutil
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from struct import Struct
from tempfile import TemporaryDirectory, gettempdir
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias, TypeVar

import numpy as np

from tf2_py.printable import counted, printable
from tf2_py.typing import TimeLike
from tf2_ros.numpy import to_nanoseconds
from tf2_ros_tools.common.bools import bool_of
from tf2_ros_tools.common.optional_libraries import require
from tf2_ros_tools.recordings import foxglove_messages

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.typesys.store import Typestore

Raw: TypeAlias = "bytes | memoryview"
RawMessage: TypeAlias = "tuple[Connection, int, Raw]"
# A reader of rosbags, or a Folder or ForeignMcap, which have this part of its interface: `connections`,
# `start_time`, `end_time` (after the last message), `message_count`, and `messages(connections, start,
# stop)`.
Reader: TypeAlias = Any
_Made = TypeVar("_Made")

S = 1_000_000_000
LAST_NS = (1 << 63) - 1  # log times are int64
# What repairs a file, by its extension.
TOOLS = {".mcap": "`mcap recover`", ".db3": "`sqlite3 FILE .recover`", ".bag": "`rosbag reindex`"}
REINDEX = "`ros2 bag reindex`"  # likewise a folder
STORAGES = {".mcap": "mcap", ".db3": "sqlite3"}  # the names of rosbag2, by the extension
PACKED = ".zstd"  # what rosbag2 adds to the name of a compressed file
ZSTD = b"\x28\xb5\x2f\xfd"
# What files begin with, by the extension.
MAGICS = {".mcap": b"\x89MCAP0\r\n", ".db3": b"SQLite format 3\0", ".bag": b"#ROSBAG V", PACKED: ZSTD}
# The size of a page, how often the file was changed, the number of its pages, and as of which change that is.
SQLITE_HEADER = Struct(">16xH6xII60xI4x")
UNFINISHED = ".bag.active"  # what rosbag of ROS 1 renames when it ends
SUFFIXES = (*TOOLS, *(f"{suffix}{PACKED}" for suffix in TOOLS))
FROZEN = ".tf2"  # the extension of frozen buffers
FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)  # what a disk without space answers
LFS_POINTER = b"version https://git-lfs.github.com/spec/"  # what a file begins with
# Files beside a database that is not merged, which rosbags does not read, and how they then begin: one has
# what was written last, the other what an interrupted change has replaced.
LOGS = {"-wal": b"", "-journal": b"\xd9\xd5\x05\xf9\x20\xa1\x63\xd7"}
# The types of topics with transforms; ROS 1 has two names for the same message.
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")


class BagError(ValueError):
    """A recording cannot be read; the text contains the file, the fault, and the tool that may repair it."""


def explained(error: Exception, path: str, where: str = "", tool: str = "") -> Exception:
    """
    Get the BagError for an error that a file's bytes caused, or the error itself if it has another cause.

    The libraries define error classes only for some kinds of damage.

    :param where: in the file.
    :param tool: repairs it; by default that for files with its extension, or for folders.
    """
    if isinstance(error, (BagError, ImportError)):
        return error
    # About bad data, bz2 raises an OSError without a number; a damaged length leads to an invalid position.
    if isinstance(error, OSError) and error.errno not in (None, errno.EINVAL):
        return error
    found = str(error).rstrip(".") or repr(error)
    if found.startswith("File end magic is invalid"):
        found += " (its recorder did not finish, or its end was cut off)"
    place = f", {where}" if where else ""
    tool = tool or _tool_of(Path(path))
    return BagError(f"{printable(path)} is broken{place}: {printable(found)}; {tool} may repair it")


def _tool_of(file: Path) -> str:
    # A folder may be named like a file.
    return REINDEX if file.is_dir() else TOOLS.get(Path(file.name.removesuffix(PACKED)).suffix, REINDEX)


def listed(names: Iterable[str]) -> str:
    """List names in one line, each once; ``none`` if there are none."""
    return ", ".join(printable(name) for name in sorted(set(names))) or "none"


@dataclass(frozen=True)
class RecordedTopic:
    """
    A recorded topic.

    ``count`` is the number of its messages. ``encoding`` is how they are serialized: ``cdr``, ``ros1``,
    ``protobuf`` or something else.
    """

    name: str
    msgtype: str
    count: int
    encoding: str = "cdr"


class Recorded:
    """
    An open recording.

    ``path`` is its path, ``topics`` maps the names to a :class:`RecordedTopic` each, ``start_ns`` and
    ``end_ns`` are the log times of its first and last message of any topic; None if it has no messages.
    """

    def __init__(self, path: str, reader: Reader, parts: list[Path]) -> None:
        self.path = path
        self._reader = reader
        self._tool = _tool_of(parts[0]) if parts else REINDEX
        for one in reader.connections:
            for text in (one.topic, one.msgtype, encoding_of(one)):
                if not isinstance(text, str):  # SQLite and YAML accept any type
                    raise ValueError(
                        f"the name, type or encoding of a topic is {text!r}, which is not a text"
                    )
        self.topics: dict[str, RecordedTopic] = {}
        for name in dict.fromkeys(one.topic for one in reader.connections):
            own = self.connections([name])
            types = " and ".join(dict.fromkeys(full_name(one.msgtype) for one in own))
            self.topics[name] = RecordedTopic(
                name, types, sum(one.msgcount for one in own), encoding_of(own[0])
            )
        # Where its messages are now, decompressed, in their order.
        self.files: list[Path] = getattr(reader, "files", None) or [Path(parts[0])]
        # A damaged file may contain any time.
        self.start_ns: int | None = int(np.int64(reader.start_time)) if reader.message_count else None
        self.end_ns: int | None = int(np.int64(reader.end_time - 1)) if reader.message_count else None

    @property
    def is_mcap(self) -> bool:
        return all(one.suffix == ".mcap" for one in self.files)

    def shortfalls(self, names: Iterable[str]) -> Iterator[str]:
        """Say of which topics the files of a folder have fewer messages than its metadata.yaml counts."""
        for name in names:
            expected = self._reader.expected.get(name, 0) if isinstance(self._reader, Folder) else 0
            if self.topics[name].count < expected:
                yield (
                    f"metadata.yaml counts {counted(expected, 'message')} on {printable(name)}, but the files"
                    f" have {self.topics[name].count}: some are lost, or {REINDEX} corrects it"
                )

    def require_encoding(self, topic: str) -> None:
        """
        Check that the messages of a topic are serialized in a way that can be read.

        :raises BagError: they are not.
        """
        one, wanted = self.topics[topic], ["cdr", "ros1"]
        if foxglove_messages.is_stamped(one.msgtype):
            wanted = [foxglove_messages.PROTOBUF]
        if one.encoding not in wanted:
            where = f"{printable(self.path)}, topic {printable(topic)}"
            writes = ", in which Foxglove's SDK writes this type" if len(wanted) == 1 else ""
            got = f"got {printable(one.encoding)}"
            raise BagError(f"{where}: expected the encoding {' or '.join(wanted)}{writes}, {got}")

    def connections(self, topics: Collection[str]) -> "list[Connection]":
        """Get rosbags' connections of some topics, which may have several each."""
        return [one for one in self._reader.connections if one.topic in topics]

    def raw(
        self,
        names: Collection[str],
        start_ns: int | None = None,
        end_ns: int | None = None,
        *,
        convert: bool = True,
    ) -> Iterator[RawMessage]:
        """
        Get the messages of some topics, in the order of log times if the recording has an index.

        :param names: of the topics; topics that the recording does not have are ignored.
        :param start_ns: the log time of the first one; None: from the beginning.
        :param end_ns: the log time of the last one; None: to the end.
        :param convert: whether messages of ROS 1 and of Foxglove are converted to CDR.

        For errors of the iteration, raise what :meth:`explain` returns. Without times, one of them is that a
        topic has fewer messages than the recording counts.
        """
        converts = bool_of(convert, "convert")
        connections = self.connections(names)
        if not connections:
            return iter(())
        stop = None if end_ns is None or end_ns >= LAST_NS else end_ns + 1
        messages: Iterator[RawMessage] = self._reader.messages(connections, start_ns, stop)
        if start_ns is None and stop is None:
            messages = self._complete(messages, connections)
        is_foreign = any(encoding_of(one) != "cdr" for one in connections)  # those of a topic may differ
        if is_foreign:
            return self._converted(messages) if converts else messages
        return _decompressed(messages)

    def last(self, topic: str) -> tuple[int, Raw] | None:
        """Get the log time and the content of the last message of a topic, in CDR; None: it has none."""
        if self.start_ns is None or self.end_ns is None:
            return None
        # From the end, because a message that grows, such as a path, is not to be read each time it was sent.
        found, length = None, S
        while found is None and length < 8 * (self.end_ns - self.start_ns + S):
            for _, log_ns, raw in self.checked(self.raw([topic], max(self.end_ns - length, 0))):
                found = log_ns, raw
            length *= 8
        return found

    def _complete(
        self, messages: Iterator[RawMessage], connections: "list[Connection]"
    ) -> Iterator[RawMessage]:
        # The libraries skip what they do not recognize as a message or as the index of a chunk.
        read = Counter[str]()
        for message in messages:
            read[message[0].topic] += 1
            yield message
        for name in dict.fromkeys(one.topic for one in connections):
            if read[name] < (count := self.topics[name].count):
                lost = ValueError(
                    f"its index counts {counted(count, 'message')}, but {read[name]} can be read"
                )
                raise explained(lost, self.path, f"topic {printable(name)}", self._tool)

    def _converted(self, messages: Iterator[RawMessage]) -> Iterator[RawMessage]:
        # From ROS 1 to CDR, with the types of ROS 2: the conversion removes the `seq` of a header.
        store = typestore()
        for connection, log_ns, raw in messages:
            msgtype, encoding = connection.msgtype, encoding_of(connection)
            if msgtype in foxglove_messages.TYPES:
                raw = self.of_foxglove(connection, log_ns, raw, foxglove_messages.tf_message)
            elif encoding == "ros1":
                raw = store.ros1_to_cdr(raw, TF_TYPES[0] if msgtype in TF_TYPES else msgtype)
            yield connection, log_ns, raw

    def of_foxglove(
        self, connection: "Connection", log_ns: int, raw: Raw, make: Callable[[Any], _Made]
    ) -> _Made:
        """Decode a message of Foxglove, and make something of it."""
        try:
            return make(self._reader.decoder(connection)(bytes(raw)))
        except ModuleNotFoundError:
            raise
        except Exception as error:  # a damaged message, or a damaged definition of its type, raises any kind
            self.malformed(connection.topic, log_ns, ValueError(f"not a {connection.msgtype}: {error}"))

    def checked(self, messages: Iterable[RawMessage]) -> Iterator[RawMessage]:
        """Yield messages of :meth:`raw`, and explain errors of the iteration."""
        last_ns = None
        try:
            for connection, log_ns, raw in messages:
                yield connection, log_ns, raw
                last_ns = log_ns
        except Exception as error:
            reason = self.explain(error, last_ns)
            if reason is error:
                raise
            raise reason from error

    def explain(self, error: Exception, last_ns: int | None) -> Exception:
        """
        Get what to raise instead of an error of the iteration over messages.

        :param last_ns: the log time of the last message before, or None.
        """
        where = "at the beginning" if last_ns is None else f"after log time {last_ns} ns"
        return explained(error, self.path, where, self._tool)

    def malformed(self, topic: str, log_ns: int, error: Exception) -> NoReturn:
        """Raise the BagError for one message that cannot be read."""
        place = f"{printable(self.path)}, topic {printable(topic)}, log time {log_ns} ns"
        raise BagError(f"{place}: {printable(str(error))}") from error


def full_name(msgtype: str) -> str:
    """Get the name of a type as ROS 2 writes it, from that of ROS 1, which some recorders write, too."""
    return msgtype.replace("/", "/msg/") if msgtype.count("/") == 1 else msgtype


def _decompressed(messages: Iterable[RawMessage]) -> Iterator[RawMessage]:
    # That each message is compressed is only in the metadata.yaml of a folder, which a file alone lacks. No
    # message in CDR begins like this.
    for connection, log_ns, raw in messages:
        if isinstance(raw, str) or not isinstance(log_ns, int):  # SQLite accepts any type
            raise ValueError(f"the log time of a message is {log_ns!r}, and its data is {type(raw).__name__}")
        yield connection, log_ns, decompressed(raw)


def decompressed(raw: Raw) -> Raw:
    """Decompress a message that was compressed by itself."""
    if raw[:4] != ZSTD:
        return raw
    require("zstandard", "bag")
    from zstandard import ZstdDecompressor

    return ZstdDecompressor().decompressobj().decompress(raw)


def is_static(topic: str) -> bool:
    """Whether the transforms of a topic are static: whether its last component is ``tf_static``."""
    return topic.rpartition("/")[2] == "tf_static"


def as_time_ns(name: str, time: TimeLike) -> int:
    """
    Convert a time that a user has passed as an argument.

    :raises TypeError, ValueError: it is not a time, or it is NaT or too large.
    """
    try:
        return int(to_nanoseconds([time])[0])
    except (ValueError, OverflowError):
        raise ValueError(f"{name}: expected a time that 64-bit nanoseconds can hold, got {time!r}") from None
    except TypeError:
        accepted = "nanoseconds as an int, a datetime64, or an object with sec and nanosec"
        advice = "; round(seconds * 1e9) converts seconds" if isinstance(time, float) else ""
        raise TypeError(f"{name}: expected {accepted}, got {time!r}{advice}") from None


def require_existing(path: Path) -> None:
    """
    Check that a recording exists.

    :raises FileNotFoundError: it does not.
    """
    if not path.exists():
        raise FileNotFoundError(errno.ENOENT, "the recording does not exist", str(path))


@contextmanager
def open_recording(path: "str | PathLike[str]") -> Iterator[Recorded]:
    """
    Open a recording of any format.

    :param path: a rosbag2 folder, or a file that ends in ``.mcap``, ``.db3`` or ``.bag`` (ROS 1), or in one
        of these and ``.zstd``.
    :raises FileNotFoundError: the file does not exist.
    :raises BagError: the file is not a recording, or is broken.
    :raises ModuleNotFoundError: rosbags is not installed.
    """
    require("rosbags", "bag")
    source = Path(path)
    name = str(path)
    require_existing(source)
    inside = sorted(source.iterdir()) if source.is_dir() else []
    parts = [one for one in inside if one.name.endswith(SUFFIXES) and one.is_file()]
    _refuse_others(source, parts)
    with ExitStack() as stack:
        try:
            is_packed = source.suffix == PACKED and source.is_file()
            opened = stack.enter_context(_unpacked(source)) if is_packed else source
            if is_packed:
                _refuse_content(opened, name)
            reader = _opened(opened, stack)
            recorded = Recorded(name, reader, parts if source.is_dir() else [opened])
        except Exception as error:
            if isinstance(error, OSError) and error.errno in FULL and error.filename is None:
                # Only decompressed copies are written.
                raise OSError(error.errno, error.strerror, gettempdir()) from None
            # rosbags does not say which file of a folder it could not open.
            for part in parts:
                with open_recording(part):
                    pass
            reason = explained(_in_detail(error, source, parts), name)
            if reason is error:
                raise
            raise reason from error
        yield recorded


def _in_detail(error: Exception, folder: Path, parts: Collection[Path]) -> Exception:
    """Add to an error of rosbags about a folder, whose files can be opened, which files there are."""
    if not parts:
        return error
    try:
        metadata = (folder / "metadata.yaml").read_text("utf-8")
    except UnicodeDecodeError:
        return ValueError("its metadata.yaml is not in UTF-8")
    foreign = str(error).startswith(("Serialization format", "Profile is not"))
    if isinstance(error, KeyError | UnicodeDecodeError) or foreign:
        files = listed(one.name for one in parts)
        why = "a topic is not in CDR, or the definition of a type is not in UTF-8"
        advice = f"which rosbags does not read in a folder; load its files one by one: {files}"
        return BagError(f"{printable(str(folder))}: {why}, {advice}")
    text, file = str(error), next(iter(parts))
    storage = STORAGES.get(Path(file.name.removesuffix(PACKED)).suffix)
    found = re.search(r"storage_identifier: *['\"]?(\w*)", metadata)
    is_described = "relative_file_paths" in metadata
    if is_described and storage is not None and (found is None or found[1] != storage):
        # This is how a reindex of Humble leaves it, so another one would not help.
        wanted = f"storage_identifier in metadata.yaml must be {storage}, as of {printable(file.name)}"
        return BagError(f"{printable(str(folder))} is broken: {wanted}")
    if text.startswith("Some database files are missing"):
        others = [one.name for one in parts if one.name not in metadata]
        return ValueError(f"{text.rstrip('.')}; it has {listed(others)} instead") if others else error
    return error


def _refuse_others(path: Path, parts: Collection[Path]) -> None:
    """Refuse what is not a recording, and a recording of which rosbags would not read everything."""
    name = printable(str(path))
    if path.is_dir():
        if not (path / "metadata.yaml").is_file():
            advice = f"{REINDEX} makes it from the files of a recording"
            raise BagError(f"{name} is not a recording: the folder has no metadata.yaml; {advice}")
    elif not path.name.endswith(SUFFIXES):
        *others, last = TOOLS
        pending = f"{', '.join(others)} or {last}"
        advice = f"expected a folder with a metadata.yaml, or a file that ends in {pending}"
        if path.suffix == FROZEN:
            advice = "it is a frozen buffer, which `tf2_ros.Buffer.open` reads"
        if path.name.endswith(UNFINISHED):
            advice = f"{TOOLS['.bag']} repairs it; then remove .active from its name"
            raise BagError(f"{name} was not closed by its recorder: {advice}")
        raise BagError(f"{name} is not a recording: {advice}")
    elif not path.is_file():
        raise BagError(f"{name} is a pipe or a device: expected a file, which can be read twice")
    elif not path.stat().st_size:
        raise BagError(f"{name} is empty")
    for part in [path / "metadata.yaml", *parts] if path.is_dir() else [path]:
        if part.is_file():
            _refuse_content(part, str(part))
        for log in logs_of(part):
            advice = f'`sqlite3 {printable(part.name)} "pragma wal_checkpoint"` merges it'
            raise BagError(f"{printable(str(part))} is incomplete without {printable(log.name)}: {advice}")


def resolved(path: "str | PathLike[str]") -> str:
    """Get the path of a recording without links, or the path itself if only a link has the extension."""
    real = os.path.realpath(path)
    return real if os.path.isdir(real) or real.endswith(SUFFIXES) else os.path.abspath(path)


def logs_of(database: Path) -> Iterator[Path]:
    """Get the logs of a database that are not merged. SQLite keeps them beside the target of a link."""
    for place in dict.fromkeys((database, database.resolve())):
        for ending, begin in LOGS.items():
            log = place.with_name(f"{place.name}{ending}")
            with suppress(FileNotFoundError):  # an empty one comes and goes whenever a database is opened
                # A name that is too long names no file.
                if os.path.isfile(log) and log.stat().st_size and _begins_with(log, begin):
                    yield log


def _refuse_content(path: Path, name: str) -> None:
    """Refuse a file that has the name of a recording, but another content, and a database without its end."""
    with open(path, "rb") as file:
        begin = file.read(SQLITE_HEADER.size)
    if begin.startswith(LFS_POINTER):
        advice = "`git lfs pull` downloads the recording"
        raise BagError(f"{printable(name)} is a pointer of Git LFS, not the recording: {advice}")
    magic = MAGICS.get(path.suffix, b"")
    if begin.startswith(magic) or magic.startswith(begin):  # what was cut off is another fault
        if path.suffix == ".db3" and len(begin) == SQLITE_HEADER.size:
            _refuse_cut_database(begin, path.stat().st_size, name)
        return
    text = f"{printable(name)} is not a recording: it does not begin as {path.suffix} files do"
    others = [suffix for suffix, magic in MAGICS.items() if begin.startswith(magic)]
    raise BagError(f"{text}, but as {others[0]} files do: rename it" if others else text)


def _refuse_cut_database(header: bytes, size: int, name: str) -> None:
    """Refuse a database that is shorter than its header says: SQLite reads zeros after its end."""
    page_size, changes, pages, counted_at = SQLITE_HEADER.unpack(header)
    whole = pages * (page_size if page_size > 1 else 1 << 16)
    if changes == counted_at and size < whole:  # otherwise the number of pages is not valid
        raise explained(ValueError(f"it has {size:,} of {whole:,} bytes"), name)


def _begins_with(path: Path, begin: bytes) -> bool:
    with open(path, "rb") as file:
        return file.read(len(begin)) == begin


@contextmanager
def _unpacked(path: Path) -> Iterator[Path]:
    """Decompress a file into a copy that exists during a ``with`` statement."""
    require("zstandard", "bag")
    from zstandard import ZstdDecompressor

    with TemporaryDirectory(prefix="tf2-ros-cython-") as folder:
        copy = Path(folder, path.stem)
        with open(path, "rb") as packed, open(copy, "wb") as file:
            shutil.copyfileobj(ZstdDecompressor().stream_reader(packed, read_across_frames=True), file)
        yield copy


def _opened(path: Path, stack: ExitStack) -> Reader:
    from rosbags import rosbag1, rosbag2

    is_of_ros_1 = path.suffix == ".bag" and path.is_file()
    reader: Reader = rosbag1.Reader(path) if is_of_ros_1 else rosbag2.Reader(path)
    try:
        stack.enter_context(reader)
        if is_of_ros_1:
            return reader
        files = reader.storage.storages if path.is_dir() else [reader.storage]
        for i, file in enumerate(files):
            # rosbags skips chunks without message indexes.
            if not all(one.message_index_offsets for one in getattr(file, "chunks", ())):
                files[i] = ForeignMcap(Path(file.path), stack)
            _refuse_strays(files[i])
        if path.is_dir():
            return Folder(reader)
        return reader if files[0] is reader.storage else files[0]
    except (KeyError, UnicodeDecodeError, rosbag2.ReaderError) as error:
        # rosbags refuses an .mcap whose profile, or one of whose schemas, is not of ROS 2; it decodes each
        # schema as text.
        is_foreign = not isinstance(error, rosbag2.ReaderError) or str(error).startswith("Profile is not")
        if path.suffix != ".mcap" or not path.is_file() or not is_foreign:
            raise
        return ForeignMcap(path, stack)


def _refuse_strays(file: Any) -> None:
    """Refuse a file with messages of topics that it does not list."""
    counts = [one.msgcount for one in file.connections]
    lost = file.metadata.message_count - sum(counts)
    # An .mcap need not count the messages of each topic.
    if lost > 0 and (any(counts) or not counts):
        raise ValueError(f"{counted(lost, 'message')} of no topic")


class Folder:
    """
    Describes a folder of rosbag2 by the indexes of its files.

    A ``metadata.yaml`` may be edited, older than the files, or made by a tool that counts differently. Only
    the list of the files, their format, and topics without messages come from there. ``expected`` has its
    counts of messages, for warnings. ``files`` are its files, decompressed.

    :param reader: a ``rosbag2.Reader`` of the folder, which is open.
    """

    def __init__(self, reader: Reader) -> None:
        files = reader.storage.storages
        found = [one for file in files for one in file.connections]
        recorded = {one.topic for one in found}
        empty = [one._replace(msgcount=0) for one in reader.connections if one.topic not in recorded]
        self.connections = [*found, *empty]
        counts = ((one.topic, one.msgcount) for one in reader.connections)
        self.expected = {topic: count for topic, count in counts if isinstance(count, int)}
        filled = [file.metadata for file in files if file.metadata.message_count]
        self.message_count = sum(one.message_count for one in filled)
        self.start_time = min((one.start_time for one in filled), default=0)
        self.end_time = max((one.end_time for one in filled), default=0)
        self.messages = reader.messages
        self.files = [Path(one.path) for one in files]


class ForeignMcap:
    """Reads an .mcap of another recorder than ROS 2's, such as Foxglove's, with the library mcap."""

    def __init__(self, path: Path, stack: ExitStack) -> None:
        require("mcap", "bag")
        from mcap.reader import make_reader

        self.path = path
        self._mcap = make_reader(stack.enter_context(open(path, "rb")), validate_crcs=True)
        summary = self._mcap.get_summary()
        if summary is None or summary.statistics is None:
            raise ValueError("it has no index")
        for chunk in summary.chunk_indexes:
            # Without message indexes, any channel may be in it; older versions of the library would skip it.
            if not chunk.message_index_offsets:
                chunk.message_index_offsets.update(dict.fromkeys(summary.channels, 0))
        about, self.metadata = summary.statistics, self  # as rosbags' files have it
        self.message_count = about.message_count
        self.start_time, self.end_time = about.message_start_time, about.message_end_time + 1
        counts = about.channel_message_counts
        self._connections = {
            one.id: connection_of(one, summary.schemas.get(one.schema_id), counts.get(one.id, 0), self)
            for one in summary.channels.values()
        }
        self.connections = [*self._connections.values()]
        self._schemas = {one.id: summary.schemas.get(one.schema_id) for one in summary.channels.values()}
        self._decoders: dict[int, Callable[[bytes], Any]] = {}

    def messages(
        self, connections: "Collection[Connection]", start: int | None, stop: int | None
    ) -> Iterator[RawMessage]:
        """Yield messages as rosbags' readers do."""
        topics = [one.topic for one in connections]
        found = self._mcap.iter_messages(topics, starting_at=start, ending_before=stop)
        for _, channel, message in found:
            yield self._connections[channel.id], message.log_time, message.data

    def decoder(self, connection: "Connection") -> Callable[[bytes], Any]:
        """Get the function that decodes the messages of a connection of Foxglove."""
        if connection.id not in self._decoders:
            require("mcap_protobuf", "bag")
            from mcap_protobuf.decoder import DecoderFactory

            decode = DecoderFactory().decoder_for(encoding_of(connection), self._schemas[connection.id])
            if decode is None:
                raise ValueError("it is not in protobuf")
            self._decoders[connection.id] = decode
        return self._decoders[connection.id]


def connection_of(channel: Any, schema: Any, count: int, owner: Any) -> "Connection":
    """Get rosbags' connection for a channel of the library mcap."""
    from rosbags.interfaces import Connection, ConnectionExtRosbag2, MessageDefinition
    from rosbags.interfaces import MessageDefinitionFormat as Format

    forms = {"ros1msg": Format.MSG, "ros2msg": Format.MSG, "ros2idl": Format.IDL}
    definition = MessageDefinition(Format.NONE, "")
    if schema is not None and schema.encoding in forms and schema.data.strip():
        # Comments need not be in UTF-8.
        definition = MessageDefinition(forms[schema.encoding], schema.data.decode(errors="replace"))
    msgtype = "__schemaless__" if schema is None else full_name(schema.name)
    ext = ConnectionExtRosbag2(channel.message_encoding, [])
    return Connection(channel.id, channel.topic, msgtype, definition, "", count, ext, owner)


def encoding_of(connection: "Connection") -> str:
    """Get the encoding of a connection's messages; ``ros1`` of a .bag, which names none."""
    return getattr(connection.ext, "serialization_format", "ros1")


def typestore() -> "Typestore":
    """Get the types of messages of ROS 2."""
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.LATEST)
