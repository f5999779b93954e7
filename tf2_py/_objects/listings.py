# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""List the frames of a buffer as objects, arrays of samples, a tree of text, YAML, sentences and Graphviz."""

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, NamedTuple

from tf2_py._objects.errors import NS_PER_S, class_name, seconds
from tf2_py.printable import counted, printable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


SHORTEST_SPAN_NS = 100_000  # a shorter history counts as this long when its rate is worked out
UNQUOTED_KEY = re.compile(r"[^\W\d][\w.-]*")
LONGEST_SIMPLE_KEY = 1000  # YAML looks for the colon within 1024 characters
INDENT = "  "  # of the tree
MAX_DEPTH = 40  # deeper frames are not indented further
YAML_WORDS = {"y", "n", "yes", "no", "on", "off", "true", "false", "null"}


class FrameInfo(NamedTuple):
    """
    One frame of a buffer; see :meth:`tf2_py.BufferCore.frames`.

    Fields: ``parent``: the name in the newest sample; None if the buffer has no sample of the frame, which is
    then a root. ``static``: whether its transform is valid at all times. ``count``: the number of samples.
    ``oldest_ns`` and ``newest_ns``: their stamps in nanoseconds; None for a static frame and for a frame
    without samples. So ``oldest_ns is not None`` holds exactly for the frames that move: roots are not
    static, and have no stamps either.

    >>> from tf2_py import BufferCore, FrameInfo
    >>> robot = FrameInfo(parent="map", static=False, count=2, oldest_ns=1_000, newest_ns=3_000)
    >>> root = FrameInfo(parent=None, static=False, count=0, oldest_ns=None, newest_ns=None)
    >>> max(info.oldest_ns for info in (robot, root) if info.oldest_ns is not None)
    1000
    """

    parent: str | None
    static: bool
    count: int  # type: ignore[assignment]  # instead of the method of a tuple
    oldest_ns: int | None
    newest_ns: int | None


FrameInfo.__module__ = "tf2_py"


class History(NamedTuple):
    """
    The N samples of one frame, oldest first; a static frame has one. See :meth:`tf2_py.BufferCore.histories`.

    Fields: ``frame``, its name; ``static``: whether its transform is valid at all times; ``parents``, names,
    shape (N,), because samples may have different parents; ``stamps_ns``, nanoseconds, int64, shape (N,);
    ``translations``, meters, float64, shape (N, 3); ``rotations``, x y z w, float64, shape (N, 4).

    >>> from tf2_py import BufferCore
    >>> from geometry_msgs.msg import TransformStamped
    >>> mount = TransformStamped(child_frame_id="camera")
    >>> mount.header.frame_id = "base_link"
    >>> mount.transform.translation.x = 0.3
    >>> buffer = BufferCore()
    >>> buffer.set_transform(mount, "example")
    >>> history = buffer.histories()["camera"]
    >>> history.parents[0], history.translations[0, 0].item()
    ('base_link', 0.3)
    """

    frame: str
    static: bool
    parents: "NDArray[np.object_]"
    stamps_ns: "NDArray[np.int64]"
    translations: "NDArray[np.float64]"
    rotations: "NDArray[np.float64]"


History.__module__ = "tf2_py"


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


def as_frame(f: FrameFacts) -> FrameInfo:
    """A frame as programs see it."""
    times = (f.oldest_ns, f.newest_ns) if f.samples and not f.is_static else (None, None)
    return FrameInfo(f.parent, f.is_static, f.samples, *times)


def as_line(kind: type, counts: dict[str, Any], facts: Iterable[FrameFacts]) -> str:
    """
    What ``repr`` shows of a buffer, with the time from its oldest to its newest dynamic sample.

    ``counts`` as in ``BufferCore.statistics``.
    """
    times = [(f.oldest_ns, f.newest_ns) for f in facts if f.samples and not f.is_static]
    span_ns = max(newest for _, newest in times) - min(oldest for oldest, _ in times) if times else None
    frames, samples, waiters = (counted(counts[f"{what}s"], what) for what in ("frame", "sample", "waiter"))
    span = "" if span_ns is None else f" over {span_ns / NS_PER_S:.1f} s"
    return f"<{class_name(kind)}: {frames}, {samples}{span}, {waiters}>"


def _microseconds(ns: int) -> str:
    # Rounded in the same steps as in tf2: at present times a double holds little more than six decimals.
    whole, rest = divmod(ns, NS_PER_S)
    return f"{whole + 1e-9 * rest:.6f}"


def _yaml_entry(name: str) -> str:
    needs_no_quotes = UNQUOTED_KEY.fullmatch(name) and name.lower() not in YAML_WORDS
    key = name if needs_no_quotes else _yaml_quoted(name)
    return f"{key}: " if len(key) <= LONGEST_SIMPLE_KEY else f"? {key}\n: "


def _yaml_quoted(text: str) -> str:
    if text.isprintable():
        return "'" + text.replace("'", "''") + "'"
    # Only double quotes allow escapes; all escapes of printable() are valid there.
    return '"' + printable(_escaped(text)) + '"'


def _escaped(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"')


def as_yaml(frames: Iterable[FrameFacts]) -> str:
    """Write one mapping per frame with data; ``[]`` if there are none."""
    return "".join(_yaml_mapping(f, f.parent) for f in frames if f.parent is not None) or "[]"


def _yaml_mapping(f: FrameFacts, parent: str) -> str:
    return (
        f"{_yaml_entry(f.name)}\n"
        f"  parent: {_yaml_quoted(parent)}\n"
        f"  broadcaster: {_yaml_quoted(f.authority)}\n"
        f"  rate: {f.rate:.3f}\n"
        f"  most_recent_transform: {_microseconds(f.newest_ns)}\n"
        f"  oldest_transform: {_microseconds(f.oldest_ns)}\n"
        f"  buffer_length: {f.buffer_length:.3f}\n"
    )


def as_string(frames: Iterable[FrameFacts]) -> str:
    """Write one sentence per frame that was ever a child."""
    pairs = ((printable(f.name), printable(f.parent or "NO_PARENT")) for f in frames)
    return "".join(f"Frame {name} exists with parent {parent}.\n" for name, parent in pairs)


def _dot_quoted(text: str) -> str:
    # Graphviz knows only these escapes and drops the backslash of any other.
    return '"' + _escaped(printable(text)) + '"'


def as_dot(frames: Iterable[FrameFacts], time_ns: int) -> str:
    """Write a Graphviz digraph with an edge to each frame with data; ages at ``time_ns`` unless 0."""
    edges = "".join(_dot_edge(f, f.parent, time_ns) for f in frames if f.parent is not None)
    legend = (
        'subgraph cluster_legend { style=bold; color=black; label="view_frames Result";\n'
        f'"Recorded at time: {_microseconds(time_ns)}"[shape=plaintext];\n'
        "}\n"
    )
    no_edges = '"no tf data received"\n'
    return f"digraph G {{\n{edges or no_edges}{legend if time_ns else ''}}}"


def _dot_edge(f: FrameFacts, parent: str, time_ns: int) -> str:
    age = f" ({(time_ns - f.newest_ns) / NS_PER_S:.3f} sec old)" if time_ns else ""
    label = (
        f"Broadcaster: {_dot_quoted(f.authority)[1:-1]}\\n"
        f"Average rate: {f.rate:.3f} Hz\\n"
        f"Most recent transform: {_microseconds(f.newest_ns)}{age}\\n"
        f"Buffer length: {f.buffer_length:.3f} sec\\n"
    )
    return f'{_dot_quoted(parent)} -> {_dot_quoted(f.name)}[label="{label}"];\n'


def tree_text(frames: Mapping[str, FrameInfo]) -> str:
    """
    Write one line per frame, indented by two spaces more than its parent, in alphabetical order.

    :param frames: by name; a parent without an entry is a root.
    :return: each line states the number of samples of a frame, or that it is static; "no frames" if there
        are none.

    Frames whose parents form a loop follow the trees. The loop begins at the frame whose name comes first in
    the alphabet, which is marked.
    """
    return "".join(f"{line}\n" for line in _tree_lines(frames)).removesuffix("\n") or "no frames"


def _tree_lines(frames: Mapping[str, FrameInfo]) -> Iterator[str]:
    children: dict[str, list[str]] = {}
    for name, info in frames.items():
        if info.parent is not None:
            children.setdefault(info.parent, []).append(name)
    roots = [name for name, info in frames.items() if info.parent is None]
    roots += children.keys() - frames.keys()
    shown: set[str] = set()
    for name in sorted(roots):
        yield from _subtree(name, "", frames, children, shown)
    for name in sorted(frames.keys() - shown):
        if name not in shown:
            yield from _subtree(_first_of_loop(name, frames), " (loop)", frames, children, shown)


def _subtree(
    root: str,
    mark: str,
    frames: Mapping[str, FrameInfo],
    children: Mapping[str, list[str]],
    shown: set[str],
) -> Iterator[str]:
    # No recursion: a tree may be deeper than Python's stack.
    waiting = [(root, 0, mark)]
    while waiting:
        name, depth, mark = waiting.pop()
        again = name in shown and not mark
        shown.add(name)
        below = [] if again else sorted(children.get(name, []))
        end = " (loop)" if again else mark
        yield INDENT * min(depth, MAX_DEPTH) + printable(name) + _facts(frames.get(name)) + end
        waiting += [(child, depth + 1, "") for child in reversed(below)]


def _facts(info: FrameInfo | None) -> str:
    if info is None or info.count == 0:
        return ""
    if info.oldest_ns is None or info.newest_ns is None:
        return " (static)"
    if info.count == 1:
        return f" (1 sample, at {seconds(info.newest_ns)})"
    span_s = (info.newest_ns - info.oldest_ns) / NS_PER_S
    return f" ({info.count} samples over {span_s:.3f} s, newest at {seconds(info.newest_ns)})"


def _first_of_loop(name: str, frames: Mapping[str, FrameInfo]) -> str:
    """The frame whose name comes first in the loop that the ancestors of a frame lead to."""
    path: dict[str, None] = {}
    while name not in path:
        path[name] = None
        parent = frames[name].parent
        assert parent is not None  # otherwise a root would have led here
        name = parent
    names = list(path)
    return min(names[names.index(name) :])
