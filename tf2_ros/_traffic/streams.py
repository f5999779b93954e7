"""Owns the figures of each stream: the transforms of one frame from one publisher, below one parent."""

from collections import Counter, deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from tf2_py._internal import log
from tf2_ros._traffic.settling import replaced

__all__ = ["SLICES", "Refused", "Reported", "Stream", "Streams", "taken"]

S = 1_000_000_000
ID_BITS = 20  # of the three ids of a stream; no Recording gives more of them
JUMP_BACK_NS = S  # from so far on the clock has jumped back, as for a buffer
SLICES = 1000  # of a window: shorter pieces are merged, so that a long window needs no more memory

Records = NDArray[np.void]

# What is known of a stream over some time. Two of them, of two times, can be merged into that of both.
TALLY = np.dtype(
    [
        ("count", np.int64),
        ("first_ns", np.int64),  # when its first transform was received
        ("last_ns", np.int64),
        ("gap_ns", np.int64),  # the longest time between two transforms
        ("newest_ns", np.int64),  # the newest stamp
        ("advanced_ns", np.int64),  # when that was first received
        ("mean", np.float64),  # of the delays, in seconds
        ("square", np.float64),  # the sum of the squares of their distances from the mean
        ("least", np.float64),
        ("most", np.float64),
        ("refusals", np.int64),  # for what every buffer refuses some: bits of log.REFUSALS
        ("early", np.bool_),  # whether its first transform was early; see ``Settling``
    ]
)


class _Key(NamedTuple):
    """Which transforms are counted together; the ids are those of the records."""

    child: int
    parent: int
    publisher: int
    static: bool
    refused: bool


@dataclass(frozen=True)
class Origin:
    """Of what, and from whom, transforms are."""

    frame: str
    parent: str
    publisher: str
    publisher_id: int
    static: bool


@dataclass(frozen=True)
class Stream(Origin):
    """
    The transforms of one frame from one publisher, below one parent, on one topic; times are in seconds.

    Those that every buffer refuses are none of them, see :class:`Refused`. The figures are those of the
    window; ``silence``, ``stalled`` and ``period`` reach beyond it. ``rate`` is None where fewer than two
    transforms were received, and the delay of a static transform means nothing.
    """

    count: int
    rate: float | None  # Hz
    delay: float | None  # mean time from the stamp to the reception
    delay_max: float | None
    delay_min: float | None  # negative: the stamp was in the future
    jitter: float | None  # standard deviation of the delay
    gap: float  # longest time between two transforms
    first: float  # how long ago the first one was received; 0.0 where there is none in the window
    silence: float  # since the last one
    stalled: float  # since a stamp that was newer than all before
    period: float | None  # usual time between two transforms, without the longest


@dataclass(frozen=True)
class Refused(Origin):
    """What every buffer refuses of one frame from one publisher, below one parent, in the window."""

    count: int  # how many transforms are refused ...
    received: int  # ... of so many of the frame and publisher, below any parent
    because: str  # what is wrong with them


class Reported(NamedTuple):
    """What there is to tell at one moment."""

    streams: list[Stream]
    refused: list[Refused]


def taken(records: Records) -> Records:
    """The records of transforms that buffers take, unless these are too old for one."""
    chosen: Records = records[records["refusals"] == 0]
    return chosen


class Streams:
    """
    Figures of all streams, from records in the order of arrival.

    :param window_s: the time that figures are about, until the time of the report. None: all time.

    When the clock jumps back, what was received before is forgotten, except static transforms.

    Reports do not depend on how the records are cut into batches, except that a window is longer by up to the
    time of one batch.
    """

    def __init__(self, window_s: float | None = None) -> None:
        self._window_ns = None if window_s is None else round(window_s * S)
        # What is refused of a stream is counted as another one, whose key has the lowest bit.
        self._numbers: dict[int, int] = {}  # of the streams, by their keys
        self._keys: list[_Key] = []  # by number
        self._total = np.zeros(0, TALLY)
        self._recent: deque[NDArray[np.void]] = deque()  # one for each call of add
        self._last_ns: int | None = None  # when the last record was received

    def add(self, records: Records, early: NDArray[np.bool_] | None = None) -> None:
        """
        Account for records, all of them later than those before.

        :param early: which of them replace what was received of their streams before, as
            ``Settling.early`` gives it. None: none of them.
        """
        if not len(records):
            return
        early = np.zeros(len(records), np.bool_) if early is None else early
        start = self._forget_before_jump(records)
        records, early = records[start:], early[start:]
        kept = ~replaced(records, early)
        tally = self._tally(records[kept], early[kept])
        self._total = merge(self._total, tally)
        if self._window_ns is not None:
            self._keep(tally, self._window_ns)

    def report(self, now_ns: int, frames: Sequence[str], publishers: Sequence[str]) -> Reported:
        """
        The streams that are current, by the names of their frames, and what is refused.

        Of each frame, those received in the window that no later one has replaced; where there is none, the
        last one before. A static transform holds until its publisher replaces it.

        :param frames: names, by the ids in the records.
        :param publishers: likewise.
        """
        tally = self._windowed(now_ns)
        current: list[int] = []
        for numbers in self._by_frame().values():
            current += self._current(numbers, tally)
        streams = [self._stream(number, tally, now_ns, frames, publishers) for number in current]
        refused = self._refused(tally, frames, publishers)
        return Reported(
            sorted(streams, key=lambda one: (one.frame, one.silence)),
            sorted(refused, key=lambda one: (one.frame, one.publisher, one.parent, one.static)),
        )

    def _keep(self, tally: NDArray[np.void], window_ns: int) -> None:
        if self._recent:
            begin_ns = self._recent[-1]["first_ns"][self._recent[-1]["count"] > 0].min()
            if int(tally["last_ns"].max() - begin_ns) * SLICES < window_ns:
                tally = merge(self._recent.pop(), tally)
        self._recent.append(tally)

    def _forget_before_jump(self, records: Records) -> int:
        """Forget what was received before the clock last jumped back; return the index of the first after."""
        received = records["received_ns"]
        before = received[0] if self._last_ns is None else self._last_ns
        self._last_ns = int(received[-1])
        previous = np.concatenate(([before], received[:-1]))
        jumps = np.flatnonzero(received < previous - JUMP_BACK_NS)
        if not len(jumps):
            return 0
        # Static transforms before the jump are accounted for; the rest is as in a cleared buffer.
        start = int(jumps[-1])
        earlier = records[:start]
        static = earlier[earlier["static"] != 0]
        if len(static):
            self._total = merge(self._total, self._tally(static, np.zeros(len(static), np.bool_)))
        moving = [number for number, key in enumerate(self._keys) if not key.static]
        self._total["count"][[number for number in moving if number < len(self._total)]] = 0
        self._recent.clear()
        return start

    def _tally(self, records: Records, early: NDArray[np.bool_]) -> NDArray[np.void]:
        keys = records["child"].astype(np.int64)
        for part, bits in (("parent", ID_BITS), ("publisher", ID_BITS), ("static", 1)):
            keys = keys << bits | records[part]
        keys = keys << 1 | (records["refusals"] != 0)
        order = np.argsort(keys, kind="stable")
        keys, records = keys[order], records[order]
        starts = np.flatnonzero(np.concatenate(([True], keys[1:] != keys[:-1])))
        numbers = self._numbers_of(keys[starts], records[starts])
        tally = np.zeros(len(self._keys), TALLY)
        tally[numbers] = tally_of(records["received_ns"], records["stamp_ns"], starts)
        tally["early"][numbers] = early[order[starts]]
        tally["refusals"][numbers] = np.bitwise_or.reduceat(records["refusals"], starts)
        return tally

    def _numbers_of(self, keys: NDArray[np.int64], records: Records) -> list[int]:
        numbers = []
        for key, record in zip(keys.tolist(), records, strict=True):
            number = self._numbers.get(key)
            if number is None:
                number = self._numbers[key] = len(self._keys)
                child, parent, publisher = (int(record[part]) for part in ("child", "parent", "publisher"))
                static, refused = (bool(record[part]) for part in ("static", "refusals"))
                self._keys.append(_Key(child, parent, publisher, static, refused))
            numbers.append(number)
        return numbers

    def _windowed(self, now_ns: int) -> NDArray[np.void]:
        if self._window_ns is None:
            return self._total
        begin_ns = now_ns - self._window_ns
        while self._recent and self._recent[0]["last_ns"].max() < begin_ns:
            self._recent.popleft()
        tally = np.zeros(len(self._keys), TALLY)
        for one in self._recent:
            tally = merge(tally, one)
        return tally

    def _by_frame(self) -> dict[int, list[int]]:
        streams: dict[int, list[int]] = {}
        # By their keys, which decide between streams that were received at one time: numbers follow batches.
        for number in sorted(np.flatnonzero(self._total["count"]).tolist(), key=self._keys.__getitem__):
            if not self._keys[number].refused:
                streams.setdefault(self._keys[number].child, []).append(number)
        return streams

    def _refused(
        self, tally: NDArray[np.void], frames: Sequence[str], publishers: Sequence[str]
    ) -> Iterator[Refused]:
        """What is refused in the window; of static ones, what their publishers have not replaced since."""
        if not any(key.refused for key in self._keys):
            return
        received: Counter[tuple[int, int, bool]] = Counter()
        taken_ns: dict[tuple[int, int], int] = {}  # when each publisher's last static one was taken
        moving, total, last_ns = (
            some.tolist() for some in (tally["count"], self._total["count"], self._total["last_ns"])
        )
        for number, (child, _, publisher, static, refused) in enumerate(self._keys):
            received[child, publisher, static] += total[number] if static else moving[number]
            if static and not refused:
                taken_ns[child, publisher] = max(last_ns[number], taken_ns.get((child, publisher), 0))
        for number, (child, _, publisher, static, refused) in enumerate(self._keys):
            count = total[number] if static else moving[number]
            if not refused or not count or (static and last_ns[number] < taken_ns.get((child, publisher), 0)):
                continue
            because = (self._total if static else tally)[number]["refusals"]
            yield Refused(
                **self._origin(number, frames, publishers),
                count=count,
                received=received[child, publisher, static],
                because=log.because(int(because)),
            )

    def _origin(self, number: int, frames: Sequence[str], publishers: Sequence[str]) -> dict[str, Any]:
        """The fields of an ``Origin``."""
        key = self._keys[number]
        return {
            "frame": frames[key.child],
            "parent": frames[key.parent],
            "publisher": publishers[key.publisher],
            "publisher_id": key.publisher,
            "static": key.static,
        }

    def _current(self, numbers: list[int], tally: NDArray[np.void]) -> list[int]:
        by_age = sorted(numbers, key=lambda number: int(self._total[number]["last_ns"]))
        static = {self._keys[number].publisher: number for number in by_age if self._keys[number].static}
        moving = [number for number in by_age if not self._keys[number].static]
        heard = [number for number in moving if tally[number]["count"]]
        # One that ended before another began was replaced: by a restart, or by the choice of another parent.
        newest_start_ns = max((int(tally[number]["first_ns"]) for number in heard), default=0)
        current = [
            number
            for number in heard
            if tally[number]["last_ns"] > newest_start_ns or tally[number]["first_ns"] == newest_start_ns
        ]
        return [*static.values(), *current] or moving[-1:]

    def _stream(
        self,
        number: int,
        tally: NDArray[np.void],
        now_ns: int,
        frames: Sequence[str],
        publishers: Sequence[str],
    ) -> Stream:
        own: Any = tally[number].tolist()
        count, first_ns, last_ns, gap_ns, _, _, mean, square, least, most, _, _ = own
        total = self._total[number]
        timed = count > 0 and not self._keys[number].static
        span_ns = last_ns - first_ns
        return Stream(
            **self._origin(number, frames, publishers),
            count=count,
            rate=(count - 1) * S / span_ns if span_ns > 0 else None,
            delay=mean if timed else None,
            delay_max=most if timed else None,
            delay_min=least if timed else None,
            jitter=float(np.sqrt(square / count)) if timed else None,
            gap=gap_ns / S,
            first=(now_ns - first_ns) / S if count else 0.0,
            silence=(now_ns - int(total["last_ns"])) / S,
            stalled=(now_ns - int(total["advanced_ns"])) / S,
            period=_period(own if count >= 3 else total.tolist()),
        )


def _period(tally: Any) -> float | None:
    count, first_ns, last_ns, gap_ns, *_ = tally
    if count < 2:
        return None
    # Without the longest interval, which would hide itself among a few others.
    if count == 2:
        return float(last_ns - first_ns) / S
    return float(last_ns - first_ns - gap_ns) / float(count - 2) / S


def tally_of(
    received: NDArray[np.int64], stamps: NDArray[np.int64], starts: NDArray[np.intp]
) -> NDArray[np.void]:
    """
    The tallies of groups of transforms that lie one after the other.

    :param received: when each was received, in ns, in order within each group.
    :param stamps: in ns.
    :param starts: index of the first one of each group.
    """
    ends = np.append(starts[1:], len(received))
    counts = ends - starts
    tally = np.zeros(len(starts), TALLY)
    tally["count"] = counts
    tally["first_ns"], tally["last_ns"] = received[starts], received[ends - 1]
    intervals = np.diff(received, prepend=received[:1])
    intervals[starts] = 0
    tally["gap_ns"] = np.maximum.reduceat(intervals, starts)
    tally["newest_ns"] = newest = np.maximum.reduceat(stamps, starts)
    is_newest = stamps == np.repeat(newest, counts)
    first_newest = np.minimum.reduceat(np.where(is_newest, np.arange(len(stamps)), len(stamps)), starts)
    tally["advanced_ns"] = received[first_newest]
    delays = (received - stamps) / S
    tally["mean"] = means = np.add.reduceat(delays, starts) / counts
    tally["square"] = np.add.reduceat((delays - np.repeat(means, counts)) ** 2, starts)
    tally["least"] = np.minimum.reduceat(delays, starts)
    tally["most"] = np.maximum.reduceat(delays, starts)
    return tally


def merge(earlier: NDArray[np.void], later: NDArray[np.void]) -> NDArray[np.void]:
    """
    The tallies of two times, one after the other, by the numbers of the streams.

    One that begins with an early transform replaces the earlier one, whose transforms are all early.

    Mean and squares as in T. Chan, G. Golub and R. LeVeque, Updating formulae and a pairwise algorithm for
    computing sample variances, 1979.
    """
    merged = np.zeros(max(len(earlier), len(later)), TALLY)
    merged[: len(later)] = later
    a, b = earlier, merged[: len(earlier)].copy()
    only = np.flatnonzero((a["count"] > 0) & (b["count"] == 0))
    merged[only] = a[only]
    both = np.flatnonzero((a["count"] > 0) & (b["count"] > 0) & ~b["early"])
    if not len(both):
        return merged
    a, b = a[both], b[both]
    out = b.copy()
    out["count"] = a["count"] + b["count"]
    out["first_ns"], out["early"] = a["first_ns"], a["early"]
    between = b["first_ns"] - a["last_ns"]
    out["gap_ns"] = np.maximum(np.maximum(a["gap_ns"], b["gap_ns"]), between)
    is_later = b["newest_ns"] > a["newest_ns"]
    for name in ("newest_ns", "advanced_ns"):
        out[name] = np.where(is_later, b[name], a[name])
    share = b["count"] / out["count"]
    distance = b["mean"] - a["mean"]
    out["mean"] = a["mean"] + distance * share
    out["square"] = a["square"] + b["square"] + distance**2 * a["count"] * share
    out["refusals"] = a["refusals"] | b["refusals"]
    out["least"] = np.minimum(a["least"], b["least"])
    out["most"] = np.maximum(a["most"], b["most"])
    merged[both] = out
    return merged
