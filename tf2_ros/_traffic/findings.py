"""Owns the rules by which something is wrong with the streams, and what is said of it."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from tf2_py._internal import counted, three_digits
from tf2_ros._traffic.chains import newest_streams, path_to_root
from tf2_ros._traffic.expectations import Expectation
from tf2_ros._traffic.streams import Refused, Stream

__all__ = ["KINDS", "Finding", "Limits", "find"]

# What may be wrong, in the order in which it is told.
KINDS = {
    "nothing": "no transform was received",
    "roots": "the frames are more than one tree",
    "loop": "frames are each other's ancestors",
    "parents": "a frame has two parents in turn",
    "publishers": "a frame has two publishers",
    "mixed": "a frame is both static and dynamic",
    "refused": "buffers refuse transforms of a frame",
    "stale": "a frame is no longer published, or its stamps stand still",
    "future": "stamps are in the future",
    "gap": "a frame was not published for many of its periods",
    "rate": "a frame is published less often than it must be",
    "missing": "an expected frame is not published",
    "parent": "a frame has another parent than expected",
    "delay": "transforms are older than expected",
    "static": "a frame is static where a dynamic one is expected, or dynamic",
}


@dataclass(frozen=True)
class Limits:
    """From where on something counts as wrong. Times are in seconds."""

    min_rate: float | None = None  # Hz, of every dynamic frame
    future: float = 0.1  # a stamp may be so far ahead of the clock
    stale: float = 1.0  # a frame may be silent so long ...
    stale_periods: float = 10.0  # ... and for so many of its periods, whichever is longer
    gap: float = 0.2  # two transforms may be so far apart ...
    gap_periods: float = 5.0  # ... and so many periods
    gap_count: int = 5  # with fewer transforms a period is a guess


@dataclass(frozen=True)
class Finding:
    """Something that is wrong: one of :data:`KINDS`, with a sentence, and the figures in it."""

    kind: str
    frame: str  # or "", where it is about all of them
    text: str
    numbers: Mapping[str, Any] = field(default_factory=dict)


def find(
    streams: Sequence[Stream],
    limits: Limits,
    expectations: Mapping[str, Expectation] = {},
    alive: Collection[int] | None = None,
    *,
    refused: Sequence[Refused] = (),
    recorded: bool = False,
) -> list[Finding]:
    """
    What is wrong.

    :param streams: as ``Streams.report`` gives them.
    :param expectations: of frames, by their names.
    :param alive: ids of the publishers that still exist; None: that is unknown, and all count.
    :param refused: as ``Streams.report`` gives them, too.
    :param recorded: the time of the report is the end of a recording. A frame that ended earlier has the
        rate of the time while it was published: what is missing after it is not yet to come.
    """
    found = [*_in_the_tree(streams)]
    if not streams:
        which = " that a buffer takes" if refused else ""
        found.append(Finding("nothing", "", f"no transform was received{which}"))
    by_frame: dict[str, list[Stream]] = {}
    for stream in streams:
        by_frame.setdefault(stream.frame, []).append(stream)
    for frame, own in by_frame.items():
        expected = expectations.get(frame, Expectation())
        found += _of_frame(frame, own, alive)
        found += _as_expected(frame, newest_streams(own)[frame], expected)
        for stream in own:
            if not stream.static:
                found += _of_stream(stream, limits, expected, recorded)
    # The static transforms of a publisher that has ended reach nobody any more.
    refused = [one for one in refused if not one.static or alive is None or one.publisher_id in alive]
    found += map(_of_refused, refused)
    for frame in expectations.keys() - by_frame.keys():
        only = any(one.frame == frame for one in refused)
        lack = "all its transforms are refused" if only else "nobody publishes it"
        found.append(Finding("missing", frame, f"{frame} is expected, and {lack}"))
    order = list(KINDS)
    return sorted(found, key=lambda one: (order.index(one.kind), one.frame))


def _in_the_tree(streams: Sequence[Stream]) -> Iterator[Finding]:
    newest = newest_streams(streams)
    trees: dict[str, int] = {}  # frames below each root, by its name
    in_loops: set[str] = set()
    for frame in newest:
        path = path_to_root(newest, frame)
        top = path[-1]
        if top not in newest:
            trees[top] = trees.get(top, 1) + 1
        elif frame not in in_loops and newest[top].parent == frame:
            in_loops.update(path)
            text = f"the frames {' -> '.join([*path, frame])} form a loop"
            yield Finding("loop", frame, text, {"frames": path})
    if len(trees) > 1:
        parts = ", ".join(f"{root} ({counted(count, 'frame')})" for root, count in sorted(trees.items()))
        yield Finding("roots", "", f"{len(trees)} unconnected trees: {parts}", {"roots": sorted(trees)})


def _of_frame(frame: str, own: Sequence[Stream], alive: Collection[int] | None) -> Iterator[Finding]:
    own = [one for one in own if not one.static or alive is None or one.publisher_id in alive]
    parents = sorted({one.parent for one in own})
    if len(parents) > 1:
        text = f"{frame} has {len(parents)} parents in turn: {', '.join(parents)}"
        yield Finding("parents", frame, text, {"parents": parents})
    by_kind = {
        static: {one.publisher_id: one.publisher for one in own if one.static == static}
        for static in (True, False)
    }
    for publishers in by_kind.values():
        if len(publishers) > 1:
            names = sorted(publishers.values())
            text = f"{frame} is published by {len(names)} publishers: {', '.join(names)}"
            yield Finding("publishers", frame, text, {"publishers": names})
    if all(by_kind.values()):
        still, moving = (sorted({*by_kind[static].values()}) for static in (True, False))
        text = f"{frame} is static by {', '.join(still)} and dynamic by {', '.join(moving)}"
        yield Finding("mixed", frame, text, {"static": still, "dynamic": moving})


def _of_refused(one: Refused) -> Finding:
    which = f"{one.count} of {one.received} transforms of {one.frame or repr('')} by {one.publisher}"
    numbers = {"refused": one.count, "received": one.received, "publisher": one.publisher}
    return Finding("refused", one.frame, f"{which} are refused: {one.because}", numbers)


def _of_stream(stream: Stream, limits: Limits, expected: Expectation, recorded: bool) -> Iterator[Finding]:
    frame = stream.frame
    future = limits.future if expected.max_future is None else expected.max_future
    if stream.delay_min is not None and -stream.delay_min > future:
        ahead = -stream.delay_min
        yield Finding(
            "future", frame, f"{frame} is stamped up to {three_digits(ahead)} s ahead", {"ahead": ahead}
        )
    if stream.period is not None:
        yield from _of_intervals(stream, stream.period, limits, recorded)
    min_rate = limits.min_rate if expected.min_rate is None else expected.min_rate
    rate = stream.rate if recorded and stream.rate is not None else _rate_at_most(stream)
    if min_rate is not None and rate is not None and rate < min_rate:
        text = f"{frame} is published at {three_digits(rate)} Hz, less than {min_rate:g} Hz"
        yield Finding("rate", frame, text, {"rate": rate, "min_rate": min_rate})


def _of_intervals(stream: Stream, period: float, limits: Limits, recorded: bool) -> Iterator[Finding]:
    since = "before the end" if recorded else "ago"
    frame, usual = stream.frame, f"its period is {three_digits(period)} s"
    longest = max(limits.stale, limits.stale_periods * period)
    if stream.silence > longest:
        text = f"{frame} was last received {three_digits(stream.silence)} s {since}; {usual}"
        yield Finding("stale", frame, text, {"silence": stream.silence})
    elif stream.stalled > longest:
        text = f"{frame} has had no newer stamp for {three_digits(stream.stalled)} s; {usual}"
        yield Finding("stale", frame, text, {"stalled": stream.stalled})
    longest = max(limits.gap, limits.gap_periods * period)
    if stream.count >= limits.gap_count and stream.gap > longest:
        text = f"{frame} was not received for {three_digits(stream.gap)} s; {usual}"
        yield Finding("gap", frame, text, {"gap": stream.gap})


def _rate_at_most(stream: Stream) -> float | None:
    # Including the time since the last transform; the next one may be due at this moment.
    if stream.count == 0:
        return 0.0
    if stream.first <= 0.0:
        return stream.rate
    since = (stream.count + 1) / stream.first
    return since if stream.rate is None else min(stream.rate, since)


def _as_expected(frame: str, newest: Stream, expected: Expectation) -> Iterator[Finding]:
    if expected.parent is not None and newest.parent != expected.parent:
        text = f"{frame} has the parent {newest.parent}, not {expected.parent}"
        yield Finding("parent", frame, text, {"parent": newest.parent, "expected": expected.parent})
    if expected.static is not None and newest.static != expected.static:
        kinds = {True: "static", False: "dynamic"}
        text = f"{frame} is {kinds[newest.static]}, not {kinds[expected.static]}"
        yield Finding("static", frame, text)
    most = newest.delay_max
    if expected.max_delay is not None and most is not None and most > expected.max_delay:
        age = f"up to {three_digits(most)} s old when it is received"
        text = f"{frame} is {age}, more than {expected.max_delay:g} s"
        yield Finding("delay", frame, text, {"delay": most, "max_delay": expected.max_delay})
