"""Owns ``load``, ``transforms`` and ``stamps``: what is read of a recording, and how it fills a buffer."""

import warnings
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import chain
from math import inf
from os import PathLike
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tf2_py._internal import counted, printable, time_ns
from tf2_py.typing import TimeLike, TimeoutLike
from tf2_ros._receive.recording import Recording
from tf2_ros._recordings.fill import Source, fill, read_transforms
from tf2_ros._recordings.problems import BagError, BagWarning, listed
from tf2_ros._recordings.progress import progress_bar
from tf2_ros._recordings.reading import (
    TF_TYPES,
    RawMessage,
    Recorded,
    is_static,
    open_recording,
    stamps_of,
)

if TYPE_CHECKING:
    from geometry_msgs.msg import TransformStamped

    from tf2_ros import Buffer

__all__ = [
    "TOPICS",
    "Topics",
    "Wanted",
    "fill_buffer",
    "load",
    "new_buffer",
    "stamps",
    "transforms",
    "wanted",
]

TOPICS = ("/tf", "/tf_static")
Topics: TypeAlias = "Iterable[str] | Mapping[str, str]"

ENCODINGS = ("cdr", "ros1")
UNLIMITED_BYTES = (1 << 63) - 1


@dataclass(frozen=True)
class Wanted:
    """What is read: topics with the prefixes of their frames, and log times; None: no limit."""

    prefixes: Mapping[str, str]
    start_ns: int | None
    end_ns: int | None

    @property
    def limited(self) -> bool:
        return self.start_ns is not None or self.end_ns is not None


def wanted(topics: Topics, start: TimeLike | None, end: TimeLike | None) -> Wanted:
    """
    Check the arguments that say what is read.

    :raises TypeError: ``topics`` is a str, a name or prefix is none, or a time is no time.
    :raises ValueError: there is no topic, or ``end`` is before ``start``.
    """
    if isinstance(topics, str):
        raise TypeError(f"topics must be several names, use [{topics!r}]")
    prefixes = dict(topics) if isinstance(topics, Mapping) else dict.fromkeys(topics, "")
    for text in (*prefixes, *prefixes.values()):
        if not isinstance(text, str):
            raise TypeError(f"topics must be names, or map names to prefixes, not {type(text).__name__}")
    if not prefixes:
        raise ValueError("topics must not be empty")
    start_ns = None if start is None else time_ns(start, "start")
    end_ns = None if end is None else time_ns(end, "end")
    if start_ns is not None and end_ns is not None and end_ns < start_ns:
        raise ValueError(f"end, {end_ns} ns, is before start, {start_ns} ns")
    return Wanted(prefixes, start_ns, end_ns)


def load(
    path: "str | PathLike[str]",
    *,
    cache_time: TimeoutLike | None = None,
    topics: Topics = TOPICS,
    start: TimeLike | None = None,
    end: TimeLike | None = None,
    progress: bool | None = None,
    partial: bool = False,
) -> "Buffer":
    """
    Make a buffer of the transforms of a recording.

    :param path: a folder of rosbag2, or a file that ends in ``.mcap``, ``.db3`` or ``.bag`` (ROS 1).
    :param cache_time: how far each frame's history reaches back from its latest sample: a duration, or a
        number, which is seconds. None: everything is kept.
    :param topics: names of topics; or a mapping of their names to prefixes of the names of their frames, as
        ``{"/robot1/tf": "robot1/"}``. A topic whose last component is ``tf_static`` has static transforms.
    :param start: the log time, which is when it was recorded, of the first message of dynamic transforms.
        None: from the beginning. Static transforms are read whole, whatever the times.
    :param end: likewise, of the last message.
    :param progress: show a bar, which needs tqdm. None: if standard error is a terminal, after one second.
    :param partial: give what can be read of a broken recording, with a :class:`BagWarning` that says what is
        lost.
    :return: a buffer without a node; the authority of a transform is the name of its topic. No limit of
        memory refuses a transform.
    :raises FileNotFoundError: there is no such file.
    :raises BagError: it is no recording, it is broken, it has none of the topics, or one is of another type.
    :raises ModuleNotFoundError: rosbags is not installed; the text says how to.
    :raises TypeError, ValueError: ``topics``, ``start`` or ``end`` are not as described.

    A recording needs not have all of the topics, and a topic needs no messages. Transforms that a buffer
    refuses, as those with NaN, are logged.
    """
    what = wanted(topics, start, end)
    buffer = new_buffer(cache_time)
    with open_recording(path, partial=partial) as recorded:
        fill_buffer(buffer, recorded, what, progress=progress)
    warn_of(recorded)
    return buffer


def new_buffer(cache_time: TimeoutLike | None) -> "Buffer":
    """A buffer that keeps everything, or as much as ``cache_time`` says."""
    import tf2_ros

    return tf2_ros.Buffer(inf if cache_time is None else cache_time, max_bytes=UNLIMITED_BYTES)


def warn_of(recorded: Recorded) -> None:
    """Warn the caller's caller if something could not be read."""
    if recorded.problems:
        warnings.warn(BagWarning("; ".join(recorded.problems)), stacklevel=3)


def fill_buffer(
    buffer: "Buffer",
    recorded: Recorded,
    what: Wanted,
    *,
    progress: bool | None,
    recording: Recording | None = None,
    records: list[Any] | None = None,
) -> None:
    """
    Insert what is wanted of a recording into a buffer.

    :param recording: notes each transform; see :func:`tf2_ros._recordings.fill.fill`, also for ``records``.
    """
    sources = sources_of(recorded, what)
    unread = Unread(recorded)
    total = None if what.limited else sum(recorded.topics[one.topic].count for one in sources)
    with progress_bar(recorded.path, total, " messages", progress) as count:
        read = sum(
            fill(buffer, messages, sources, unread.add, count=count, recording=recording, records=records)
            for messages in passes(recorded, sources, what)
        )
    unread.end()
    if total and not read and not recorded.problems:
        raise BagError(
            f"{printable(recorded.path)}: its metadata.yaml tells of {total} messages of"
            f" {listed(one.topic for one in sources)}, but its files hold none of such topics"
        )


class Unread:
    """Collects messages that cannot be read; an error, unless the recording is read in part."""

    def __init__(self, recorded: Recorded) -> None:
        self._recorded = recorded
        self._counts: Counter[str] = Counter()
        self._first: dict[str, str] = {}

    def add(self, topic: str, log_ns: int, error: ValueError) -> None:
        text = f"{printable(self._recorded.path)}, topic {printable(topic)}, log time {log_ns} ns: {error}"
        if not self._recorded.partial:
            raise BagError(text) from error
        self._first.setdefault(topic, text)
        self._counts[topic] += 1

    def end(self) -> None:
        """List what was collected as problems of the recording."""
        for topic, text in self._first.items():
            more = self._counts[topic] - 1
            self._recorded.problems.append(f"{text}, and {counted(more, 'later message')}" if more else text)


def sources_of(recorded: Recorded, what: Wanted) -> list[Source]:
    """
    Those of the wanted topics that the recording has.

    :raises BagError: it has none of them, or one of another type.
    """
    name = printable(recorded.path)
    found = [recorded.topics[topic] for topic in what.prefixes if topic in recorded.topics]
    for one in found:
        if one.msgtype not in TF_TYPES:
            raise BagError(
                f"{name}, topic {printable(one.name)}: its type is {printable(one.msgtype)},"
                f" not {TF_TYPES[0]}"
            )
        if one.encoding not in ENCODINGS:
            raise BagError(
                f"{name}, topic {printable(one.name)}: its encoding is {printable(one.encoding)}, not cdr"
            )
    if not found:
        others = [one.name for one in recorded.topics.values() if one.msgtype in TF_TYPES]
        advice = ": choose some of them, by `topics` or `--topic`" if others else ""
        raise BagError(
            f"{name} has no topic {' or '.join(map(printable, what.prefixes))}; its topics with"
            f" transforms: {listed(others)}{advice}"
        )
    return [Source(one.name, is_static(one.name), what.prefixes[one.name]) for one in found]


def passes(recorded: Recorded, sources: list[Source], what: Wanted) -> Iterator[Iterator[RawMessage]]:
    """The messages: in one pass, or static transforms first where times limit the others."""
    topics = {one.topic for one in sources}
    if not what.limited:
        yield recorded.messages(topics)
        return
    static = set(filter(is_static, topics))
    yield recorded.messages(static)
    yield recorded.messages(topics - static, what.start_ns, what.end_ns)


def transforms(
    path: "str | PathLike[str]",
    *,
    topics: Topics = TOPICS,
    start: TimeLike | None = None,
    end: TimeLike | None = None,
    partial: bool = False,
) -> "Iterator[tuple[int, bool, TransformStamped]]":
    """
    Read the transforms of a recording one after the other, in constant memory.

    :return: an iterator over ``(log time in ns, whether it is static, TransformStamped)``. Where ROS is not
        installed, the last are objects with the same fields.

    They are as they were recorded: not checked, not normalised. Arguments and errors are those of
    :func:`load`, the errors and the :class:`BagWarning` of a recording come when it is iterated over. With
    ``start`` or ``end`` all static transforms come first.
    """
    return _transforms(path, wanted(topics, start, end), partial)


def stamps(path: "str | PathLike[str]", topic: str, *, partial: bool = False) -> NDArray[np.int64]:
    """
    Read the stamps of all messages of a topic, for lookups at these times.

    :param topic: of any type whose messages begin with a ``std_msgs/Header``.
    :param partial: as of :func:`load`.
    :return: nanoseconds, of shape (N,), in the order of the recording.
    :raises FileNotFoundError, ModuleNotFoundError: as :func:`load`.
    :raises BagError: the recording is broken, it has no such topic, or its messages have no header.
    """
    with open_recording(path, partial=partial) as recorded:
        found = stamps_of(recorded, topic)
    warn_of(recorded)
    return found


def _transforms(
    path: "str | PathLike[str]", what: Wanted, partial: bool
) -> "Iterator[tuple[int, bool, TransformStamped]]":
    with open_recording(path, partial=partial) as recorded:
        sources = {one.topic: one for one in sources_of(recorded, what)}
        unread = Unread(recorded)
        for connection, log_ns, raw in chain.from_iterable(passes(recorded, [*sources.values()], what)):
            topic = connection.topic
            try:
                found = read_transforms(raw, sources[topic])
            except ValueError as error:
                unread.add(topic, log_ns, error)
                continue
            for transform in found:
                yield log_ns, is_static(topic), transform
        unread.end()
    warn_of(recorded)
