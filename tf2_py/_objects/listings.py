"""Owns the listings of the frames of a buffer: as objects, and as YAML, sentences and Graphviz."""

import re
from typing import Any, NamedTuple

from tf2_py._objects.errors import NS_PER_S
from tf2_py._objects.printable import class_name, counted, printable

SHORTEST_SPAN_NS = 100_000  # a shorter history counts as this long when its rate is worked out
UNQUOTED_KEY = re.compile(r"[^\W\d][\w.-]*")
LONGEST_SIMPLE_KEY = 1000  # YAML looks for the colon within 1024 characters
YAML_WORDS = {"y", "n", "yes", "no", "on", "off", "true", "false", "null"}


class FrameInfo(NamedTuple):
    """
    What a buffer holds of one frame; see :meth:`tf2_py.BufferCore.frames`.

    Fields: ``parent``, a name, that of the newest sample; None where the buffer holds no sample of the frame:
    a root. ``static``: whether its transform holds at all times. ``count``: how many samples. ``oldest_ns``
    and ``newest_ns``: their stamps in nanoseconds; None for a static frame and for one without samples.

    >>> from tf2_py import BufferCore, FrameInfo
    >>> FrameInfo(parent="map", static=False, count=2, oldest_ns=1_000, newest_ns=3_000).parent
    'map'
    """

    parent: str | None
    static: bool
    count: int  # type: ignore[assignment]  # instead of the method of a tuple
    oldest_ns: int | None
    newest_ns: int | None


FrameInfo.__module__ = "tf2_py"


class FrameFacts(NamedTuple):
    """The facts about one frame."""

    name: str
    parent: str | None  # None: its history is empty
    authority: str
    is_static: bool
    samples: int
    newest_ns: int  # 0 for a static frame
    oldest_ns: int

    @property
    def rate(self) -> float:
        return self.samples * 1e9 / max(self.newest_ns - self.oldest_ns, SHORTEST_SPAN_NS)

    @property
    def buffer_length(self) -> float:
        return (self.newest_ns - self.oldest_ns) / NS_PER_S


def as_frames(frames: list[FrameFacts]) -> dict[str, FrameInfo]:
    """What programs get."""
    infos = {}
    for f in frames:
        times = (f.oldest_ns, f.newest_ns) if f.samples and not f.is_static else (None, None)
        infos[f.name] = FrameInfo(f.parent, f.is_static, f.samples, *times)
    return infos


def as_line(kind: type, counts: dict[str, Any], span_ns: int | None) -> str:
    """
    What ``repr`` shows of a buffer.

    ``counts`` as of ``BufferCore.statistics``; ``span_ns``: from its oldest to its newest sample, or None.
    """
    frames, samples, waiters = (counted(counts[f"{what}s"], what) for what in ("frame", "sample", "waiter"))
    span = "" if span_ns is None else f" over {span_ns / NS_PER_S:.1f} s"
    return f"<{class_name(kind)}: {frames}, {samples}{span}, {waiters}>"


def _microseconds(ns: int) -> str:
    # Rounded in tf2's order: at the times of today a double holds little more than six decimals.
    whole, rest = divmod(ns, NS_PER_S)
    return f"{whole + 1e-9 * rest:.6f}"


def _yaml_entry(name: str) -> str:
    needs_no_quotes = UNQUOTED_KEY.fullmatch(name) and name.lower() not in YAML_WORDS
    key = name if needs_no_quotes else _yaml_quoted(name)
    return f"{key}: " if len(key) <= LONGEST_SIMPLE_KEY else f"? {key}\n: "


def _yaml_quoted(text: str) -> str:
    if text.isprintable():
        return "'" + text.replace("'", "''") + "'"
    # Only double quotes can escape; all that printable() makes is an escape there.
    return '"' + printable(_escaped(text)) + '"'


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"')


def as_yaml(frames: list[FrameFacts]) -> str:
    """One mapping per frame that holds data, ``[]`` where none does."""
    lines = []
    for f in frames:
        if f.parent is None:
            continue
        lines += [
            _yaml_entry(f.name),
            f"  parent: {_yaml_quoted(f.parent)}",
            f"  broadcaster: {_yaml_quoted(f.authority)}",
            f"  rate: {f.rate:.3f}",
            f"  most_recent_transform: {_microseconds(f.newest_ns)}",
            f"  oldest_transform: {_microseconds(f.oldest_ns)}",
            f"  buffer_length: {f.buffer_length:.3f}",
        ]
    return "\n".join(lines) + "\n" if lines else "[]"


def as_string(frames: list[FrameFacts]) -> str:
    """One sentence per frame that was ever a child."""
    pairs = ((printable(f.name), printable(f.parent or "NO_PARENT")) for f in frames)
    return "".join(f"Frame {name} exists with parent {parent}.\n" for name, parent in pairs)


def _dot_quoted(text: str) -> str:
    # Graphviz knows no escapes but these, and would drop the backslash of another one.
    return '"' + _escaped(printable(text)) + '"'


def as_dot(frames: list[FrameFacts], time_ns: int) -> str:
    """A Graphviz digraph: an edge per frame that holds data, from its parent; ages as of time_ns unless 0."""
    lines = ["digraph G {"]
    if not any(f.parent is not None for f in frames):
        lines.append('"no tf data received"')
    for f in frames:
        if f.parent is None:
            continue
        age = f" ({(time_ns - f.newest_ns) / NS_PER_S:.3f} sec old)" if time_ns else ""
        label = (
            f"Broadcaster: {_dot_quoted(f.authority)[1:-1]}\\n"
            f"Average rate: {f.rate:.3f} Hz\\n"
            f"Most recent transform: {_microseconds(f.newest_ns)}{age}\\n"
            f"Buffer length: {f.buffer_length:.3f} sec\\n"
        )
        lines.append(f'{_dot_quoted(f.parent)} -> {_dot_quoted(f.name)}[label="{label}"];')
    if time_ns:
        lines += [
            'subgraph cluster_legend { style=bold; color=black; label="view_frames Result";',
            f'"Recorded at time: {_microseconds(time_ns)}"[shape=plaintext];',
            "}",
        ]
    lines.append("}")
    return "\n".join(lines)
