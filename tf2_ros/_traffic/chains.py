"""Owns what lies between two frames: the chain, and how old the newest transform along it is."""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tf2_ros._traffic.streams import SLICES, Stream, taken

__all__ = ["NetDelay", "chain_between", "moving_on", "newest_streams", "path_to_root", "stamps_on"]

S = 1_000_000_000
EVENTS_AT_ONCE = 4096
NOTHING = np.iinfo(np.int64).min


class Below(Protocol):
    """What a tree must know of a frame: a ``Stream`` does, and so does a ``tf2_py.FrameInfo``."""

    @property
    def parent(self) -> str | None: ...
    @property
    def static(self) -> bool: ...


Tree = Mapping[str, Below]  # by the names of the frames


def newest_streams(streams: Iterable[Stream]) -> dict[str, Stream]:
    """Of each frame the stream that was heard last, which is what a buffer answers with."""
    newest: dict[str, Stream] = {}
    for stream in streams:
        known = newest.get(stream.frame)
        if known is None or stream.silence < known.silence:
            newest[stream.frame] = stream
    return newest


def path_to_root(newest: Tree, frame: str) -> list[str]:
    """A frame and its ancestors; in a loop, up to the frame before the first one that comes again."""
    path = {frame: None}
    while frame in newest and (parent := newest[frame].parent) is not None and parent not in path:
        frame = parent
        path[frame] = None
    return list(path)


def chain_between(newest: Tree, a: str, b: str) -> list[str] | None:
    """The frames from ``a`` to ``b``, both included, by their lowest common ancestor; None: not connected."""
    up, down = path_to_root(newest, a), path_to_root(newest, b)
    above = set(down)
    common = next((frame for frame in up if frame in above), None)
    if common is None:
        return None
    return [*up[: up.index(common) + 1], *reversed(down[: down.index(common)])]


def moving_on(newest: Tree, chain: Sequence[str]) -> list[str]:
    """The frames of a chain whose dynamic transforms make it up; the one at the top is none of them."""
    steps = [*zip(chain, chain[1:], strict=False), *zip(chain[1:], chain, strict=False)]
    below = [
        child
        for child, other in steps
        if child in newest and newest[child].parent == other and not newest[child].static
    ]
    return list(dict.fromkeys(below))


def stamps_on(
    records: NDArray[np.void], frames: Sequence[str], newest: Tree, chain: Sequence[str]
) -> NDArray[np.int64]:
    """
    The stamps of the dynamic transforms that make up a chain, in ns, ascending, each once.

    :param frames: names, by the ids in the records.
    """
    numbers = {name: number for number, name in enumerate(frames)}
    moving = [numbers[name] for name in moving_on(newest, chain)]
    return np.unique(_dynamic_of(records, moving)["stamp_ns"])


class NetDelay:
    """
    How old the newest transform along a chain is, over time.

    That is the time since the newest stamp for which every dynamic frame of the chain has a transform. It
    grows with the time, and falls when a transform arrives; mean and maximum are over the time.

    :param children: ids, as in the records, of the frames whose dynamic transforms make up the chain. Where
        there are none, the chain is static and has no delay.
    :param window_s: the time that the figures are about. None: all time.
    """

    def __init__(self, children: Sequence[int], window_s: float | None = None) -> None:
        self.children = list(children)
        self._window_s = window_s
        self._newest = np.full(len(self.children), NOTHING)  # stamps, of each child
        self._last_ns = 0  # when one of them was received
        self._parts: deque[tuple[int, float, float, float]] = deque()  # until when, how long, mean, maximum

    def add(self, records: NDArray[np.void]) -> None:
        """Account for records, all of them later than those before."""
        if not self.children:
            return
        for chosen in _pieces(_dynamic_of(records, self.children)):
            self._add(chosen)

    def report(self, now_ns: int) -> tuple[float, float] | None:
        """Mean and maximum, in seconds; None while there is no transform."""
        if self._window_s is not None:
            while self._parts and self._parts[0][0] < now_ns - self._window_s * S:
                self._parts.popleft()
        parts = [part[1:] for part in self._parts]
        if self.children and self._newest.min() != NOTHING and now_ns > self._last_ns:
            # Since the last transform.
            ages = (np.array([self._last_ns, now_ns]) - self._newest.min()) / S
            parts.append(((now_ns - self._last_ns) / S, float(ages.mean()), float(ages[1])))
        duration = sum(part[0] for part in parts)
        if duration <= 0.0:
            return None
        return sum(long * mean for long, mean, _ in parts) / duration, max(most for _, _, most in parts)

    def _add(self, records: NDArray[np.void]) -> None:
        received = records["received_ns"]
        stamps = np.full((len(records) + 1, len(self.children)), NOTHING)
        stamps[0] = self._newest
        is_child = records["child"][:, None] == np.array(self.children)[None, :]
        stamps[1:][is_child] = np.broadcast_to(records["stamp_ns"][:, None], is_child.shape)[is_child]
        newest = np.maximum.accumulate(stamps, axis=0)
        # From each reception to the next one, the first time from the last reception before these records.
        common = newest[:-1].min(axis=1)
        begins = np.concatenate(([self._last_ns], received[:-1]))
        known = (common != NOTHING) & (received > begins)
        self._newest, self._last_ns = newest[-1], int(received[-1])
        if not known.any():
            return
        lasts = (received - begins)[known] / S
        oldest = (received - common)[known] / S
        duration = float(lasts.sum())
        mean = float(((oldest - lasts / 2) * lasts).sum()) / duration
        self._keep(duration, mean, float(oldest.max()))

    def _keep(self, duration: float, mean: float, most: float) -> None:
        if self._parts:
            _, long, usual, worst = self._parts[-1]
            both = long + duration
            if self._window_s is None or both * SLICES < self._window_s:
                self._parts.pop()
                duration, mean, most = both, (long * usual + duration * mean) / both, max(worst, most)
        self._parts.append((self._last_ns, duration, mean, most))


def _dynamic_of(records: NDArray[np.void], children: Sequence[int]) -> NDArray[np.void]:
    # What buffers take of these frames.
    dynamic = records[np.isin(records["child"], children) & (records["static"] == 0)]
    return taken(dynamic)


def _pieces(records: NDArray[np.void]) -> Iterator[NDArray[np.void]]:
    # What is computed at once is records times frames.
    for start in range(0, len(records), EVENTS_AT_ONCE):
        yield records[start : start + EVENTS_AT_ONCE]
