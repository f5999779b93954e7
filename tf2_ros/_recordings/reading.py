"""Owns recordings of all formats as raw messages in CDR."""

import errno
import os
import re
import struct
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from itertools import chain
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tf2_py._internal import printable
from tf2_ros._recordings.fill import Explained
from tf2_ros._recordings.problems import BagError, explained, listed, needing
from tf2_ros._recordings.rescue import LAST_NS, RawMessage, Reader, decompressed, rescued

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.typesys.store import Typestore

__all__ = [
    "TF_TYPES",
    "RawMessage",
    "Recorded",
    "Topic",
    "is_static",
    "open_recording",
    "stamps_of",
]

# The beginning of a file, by the end of its name.
MAGICS = {".mcap": b"\x89MCAP0\r\n", ".db3": b"SQLite format 3\0", ".bag": b"#ROSBAG V"}
# What ends like this belongs to a recording, or may become one.
ADVICE = {
    ".yaml": "give the path of its folder",
    ".zstd": "give the path of its folder, which has a metadata.yaml",
    ".active": "its recorder was not ended: `rosbag reindex` repairs it",
}
# What is read of topics with transforms; ROS 1 has two names for the same message.
TF_TYPES = ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage")
HEADER = "std_msgs/msg/Header"


@dataclass(frozen=True)
class Topic:
    """
    A recorded topic.

    ``count`` is its number of messages, ``encoding`` that of their bytes: ``cdr``, of ROS 1 ``ros1``.
    """

    name: str
    msgtype: str
    count: int
    encoding: str = "cdr"


class Recorded:
    """
    An open recording.

    ``path`` is its path, ``topics`` maps the names to a :class:`Topic` each, ``start_ns`` and ``end_ns`` are
    the log times of its first and last message, of whatever topic; None where it has none. ``problems`` says
    what could not be read, where ``partial`` allows that.
    """

    def __init__(self, path: str, readers: list[Reader], partial: bool, problems: list[str]) -> None:
        self.path = path
        self.problems = problems
        self.partial = partial
        self._readers = readers
        self.topics: dict[str, Topic] = {}
        for reader in readers:
            counts = _counts(reader)
            for name in {one.topic for one in reader.connections}:
                self._add_topic(name, reader.connections, counts[name])
        filled = [reader for reader in readers if reader.message_count]
        self.start_ns: int | None = min((reader.start_time for reader in filled), default=None)
        self.end_ns: int | None = max((reader.end_time - 1 for reader in filled), default=None)

    def _add_topic(self, name: str, connections: "list[Connection]", count: int) -> None:
        ours = [one for one in connections if one.topic == name]
        types = {one.msgtype: None for one in ours}
        known = self.topics.get(name)
        if known is not None:
            count += known.count
            types = {**dict.fromkeys(known.msgtype.split(" and ")), **types}
        encoding = getattr(ours[0].ext, "serialization_format", "ros1")
        self.topics[name] = Topic(name, " and ".join(types), count, encoding)

    def connections(self, topic: str) -> "list[Connection]":
        """What rosbags knows of a topic; a topic may have several."""
        return [one for reader in self._readers for one in reader.connections if one.topic == topic]

    def messages(
        self, names: Iterable[str], start_ns: int | None = None, end_ns: int | None = None
    ) -> Iterator[RawMessage]:
        """
        The messages of some topics.

        :param names: of the topics; those that the recording does not have are left out.
        :param start_ns: the log time of the first one; None: from the beginning.
        :param end_ns: the log time of the last one; None: to the end.
        :return: ``(connection, log time in ns, message in CDR)``, file by file, and within each in the order
            of log times, if it has an index; ``connection.topic`` is the name of the topic.
        :raises BagError: the recording is broken, unless it is read in part.
        """
        return self._messages(names, start_ns, end_ns, convert=True)

    def stored(self, topic: str) -> Iterator[RawMessage]:
        """All messages of a topic, as :meth:`messages`, but those of ROS 1 are not converted."""
        return self._messages([topic], None, None, convert=False)

    def _messages(
        self, names: Iterable[str], start_ns: int | None, end_ns: int | None, convert: bool
    ) -> Iterator[RawMessage]:
        wanted = set(names)
        stop = None if end_ns is None or end_ns >= LAST_NS else end_ns + 1
        found = []
        for reader in self._readers:
            connections = [one for one in reader.connections if one.topic in wanted]
            if connections:
                messages = reader.messages(connections, start_ns, stop)
                if self.problems:
                    messages = decompressed(messages)
                if convert and any(self.topics[one.topic].encoding == "ros1" for one in connections):
                    messages = _converted(messages)
                counts = _counts(reader)
                least = sum(counts[name] for name in wanted) if start_ns is None and end_ns is None else 0
                found.append(Explained(messages, self._explainer(str(reader.path), connections), least))
        # What hands out one iterator costs something for each message.
        return found[0] if len(found) == 1 else chain.from_iterable(found)

    def _explainer(
        self, path: str, connections: "list[Connection]"
    ) -> Callable[[Exception, int | None], Exception | None]:
        def explain(error: Exception, last_ns: int | None) -> Exception | None:
            where = f"topic {listed(one.topic for one in connections)}"
            where += ", at the beginning" if last_ns is None else f", after log time {last_ns} ns"
            told = explained(error, path, where)
            if not self.partial or not isinstance(told, BagError):
                return told
            self.problems.append(told.found)
            return None

        return explain


def _counts(reader: Reader) -> Counter[str]:
    # The messages of each topic by what the files themselves tell: metadata.yaml may count what was never
    # written, and where the index of a ROS 1 file is spoiled, its list of chunks tells more.
    if hasattr(reader, "chunk_infos"):
        return Counter({name: one.msgcount for name, one in reader.topics.items()})
    counts: Counter[str] = Counter()
    for source in _storages(reader) or [reader]:
        for one in source.connections:
            counts[one.topic] += one.msgcount
    return counts


def is_static(topic: str) -> bool:
    """Whether the transforms of a topic hold at all times: whether its last component is ``tf_static``."""
    return topic.rpartition("/")[2] == "tf_static"


@contextmanager
def open_recording(path: "str | PathLike[str]", *, partial: bool = False) -> Iterator[Recorded]:
    """
    Open a recording of any format.

    :param path: a folder of rosbag2, or a file that ends in ``.mcap``, ``.db3`` or ``.bag`` (ROS 1).
    :param partial: of a broken recording give what can be read, and list what cannot as ``problems``.
    :raises FileNotFoundError: there is no such file.
    :raises BagError: it is no recording, or it is broken.
    :raises ModuleNotFoundError: rosbags is not installed.
    """
    text = os.fspath(path)
    if not isinstance(text, str):
        raise TypeError(f"path must be a str or os.PathLike of str, not {type(path).__name__}")
    with needing("rosbags", "bag"):
        import rosbags  # noqa: F401
    if not os.path.exists(text):
        raise FileNotFoundError(errno.ENOENT, "there is no recording", text)
    with ExitStack() as stack:
        problems: list[str] = []
        try:
            readers = [stack.enter_context(_opened(Path(text)))]
        except BagError as error:
            if not partial:
                raise
            readers = rescued(Path(text), stack, problems, _opened)
            if not readers:
                lost = ", and nothing before that can be read" if error.readable_in_part else ""
                raise BagError(f"{error.found}{lost}") from error
            problems = list(dict.fromkeys([error.found, *problems]))
        yield Recorded(text, readers, partial, problems)


@contextmanager
def _opened(path: Path) -> Iterator[Reader]:
    # One reader of rosbags; BagError where it refuses.
    from rosbags import rosbag1, rosbag2

    with ExitStack() as stack:
        try:
            if path.is_dir():
                _check_folder(path)
                reader: Reader = rosbag2.Reader(path)
            else:
                _check_file(path)
                reader = rosbag1.Reader(path) if path.suffix == ".bag" else rosbag2.Reader(path)
            stack.enter_context(reader)
            _check_merged(reader)
            _check_times(reader, str(path))
        except Exception as error:
            told = _broken_file(path) or explained(error, str(path))
            if told is error:
                raise
            raise told from error
        _allow_any_order(reader)
        yield reader


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
            f"{name} is no recording: the folder has no metadata.yaml;"
            f" {printable((inner or files)[0])} in it is one"
        )
    if parts:
        raise BagError(
            f"{name} has no metadata.yaml, but {', '.join(map(printable, parts))}: if they are one recording,"
            " its recorder was not ended, and `ros2 bag reindex` repairs it",
            readable_in_part=True,
        )
    raise BagError(f"{name} is no recording: the folder has no metadata.yaml")


def _check_file(path: Path) -> None:
    name = printable(str(path))
    magic = MAGICS.get(path.suffix)
    if magic is None:
        advice = ADVICE.get(path.suffix, f"use a folder with a metadata.yaml, or {', '.join(MAGICS)}")
        raise BagError(f"{name} is no recording: {advice}")
    _refuse_special(path)
    with open(path, "rb") as file:
        begin = file.read(16)
    if not begin:
        raise BagError(f"{name} is empty")
    if not begin.startswith(magic):
        other = next((suffix for suffix, one in MAGICS.items() if begin.startswith(one)), None)
        found = f"it is a {other}" if other else f"it begins with {begin!r}"
        raise BagError(f"{name} is no {path.suffix}: {found}")


def _refuse_special(path: Path) -> None:
    # Opening a pipe waits for its writer, and none of the formats is read from its beginning to its end.
    if path.exists() and not (path.is_file() or path.is_dir()):
        raise BagError(f"{printable(str(path))} is no recording: it is a pipe or a device")


def _check_times(reader: Reader, path: str) -> None:
    # Those that a recording tells of itself; of a folder, anybody may have written them.
    for told in (reader.start_time, reader.end_time - 1) if reader.message_count else ():
        if not isinstance(told, int) or abs(told) > LAST_NS:
            raise BagError(f"{printable(path)} is broken: it tells of the log time {told!r} ns")


def _check_merged(reader: Reader) -> None:
    # rosbags reads the file of a database alone; what its recorder wrote last is beside it until then.
    for storage in _storages(reader):
        path = storage.path
        log = path.with_name(f"{path.name}-wal")
        if path.suffix == ".db3" and log.exists() and log.stat().st_size:
            advice = f'`sqlite3 {printable(path.name)} "pragma wal_checkpoint"` merges it'
            raise BagError(f"{printable(str(path))} lacks what is in {printable(log.name)}: {advice}")


def _storages(reader: Reader) -> list[Any]:
    # The reader of a folder has one for each file; other readers are none of rosbag2.
    storage = getattr(reader, "storage", None)
    return [] if storage is None else list(getattr(storage, "storages", [storage]))


def _allow_any_order(reader: Reader) -> None:
    # rosbags refuses an .mcap without an index whose log times are not in order. For a buffer they may be in
    # any order, and recorders do write such files.
    for storage in _storages(reader):
        if hasattr(storage, "messages_scan") and not storage.chunks:
            storage.messages = storage.messages_scan


def _broken_file(path: Path) -> BagError | None:
    # Of a folder: about the file that cannot be opened. rosbags does not tell which one that is.
    if not path.is_dir() or not (path / "metadata.yaml").exists():
        return None
    for one in sorted(path.iterdir()):
        if one.suffix in MAGICS:
            try:
                with _opened(one):
                    pass
            except BagError as error:
                return error
    return None


def _converted(messages: Iterator[RawMessage]) -> Iterator[RawMessage]:
    # Of ROS 1 to CDR. The types are those of ROS 2: converting to them leaves out the `seq` of a header.
    store = _typestore()
    for connection, log_ns, raw in messages:
        msgtype = TF_TYPES[0] if connection.msgtype in TF_TYPES else connection.msgtype
        yield connection, log_ns, store.ros1_to_cdr(raw, msgtype)


def _typestore() -> "Typestore":
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.LATEST)


def stamps_of(recorded: Recorded, topic: str) -> NDArray[np.int64]:
    """
    The stamps of all messages of a topic whose messages begin with a ``std_msgs/Header``.

    :return: nanoseconds, in the order of the recording.
    :raises BagError: there is no such topic, its messages begin with something else, or one is too short.
    """
    name = f"{printable(recorded.path)}, topic {printable(topic)}"
    if topic not in recorded.topics:
        raise BagError(f"{name}: there is no such topic, but {listed(recorded.topics)}")
    about = recorded.topics[topic]
    try:
        stamped = all(_begins_with_header(one) for one in recorded.connections(topic))
    except Exception as error:  # the parsers have errors of their own for some spoiled definitions only
        raise explained(error, recorded.path, f"topic {printable(topic)}, definition of its type") from error
    if not stamped:
        raise BagError(f"{name}: {printable(about.msgtype)} does not begin with a {HEADER}")
    # In CDR a stamp follows four bytes of encoding, in ROS 1 the four of `seq`.
    big = struct.Struct(">iI")
    little = struct.Struct("<iI")
    stamps: list[int] = []
    for _, log_ns, raw in recorded.stored(topic):
        order = little if about.encoding == "ros1" or len(raw) < 2 or raw[1] & 1 else big
        if len(raw) < 12:
            raise BagError(f"{name}, log time {log_ns} ns: a message of {len(raw)} bytes has no header")
        sec, nanosec = order.unpack_from(raw, 4)
        stamps.append(sec * 1_000_000_000 + nanosec)
    return np.array(stamps, np.int64)


def _begins_with_header(connection: "Connection") -> bool:
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import get_types_from_idl, get_types_from_msg

    msgtype, (form, text) = connection.msgtype, connection.msgdef
    if form == MessageDefinitionFormat.MSG:
        types = get_types_from_msg(text, msgtype)
    elif form == MessageDefinitionFormat.IDL:
        # One definition, or several, each below a line that names it.
        types = {}
        for part in text.split("=" * 80 + "\n"):
            types.update(get_types_from_idl(re.sub(r"^IDL: .*\n", "", part)) if part.strip() else {})
    else:
        types = _typestore().fielddefs
    _, fields = types.get(msgtype, ([], []))
    return msgtype == HEADER or (bool(fields) and fields[0][1][1] == HEADER)
