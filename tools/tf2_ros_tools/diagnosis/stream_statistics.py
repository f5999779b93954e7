# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Compute figures of received transforms, without a node: streams, and the chains of frames that they form.

A stream is the transforms of one frame from one publisher, below one parent, on one topic. The input is
arrays of ``tf2_ros.records.RECORD``, in the order of arrival; their ``child``, ``parent`` and ``publisher``
are indices into lists that the caller keeps. All their times are ns of the clock of the listener; times in
figures are in seconds. Arrays are never changed. The figures do not depend on how records are
batched.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tf2_py import FrameInfo
from tf2_ros.records import RECORD, refusal_text

S = 1_000_000_000
ID_BITS = 20  # of each of the three ids of a stream; a Recording assigns no larger ones
JUMP_BACK_NS = S  # by at least this much; the same as for a buffer
SETTLING_NS = S // 2
TAIL = 10  # records of each stream that are kept beyond the window
NOTHING = np.iinfo(np.int64).min

Records = NDArray[np.void]
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Origin:
    """Where transforms come from."""

    frame: str
    parent: str
    publisher: str
    publisher_id: int
    static: bool


@dataclass(frozen=True)
class Stream(Origin):
    """
    The transforms of one frame from one publisher, below one parent, on one topic; times are in seconds.

    Transforms that every buffer refuses are left out, see :class:`Refused`. The figures are those of the
    window; ``silence``, ``stalled`` and ``period`` reach beyond it. ``rate`` is None if fewer than two
    transforms were received, and the delay of a static transform has no meaning.
    """

    count: int
    rate: float | None  # Hz
    delay: float | None  # mean time from the stamp to the reception
    delay_max: float | None
    delay_min: float | None  # negative: the stamp was in the future
    jitter: float | None  # standard deviation of the delay
    gap: float  # longest time between two transforms
    first: float  # how long ago the first one was received; 0.0 if there is none in the window
    silence: float  # since the last one
    stalled: float  # since the last stamp that was newer than all before it
    period: float | None  # usual time between two transforms, without the longest
    unnormalized: int = 0  # how many have a rotation that tf2 of ROS 2 Kilted and later refuses


@dataclass(frozen=True)
class Refused(Origin):
    """Transforms in the window, of one frame, publisher and parent, that every buffer refuses."""

    count: int
    because: str  # what is wrong with them


def taken(records: Records) -> Records:
    """The records of transforms that buffers accept, unless they are too old for a buffer."""
    chosen: Records = records[records["refusals"] == 0]
    return chosen


class Streams:
    """
    Figures of all streams, from records in the order of arrival.

    :param window_s: the period before a report over which its figures are computed. None: all time.

    It keeps the records of the window, and the last TAIL of each stream. Of the first half second of each
    publisher, it keeps only the last record of each dynamic stream: a middleware delivers what is sent
    during discovery late and together, so these delays say nothing about the robot. When the clock jumps
    back, it drops everything that was received before, except for static transforms. Reports do not depend
    on how records are batched.
    """

    def __init__(self, window_s: float | None = None) -> None:
        self._window_ns = None if window_s is None else round(window_s * S)
        self._records = np.zeros(0, RECORD)
        self._settled_ns: dict[int, int] = {}  # when the first half second of each publisher ends
        self._last_ns: int | None = None  # when the last record was received
        self._jump: tuple[int, int] | None = None  # of the clock, the last one back: from when to when

    def add(self, records: Records) -> None:
        """Account for records, which must all be later than those of earlier calls."""
        if not len(records):
            return
        received = records["received_ns"]
        previous = np.append(received[0] if self._last_ns is None else self._last_ns, received[:-1])
        jumps = np.flatnonzero(received < previous - JUMP_BACK_NS)
        self._last_ns = int(received[-1])
        if len(jumps):
            # As a buffer, which is cleared, keep only static transforms; of each stream the last one, because
            # the window may have ended before the others.
            start = jumps[-1]
            self._jump = int(previous[start]), int(received[start])
            before = np.concatenate((self._records, records[:start]))
            still = before[before["static"] != 0]
            self._records = still[_last_of_each(still)]
            # Publishers that were received before the jump are discovered.
            publishers = np.unique(before["publisher"]).tolist()
            self._settled_ns = dict.fromkeys((*self._settled_ns, *publishers), NOTHING)
            records = records[start:]
        for publisher in np.flatnonzero(np.bincount(records["publisher"])).tolist():
            if publisher not in self._settled_ns:
                first = np.argmax(records["publisher"] == publisher)
                self._settled_ns[publisher] = int(records["received_ns"][first]) + SETTLING_NS
        self._records = np.concatenate((self._records, records))
        self.kept(self._last_ns)

    def report(
        self, now_ns: int, frames: Sequence[str], publishers: Sequence[str]
    ) -> tuple[list[Stream], list[Refused]]:
        """
        Get the current streams, sorted by the names of their frames, and what is refused.

        The current streams of a frame are those in the window that no later one has replaced; if there are
        none, the last one before. A static transform is valid until its publisher replaces it.

        :param frames: names, indexed by the ids in the records.
        :param publishers: names, indexed likewise.
        """
        records = self.kept(now_ns)
        total = recent = _figures(records, now_ns, frames, publishers)
        if self._window_ns is not None:
            inside = records["received_ns"] >= now_ns - self._window_ns
            recent = _figures(records[inside], now_ns, frames, publishers)
        by_frame: dict[str, list[Stream]] = {}
        for key, one in total[0].items():
            by_frame.setdefault(one.frame, []).append(_in_window(one, recent[0].get(key)))
        streams = [one for own in by_frame.values() for one in _current(own)]
        # A static transform is refused by whoever subscribes later, too.
        refused = [recent[1].get(key, one) for key, one in total[1].items() if one.static or key in recent[1]]
        return (
            sorted(streams, key=lambda one: (one.frame, one.silence)),
            sorted(refused, key=lambda one: (one.frame, one.publisher, one.parent, one.static)),
        )

    def jump_back(self, now_ns: int) -> float | None:
        """How far the clock last jumped back in the window, in seconds; None: it did not."""
        if self._jump is None:
            return None
        before_ns, after_ns = self._jump
        is_over = self._window_ns is not None and after_ns < now_ns - self._window_ns
        return None if is_over else (before_ns - after_ns) / S

    def net_delay(self, children: Sequence[int], now_ns: int) -> tuple[float, float] | None:
        """
        How old the newest transform along a chain is: its mean and maximum over the window, in seconds.

        That is the time since the newest stamp for which every dynamic frame of the chain has a transform. It
        grows with the time, and falls when a transform arrives.

        :param children: ids, as in the records, of the frames whose dynamic transforms make up the chain.
        :return: None where the chain is static, or a frame of it has no transform.
        """
        own = _dynamic_of(self.kept(now_ns), children)
        if not len(own):
            return None
        common = np.full(len(own), np.iinfo(np.int64).max)
        for child in children:
            stamps = np.where(own["child"] == child, own["stamp_ns"], NOTHING)
            common = np.minimum(common, np.maximum.accumulate(stamps))
        # From each reception to the next one.
        begin_ns = NOTHING if self._window_ns is None else now_ns - self._window_ns
        begins = np.maximum(own["received_ns"], begin_ns)
        ends = np.append(own["received_ns"][1:], now_ns)
        known = (common != NOTHING) & (ends > begins)
        if not known.any():
            return None
        lasts = (ends - begins)[known] / S
        oldest = (ends - common)[known] / S
        return float(((oldest - lasts / 2) * lasts).sum() / lasts.sum()), float(oldest.max())

    def kept(self, now_ns: int) -> Records:
        """Get the records that reports at this time, or later, need; drop the others."""
        records = self._records
        needed = self._is_settled(records)
        if self._window_ns is not None:
            places = np.flatnonzero(needed)
            needed[places] = _is_needed(records[places], now_ns - self._window_ns)
        if not needed.all():
            self._records = records[needed]
        return self._records

    def _is_settled(self, records: Records) -> Mask:
        """Which records count: the last one of each stream, and those after a first half second."""
        ends_ns = [self._settled_ns.get(one, NOTHING) for one in range(max(self._settled_ns, default=0) + 1)]
        early = records["received_ns"] < np.array(ends_ns, np.int64)[records["publisher"]]
        # The delays of static and of refused transforms have no meaning.
        places = np.flatnonzero(early & (records["static"] == 0) & (records["refusals"] == 0))
        settled = np.ones(len(records), np.bool_)
        settled[places] = False
        settled[places[_last_of_each(records[places])]] = True
        return settled


def _keys(records: Records) -> NDArray[np.int64]:
    keys: NDArray[np.int64] = records["child"].astype(np.int64)
    for part, bits in (("parent", ID_BITS), ("publisher", ID_BITS), ("static", 1)):
        keys = keys << bits | records[part]
    keys = keys << 1 | (records["refusals"] != 0)
    return keys


def _last_of_each(records: Records) -> NDArray[np.intp]:
    """Where the last record of each key is, in the order of the records."""
    _, from_end = np.unique(_keys(records)[::-1], return_index=True)
    found: NDArray[np.intp] = np.sort(len(records) - 1 - from_end)
    return found


def _grouped(records: Records) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.intp]]:
    """Sort records by their keys; return where each was, and where those of each key begin and end."""
    keys = _keys(records)
    order = np.argsort(keys, kind="stable")
    edges = np.flatnonzero(np.diff(keys[order])) + 1
    return order, np.append(0, edges), np.append(edges, len(records))


def _is_needed(records: Records, begin_ns: int) -> Mask:
    """Which records a report needs: the window, and the last ones of each stream."""
    needed: Mask = records["received_ns"] >= begin_ns
    if needed.all():
        return needed
    order, starts, ends = _grouped(records)
    from_end = np.repeat(ends, ends - starts) - np.arange(len(records))
    needed[order[from_end <= TAIL]] = True
    return needed


def _first_newest(stamps: NDArray[np.int64], starts: NDArray[np.intp]) -> NDArray[np.intp]:
    """The index of the newest stamp of each group, which is the first one if there are several."""
    newest = np.repeat(np.maximum.reduceat(stamps, starts), np.diff(np.append(starts, len(stamps))))
    places = np.where(stamps == newest, np.arange(len(stamps)), len(stamps))
    found: NDArray[np.intp] = np.minimum.reduceat(places, starts)
    return found


def _figures(
    records: Records, now_ns: int, frames: Sequence[str], publishers: Sequence[str]
) -> tuple[dict[int, Stream], dict[int, Refused]]:
    """Compute the figures of each key, in the order of the keys, over all of these records."""
    streams: dict[int, Stream] = {}
    refused: dict[int, Refused] = {}
    if not len(records):
        return streams, refused
    order, starts, ends = _grouped(records)
    ordered, counts = records[order], ends - starts
    received, heads = ordered["received_ns"], ordered[starts]
    begins, lasts = received[starts], received[ends - 1]
    spans, advanced = lasts - begins, received[_first_newest(ordered["stamp_ns"], starts)]
    intervals = np.diff(received, prepend=received[:1])
    intervals[starts] = 0
    gaps = np.maximum.reduceat(intervals, starts)
    # Without the longest interval, because a gap among a few intervals would hide itself.
    periods = np.where(counts > 2, (spans - gaps) / np.maximum(counts - 2, 1), spans) / S
    delays = (received - ordered["stamp_ns"]) / S
    means = np.add.reduceat(delays, starts) / counts
    squares = np.add.reduceat((delays - np.repeat(means, counts)) ** 2, starts)
    most, least = np.maximum.reduceat(delays, starts), np.minimum.reduceat(delays, starts)
    moving, unknown = heads["static"] == 0, np.array(None)
    columns: tuple[Any, ...] = (  # the fields of Stream, from count on
        counts,
        np.where(spans > 0, (counts - 1) * S / np.maximum(spans, 1), unknown),
        *(np.where(moving, one, unknown) for one in (means, most, least, np.sqrt(squares / counts))),
        gaps / S,
        *((now_ns - one) / S for one in (begins, lasts, advanced)),
        np.where(counts > 1, periods, unknown),
        np.add.reduceat(ordered["unnormalized"].astype(np.int64), starts),
    )
    keys, refusals = _keys(heads).tolist(), np.bitwise_or.reduceat(ordered["refusals"], starts).tolist()
    ids: list[tuple[int, int, int, int]] = heads[["child", "parent", "publisher", "static"]].tolist()
    rows = zip(*(column.tolist() for column in columns), strict=True)
    for key, (child, parent, number, static), why, row in zip(keys, ids, refusals, rows, strict=True):
        origin = (frames[child], frames[parent], publishers[number], number, static != 0)
        if why:
            refused[key] = Refused(*origin, row[0], refusal_text(why))
        else:
            streams[key] = Stream(*origin, *row)
    return streams, refused


def _in_window(total: Stream, recent: Stream | None) -> Stream:
    """Join the figures of a stream in the window with those that reach beyond it."""
    if recent is None:
        # A static transform is received by whoever subscribes later, too.
        unnormalized = total.unnormalized if total.static else 0
        return replace(
            without_delays(total), count=0, rate=None, gap=0.0, first=0.0, unnormalized=unnormalized
        )
    period = recent.period if recent.count >= 3 else total.period
    return replace(recent, silence=total.silence, stalled=total.stalled, period=period)


def without_delays(stream: Stream) -> Stream:
    """The same, with unknown delays."""
    return replace(stream, delay=None, delay_max=None, delay_min=None, jitter=None)


def _current(own: Sequence[Stream]) -> list[Stream]:
    """Choose the streams of a frame that no later one has replaced."""
    by_age = sorted(own, key=lambda one: one.silence, reverse=True)
    static = {one.publisher_id: one for one in by_age if one.static}
    moving = [one for one in by_age if not one.static]
    shown = [one for one in moving if one.count > 0]
    # A stream that ended before another began was replaced, by a restart or by another parent.
    newest = min((one.first for one in shown), default=0.0)
    current = [one for one in shown if one.silence < newest or one.first == newest]
    return [*static.values(), *current] or moving[-1:]


def _dynamic_of(records: Records, children: Sequence[int]) -> Records:
    """The dynamic transforms of these frames that buffers accept."""
    return taken(records[np.isin(records["child"], children) & (records["static"] == 0)])


Tree = Mapping[str, Stream | FrameInfo]  # by the names of the frames


def newest_streams(streams: Iterable[Stream]) -> dict[str, Stream]:
    """For each frame, the stream that was received last, from which a buffer answers."""
    newest: dict[str, Stream] = {}
    for stream in streams:
        known = newest.get(stream.frame)
        if known is None or stream.silence < known.silence:
            newest[stream.frame] = stream
    return newest


def path_to_root(newest: Tree, frame: str) -> list[str]:
    """A frame and its ancestors; in a loop, up to the last frame before one is repeated."""
    path = {frame: None}
    while frame in newest and (parent := newest[frame].parent) is not None and parent not in path:
        frame = parent
        path[frame] = None
    return list(path)


def moving_on(newest: Tree, chain: Sequence[str]) -> list[str]:
    """The frames of a chain whose dynamic transforms make it up; the topmost frame is not one of them."""
    moving = (name for name in chain if name in newest and not newest[name].static)
    return [name for name in moving if newest[name].parent in chain]


def stamps_of(records: Records, frames: Sequence[str], frame: str) -> NDArray[np.int64]:
    """
    The stamps of the dynamic transforms of a frame, in ns, ascending, each once.

    :param frames: names, by the ids in the records.
    """
    return np.unique(_dynamic_of(records, [frames.index(frame)])["stamp_ns"])
