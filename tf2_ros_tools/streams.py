"""
Compute figures of received transforms, without a node: streams, and the chains of frames that they form.

A stream is the transforms of one frame from one publisher, below one parent, on one topic. The input is
arrays of ``tf2_ros.records.RECORD``, in the order of arrival; their ``child``, ``parent`` and ``publisher``
are indices into lists that the caller keeps. All their times are ns of the clock of the listener; times in
figures are in seconds. Arrays are never changed. The figures do not depend on how records are
batched.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from tf2_ros.records import RECORD, refusal_text
from tf2_ros_tools.output import not_known

S = 1_000_000_000
ID_BITS = 20  # of each of the three ids of a stream; a Recording assigns no larger ones
JUMP_BACK_NS = S  # by at least this much; the same as for a buffer
LEFT_OVER_NS = S  # for this long after a jump, transforms that were sent before it may arrive
SETTLING_NS = S // 2
TAIL = 10  # records of each stream that are kept beyond the window
PIECES = 64  # batches that are kept before they are joined
NOTHING = np.iinfo(np.int64).min

NO_RECORDS = np.zeros(0, RECORD)

Records = NDArray[np.void]
Mask = NDArray[np.bool_]


class _Key(NamedTuple):
    """Which transforms are counted together; the ids are those in the records."""

    child: int
    parent: int
    publisher: int
    static: bool
    refused: bool


class _Tally(NamedTuple):
    """The transforms of a key over some time."""

    size: int  # how many
    first_ns: int  # when its first transform was received
    last_ns: int
    gap_ns: int  # the longest time between two transforms
    advanced_ns: int  # when the newest stamp was first received
    delay: float  # their mean, in seconds
    jitter: float  # their standard deviation
    least: float
    most: float
    refusals: int  # why every buffer refuses some of them, see refusal_text


Tallies = Mapping[_Key, _Tally]


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


@dataclass(frozen=True)
class Refused(Origin):
    """Transforms in the window, of one frame, publisher and parent, that every buffer refuses."""

    count: int  # how many transforms are refused ...
    received: int  # ... of how many of the frame and publisher, below any parent
    because: str  # what is wrong with them


class Reported(NamedTuple):
    """All that is known at one moment."""

    streams: list[Stream]
    refused: list[Refused]


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
        self._early = NO_RECORDS  # those that are kept of the first half seconds
        self._pieces: list[Records] = []  # the others
        self._settled_ns: dict[int, int] = {}  # when the first half second of each publisher ends
        self._last_ns: int | None = None  # when the last record was received
        self._jump: tuple[int, int] | None = None  # of the clock, the last one back: from when to when

    def add(self, records: Records) -> None:
        """Account for records, which must all be later than those of earlier calls."""
        if not len(records):
            return
        received = records["received_ns"]
        before_ns = received[0] if self._last_ns is None else self._last_ns
        previous = np.concatenate(([before_ns], received[:-1]))
        jumps = np.flatnonzero(received < previous - JUMP_BACK_NS)
        if len(jumps):
            # As a buffer, which is cleared, keep only static transforms.
            start = jumps[-1]
            self._jump = int(previous[start]), int(received[start])
            before = np.concatenate((*self._pieces, records[:start]))
            self._early, self._pieces = NO_RECORDS, [before[before["static"] != 0]]
            # Publishers that were received before the jump are discovered.
            publishers = np.unique(before["publisher"]).tolist()
            self._settled_ns = dict.fromkeys((*self._settled_ns, *publishers), NOTHING)
            records = records[start:]
        self._last_ns = int(received[-1])
        early = self._is_early(records)
        if self._jump is not None:
            stays = ~_left_over(records, *self._jump)
            records, early = records[stays], early[stays]
        if early.any():
            self._early = last_of_each(np.concatenate((self._early, records[early])))
            records = records[~early]
        self._pieces.append(records)
        if len(self._pieces) >= PIECES:
            self.kept(self._last_ns)

    def _is_early(self, records: Records) -> Mask:
        """Which dynamic records are of the first half second of their publishers."""
        publishers, received = records["publisher"], records["received_ns"]
        present = np.flatnonzero(np.bincount(publishers))
        settled_ns = np.zeros(present[-1] + 1, np.int64)
        for publisher in present.tolist():
            if publisher not in self._settled_ns:
                first = np.argmax(publishers == publisher)
                self._settled_ns[publisher] = int(received[first]) + SETTLING_NS
            settled_ns[publisher] = self._settled_ns[publisher]
        if received.min() >= settled_ns.max():
            return np.zeros(len(records), np.bool_)
        # The delays of static and of refused transforms have no meaning.
        counts = (records["static"] == 0) & (records["refusals"] == 0)
        early: Mask = counts & (received < settled_ns[publishers])
        return early

    def report(self, now_ns: int, frames: Sequence[str], publishers: Sequence[str]) -> Reported:
        """
        Get the current streams, sorted by the names of their frames, and what is refused.

        The current streams of a frame are those in the window that no later one has replaced; if there are
        none, the last one before. A static transform is valid until its publisher replaces it.

        :param frames: names, indexed by the ids in the records.
        :param publishers: names, indexed likewise.
        """
        records = self.kept(now_ns)
        total = tallies(records)
        recent = total
        if self._window_ns is not None:
            recent = tallies(records[records["received_ns"] >= now_ns - self._window_ns])
        by_frame: dict[int, list[_Key]] = {}
        for key in total:
            if not key.refused:
                by_frame.setdefault(key.child, []).append(key)
        streams = [
            _stream(key, total[key], recent.get(key), now_ns, frames, publishers)
            for keys in by_frame.values()
            for key in _current(keys, total, recent)
        ]
        refused = _refused(total, recent, frames, publishers)
        return Reported(
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
        own = own[np.argsort(own["received_ns"], kind="stable")]
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
        """Join the records that reports at this time, or later, need; of each stream, in their order."""
        records = np.concatenate((self._early, *self._pieces))
        needed = np.ones(len(records), np.bool_)
        if self._window_ns is not None:
            needed = _needed(records, now_ns - self._window_ns)
        if not needed.all():
            self._early, records = self._early[needed[: len(self._early)]], records[needed]
        self._pieces = [records[len(self._early) :]]
        return records


def _left_over(records: Records, before_ns: int, after_ns: int) -> Mask:
    """Which records were sent before the clock jumped back, and received just after that."""
    received, stamps = records["received_ns"], records["stamp_ns"]
    late: Mask = (received < after_ns + LEFT_OVER_NS) & (records["static"] == 0)
    return late & (stamps > received + JUMP_BACK_NS) & (stamps <= before_ns + JUMP_BACK_NS)


def _keys(records: Records) -> NDArray[np.int64]:
    keys: NDArray[np.int64] = records["child"].astype(np.int64)
    for part, bits in (("parent", ID_BITS), ("publisher", ID_BITS), ("static", 1)):
        keys = keys << bits | records[part]
    keys = keys << 1 | (records["refusals"] != 0)
    return keys


def last_of_each(records: Records) -> Records:
    """The last record of each stream."""
    _, last = np.unique(_keys(records)[::-1], return_index=True)
    return records[np.sort(len(records) - 1 - last)]


def _grouped(records: Records) -> tuple[Records, NDArray[np.intp], NDArray[np.intp]]:
    """Sort records by their keys; return them, where each was, and the index of the first one of each key."""
    keys = _keys(records)
    order = np.argsort(keys, kind="stable")
    keys = keys[order]
    return records[order], order, np.flatnonzero(np.concatenate(([True], keys[1:] != keys[:-1])))


def _needed(records: Records, begin_ns: int) -> Mask:
    """Which records a report needs: the window, and the last ones and the newest stamp of each stream."""
    needed: Mask = records["received_ns"] >= begin_ns
    if needed.all():
        return needed
    ordered, order, starts = _grouped(records)
    ends = np.append(starts[1:], len(records))
    from_end = np.repeat(ends, ends - starts) - np.arange(len(records))
    needed[order[from_end <= TAIL]] = True
    needed[order[_first_newest(ordered["stamp_ns"], starts)]] = True
    return needed


def _first_newest(stamps: NDArray[np.int64], starts: NDArray[np.intp]) -> NDArray[np.intp]:
    """The index of the newest stamp of each group, which is the first one if there are several."""
    newest = np.repeat(np.maximum.reduceat(stamps, starts), np.diff(np.append(starts, len(stamps))))
    places = np.where(stamps == newest, np.arange(len(stamps)), len(stamps))
    found: NDArray[np.intp] = np.minimum.reduceat(places, starts)
    return found


def tallies(records: Records) -> Tallies:
    """Compute the figures of each key, in the order of the keys."""
    if not len(records):
        return {}
    ordered, _, starts = _grouped(records)
    received, stamps = ordered["received_ns"], ordered["stamp_ns"]
    ends = np.append(starts[1:], len(received))
    counts = ends - starts
    intervals = np.diff(received, prepend=received[:1])
    intervals[starts] = 0
    delays = (received - stamps) / S
    means = np.add.reduceat(delays, starts) / counts
    squares = np.add.reduceat((delays - np.repeat(means, counts)) ** 2, starts)
    columns = (
        counts,
        received[starts],
        received[ends - 1],
        np.maximum.reduceat(intervals, starts),
        received[_first_newest(stamps, starts)],
        means,
        np.sqrt(squares / counts),
        np.minimum.reduceat(delays, starts),
        np.maximum.reduceat(delays, starts),
        np.bitwise_or.reduceat(ordered["refusals"], starts),
    )
    firsts = ordered[starts]
    parts = [firsts[name].tolist() for name in ("child", "parent", "publisher")]
    flags = [(firsts[name] != 0).tolist() for name in ("static", "refusals")]
    keys = map(_Key, *parts, *flags)
    return dict(zip(keys, map(_Tally, *(column.tolist() for column in columns)), strict=True))


def _current(keys: Sequence[_Key], total: Tallies, recent: Tallies) -> list[_Key]:
    by_age = sorted(keys, key=lambda key: total[key].last_ns)
    static = {key.publisher: key for key in by_age if key.static}
    moving = [key for key in by_age if not key.static]
    heard = [key for key in moving if key in recent]
    # A stream that ended before another began was replaced, by a restart or by another parent.
    newest_ns = max((recent[key].first_ns for key in heard), default=0)
    current = [key for key in heard if recent[key].last_ns > newest_ns or recent[key].first_ns == newest_ns]
    return [*static.values(), *current] or moving[-1:]


def _refused(
    total: Tallies, recent: Tallies, frames: Sequence[str], publishers: Sequence[str]
) -> Iterator[Refused]:
    """Refused transforms in the window, and static ones that their publishers have not replaced since."""
    shown = {key: found for key in total if (found := (total if key.static else recent).get(key))}
    received: Counter[tuple[int, int, bool]] = Counter()
    taken_ns: dict[tuple[int, int], int] = {}  # when each publisher's last static one was accepted
    for key, tally in shown.items():
        received[key.child, key.publisher, key.static] += tally.size
        if key.static and not key.refused:
            whose = key.child, key.publisher
            taken_ns[whose] = max(tally.last_ns, taken_ns.get(whose, 0))
    for key, tally in shown.items():
        is_replaced = key.static and tally.last_ns < taken_ns.get((key.child, key.publisher), 0)
        if key.refused and not is_replaced:
            yield Refused(
                **_origin(key, frames, publishers),
                count=tally.size,
                received=received[key.child, key.publisher, key.static],
                because=refusal_text(tally.refusals),
            )


def _origin(key: _Key, frames: Sequence[str], publishers: Sequence[str]) -> dict[str, Any]:
    """The fields of an ``Origin``."""
    return {
        "frame": frames[key.child],
        "parent": frames[key.parent],
        "publisher": publishers[key.publisher],
        "publisher_id": key.publisher,
        "static": key.static,
    }


def _stream(
    key: _Key,
    total: _Tally,
    recent: _Tally | None,
    now_ns: int,
    frames: Sequence[str],
    publishers: Sequence[str],
) -> Stream:
    origin = _origin(key, frames, publishers)
    own = _Tally(0, now_ns, now_ns, 0, 0, 0.0, 0.0, 0.0, 0.0, 0) if recent is None else recent
    timed = own.size > 0 and not key.static
    span_ns = own.last_ns - own.first_ns
    return Stream(
        **origin,
        count=own.size,
        rate=(own.size - 1) * S / span_ns if span_ns > 0 else None,
        delay=own.delay if timed else None,
        delay_max=own.most if timed else None,
        delay_min=own.least if timed else None,
        jitter=own.jitter if timed else None,
        gap=own.gap_ns / S,
        first=(now_ns - own.first_ns) / S,
        silence=(now_ns - total.last_ns) / S,
        stalled=(now_ns - total.advanced_ns) / S,
        period=_period(own if own.size >= 3 else total),
    )


def _period(tally: _Tally) -> float | None:
    if tally.size < 2:
        return None
    span_ns = tally.last_ns - tally.first_ns
    # Without the longest interval, because a gap among a few intervals would hide itself.
    return span_ns / S if tally.size == 2 else (span_ns - tally.gap_ns) / (tally.size - 2) / S


def _dynamic_of(records: Records, children: Sequence[int]) -> Records:
    """The dynamic transforms of these frames that buffers accept."""
    return taken(records[np.isin(records["child"], children) & (records["static"] == 0)])


class Below(Protocol):
    """What a tree must know about a frame; both ``Stream`` and ``tf2_py.FrameInfo`` do."""

    @property
    def parent(self) -> str | None: ...
    @property
    def static(self) -> bool: ...


Tree = Mapping[str, Below]  # by the names of the frames


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


def chain_between(newest: Tree, a: str, b: str) -> list[str] | None:
    """The frames from ``a`` to ``b``, both included, by their lowest common ancestor; None: not connected."""
    up, down = path_to_root(newest, a), path_to_root(newest, b)
    above = set(down)
    common = next((frame for frame in up if frame in above), None)
    if common is None:
        return None
    return [*up[: up.index(common) + 1], *reversed(down[: down.index(common)])]


def unknown_ends(newest: Iterable[Stream], ends: Iterable[str]) -> list[str]:
    """A text for each of these frames that occurs in no stream."""
    known = {name for one in newest for name in (one.frame, one.parent)}
    return [not_known(name, known) for name in ends if name not in known]


def moving_on(newest: Tree, chain: Sequence[str]) -> list[str]:
    """The frames of a chain whose dynamic transforms make it up; the topmost frame is not one of them."""
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
