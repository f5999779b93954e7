"""Owns the text that shows frames as the trees that they form."""

from collections.abc import Iterator, Mapping

from tf2_py._objects.errors import NS_PER_S, seconds
from tf2_py._objects.listings import FrameInfo
from tf2_py._objects.printable import printable

__all__ = ["tree_text"]

INDENT = "  "
# What is deeper begins again at the margin, so that the text of a long chain of frames stays short.
MAX_DEPTH = 40


def tree_text(frames: Mapping[str, FrameInfo]) -> str:
    """
    One line per frame, two spaces deeper than its parent's; roots and siblings in the order of the alphabet.

    :param frames: by name; a parent that is no key is a root.
    :return: a line says how many samples a frame has, or that it is static; "no frames" where there is none.

    Frames whose parents form a loop follow the trees. The loop is cut at the frame whose name is its first
    in the alphabet, which is marked.
    """
    children: dict[str, list[str]] = {}
    for name in sorted(frames):
        parent = frames[name].parent
        if parent is not None:
            children.setdefault(parent, []).append(name)
    roots = {name for name, info in frames.items() if info.parent is None} | (children.keys() - frames.keys())
    lines: list[str] = []
    shown: set[str] = set()
    for name in sorted(roots):
        lines += _subtree(name, "", frames, children, shown)
    for name in sorted(frames.keys() - shown):
        if name not in shown:
            lines += _subtree(_first_of_loop(name, frames), " (loop)", frames, children, shown)
    return "\n".join(lines) or "no frames"


def _subtree(
    root: str,
    mark: str,
    frames: Mapping[str, FrameInfo],
    children: Mapping[str, list[str]],
    shown: set[str],
) -> Iterator[str]:
    # No recursion: a tree may be deeper than Python's stack.
    waiting = [(root, 0, mark)]
    continued: list[str] = []
    while waiting:
        name, depth, mark = waiting.pop()
        again = name in shown and not mark
        shown.add(name)
        below = [] if again else children.get(name, [])
        if below and depth == MAX_DEPTH:
            continued.append(name)
            below, mark = [], " ..."
        yield INDENT * depth + printable(name) + _facts(frames.get(name)) + (" (loop)" if again else mark)
        waiting += [(child, depth + 1, "") for child in reversed(below)]
        if not waiting and continued:
            waiting.append((continued.pop(0), 0, " (continued)"))


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
    """The frame with the first name of the loop that the ancestors of a frame end in."""
    path: dict[str, None] = {}
    while name not in path:
        path[name] = None
        parent = frames[name].parent
        assert parent is not None  # otherwise a root would have led here
        name = parent
    names = list(path)
    return min(names[names.index(name) :])
