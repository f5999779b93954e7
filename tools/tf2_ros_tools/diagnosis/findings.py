# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Find what is wrong with received transforms, by rules and expectations."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import inf
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tf2_py import History
from tf2_py.printable import counted, printable
from tf2_ros.numpy import to_matrix
from tf2_ros_tools.common.output import DAY_S, first_names, span, three_digits
from tf2_ros_tools.common.program import UsageError
from tf2_ros_tools.common.roll_pitch_yaw import rpy_from_matrices
from tf2_ros_tools.common.yaml_files import NOT_NEGATIVE, Key, boolean, frame_name, read_keys, read_yaml
from tf2_ros_tools.diagnosis.check_options import KINDS
from tf2_ros_tools.diagnosis.stream_statistics import (
    JUMP_BACK_NS,
    Refused,
    Stream,
    newest_streams,
    path_to_root,
    taken,
    without_delays,
)


@dataclass(frozen=True)
class Expectation:
    """What is expected of one frame; None: anything is accepted."""

    parent: str | None = None
    static: bool | None = None
    min_rate: float | None = None  # Hz
    max_delay: float | None = None  # seconds
    max_future: float | None = None  # seconds by which its stamps may be in the future


_KEYS = {
    "parent": Key("the name of a frame", frame_name),
    "static": Key("true or false", boolean),
    "min_rate": NOT_NEGATIVE,
    "max_delay": NOT_NEGATIVE,
    "max_future": NOT_NEGATIVE,
}


def expected_by(path: Path | None) -> dict[str, Expectation]:
    """
    Read the expectations of a check, by the names of their frames.

    :param path: the file of ``--expect``: ``{"frames": {name: {field of Expectation: value}}}``.
    :raises MissingLibraryError, UsageError: see :func:`read_yaml`; or something in it is unknown.
    """
    if path is None:
        return {}
    document = read_yaml(path)
    try:
        if not isinstance(document, dict) or set(document) != {"frames"}:
            raise ValueError("expected a mapping with the key 'frames' only")
        frames = document["frames"]
        if not isinstance(frames, dict) or not all(isinstance(name, str) for name in frames):
            raise ValueError("'frames': expected a mapping such as {odom: {parent: map}}")
        expected: dict[str, Expectation] = {}
        for name, given in frames.items():
            frame = frame_name(name)
            if frame is None:
                raise ValueError(f"{name!r} is not the name of a frame")
            if frame in expected:
                raise ValueError(f"{frame!r} and {'/' + frame!r} are the same frame")
            expected[frame] = Expectation(**read_keys(name, {} if given is None else given, _KEYS))
        return expected
    except ValueError as error:
        raise UsageError(f"{path}: {error}") from None


# If stamps and times of reception differ by more, they come from two clocks: one was simulated or replayed.
SAME_CLOCK_S = 3600.0


@dataclass(frozen=True)
class Limits:
    """The limits beyond which something is wrong; times are in seconds."""

    min_rate: float | None = None  # Hz, of every dynamic frame ...
    rate_margin: float = 0.05  # ... less this part, for timers and the edges of the window
    max_delay: float | None = None  # of every dynamic transform; None: the next two
    delay: float = 1.0  # a frame may on average be so old when it is received ...
    delay_periods: float = 3.0  # ... or so many of its periods, whichever is longer
    max_future: float = 0.1  # a stamp may be so far ahead of the clock
    stale: float = 1.0  # a frame may be silent so long ...
    stale_periods: float = 10.0  # ... and for so many of its periods, whichever is longer
    gap: float = 0.2  # two transforms may be so far apart ...
    gap_periods: float = 5.0  # ... and so many periods
    gap_count: int = 5  # with fewer transforms a period is a guess


@dataclass(frozen=True)
class Finding:
    """A problem: one of :data:`tf2_ros_tools.diagnosis.check_options.KINDS`, with a sentence."""

    kind: str
    frame: str  # or "", where it is about several
    text: str
    frames: tuple[str, ...] = ()  # those that it is about, where they are several


def find(
    streams: Sequence[Stream],
    limits: Limits,
    expectations: Mapping[str, Expectation] = {},
    alive: Collection[int] | None = None,
    *,
    refused: Sequence[Refused] = (),
    recorded: bool = False,
    where: str = "",
    also: Iterable[Finding] = (),
) -> list[Finding]:
    """
    Find what is wrong.

    :param streams: as ``Streams.report`` returns them.
    :param expectations: of frames, by their names.
    :param alive: ids of the publishers that still exist; None: this is unknown, so all count.
    :param refused: as ``Streams.report`` returns them.
    :param recorded: the time of the report is the end of a recording. The rate of a frame is then computed
        over the time in which it was published.
    :param where: a phrase with the topics, for a report that nothing was received.
    :param also: what is wrong apart from the streams.
    """
    found = [*also, *_in_the_tree(streams)]
    unset = {one.frame for one in found if one.kind == "unset"}  # their stamps are of no clock
    with_clocks = [one for one in streams if one.frame not in unset]
    found += _of_other_clocks(with_clocks, "the log times" if recorded else "the clock of this program")
    if not streams and all(one.kind != "nothing" for one in found):
        which = " that buffers accept" if refused else ""
        found.append(Finding("nothing", "", f"no transform{which} was received{where and f' {where}'}"))
    by_frame: dict[str, list[Stream]] = {}
    for stream in streams:
        by_frame.setdefault(stream.frame, []).append(stream)
    for frame, own in by_frame.items():
        expected = expectations.get(frame, Expectation())
        given = {key: getattr(expected, key) for key in ("min_rate", "max_delay", "max_future")}
        own_limits = replace(limits, **{key: one for key, one in given.items() if one is not None})
        found += _of_frame(frame, own, alive)
        found += _unnormalized(own, alive)
        found += _as_expected(frame, newest_streams(own)[frame], own, expected)
        moving = [one for one in own if not one.static]
        for stream in moving:
            judged = stream if _clock_offset(stream) is None else without_delays(stream)
            found += _of_stream(judged, _told_apart(stream, moving, recorded), own_limits, recorded)
    # The static transforms of a publisher that has exited no longer reach anybody.
    refused = [one for one in refused if not one.static or alive is None or one.publisher_id in alive]
    for one in refused:
        which = f"{counted(one.count, 'transform')} of {one.frame or repr('')} by {one.publisher}"
        verb = "is" if one.count == 1 else "are"
        found.append(Finding("refused", one.frame, f"{which} {verb} refused: {one.because}"))
    for frame in expectations.keys() - by_frame.keys():
        only = any(one.frame == frame for one in refused)
        lack = "all its transforms are refused" if only else "it is not published"
        found.append(Finding("missing", frame, f"{frame} is expected, but {lack}"))
    return sorted(found, key=lambda one: (KINDS.index(one.kind), one.frame))


def _in_the_tree(streams: Sequence[Stream]) -> Iterator[Finding]:
    newest = newest_streams(streams)
    trees: Counter[str] = Counter()  # frames below each root
    in_loops: set[str] = set()
    for frame in newest:
        path = path_to_root(newest, frame)
        if path[-1] not in newest:
            trees[path[-1]] += 1
        elif frame not in in_loops and newest[path[-1]].parent == frame:
            in_loops.update(path)
            text = f"the frames {' -> '.join([*path, frame])} form a loop"
            yield Finding("loop", frame, text, tuple(path))
    if len(trees) > 1:
        parts = ", ".join(f"{root} ({counted(count + 1, 'frame')})" for root, count in sorted(trees.items()))
        yield Finding("roots", "", f"{len(trees)} unconnected trees: {parts}")


def _of_frame(frame: str, own: Sequence[Stream], alive: Collection[int] | None) -> Iterator[Finding]:
    own = [one for one in own if not one.static or alive is None or one.publisher_id in alive]
    parents: dict[str, set[str]] = {}
    for one in own:
        parents.setdefault(one.parent, set()).add(one.publisher)
    if len(parents) > 1:
        which = ", ".join(f"{name} by {' and '.join(sorted(by))}" for name, by in sorted(parents.items()))
        yield Finding("parents", frame, f"{frame} has {len(parents)} parents: {which}")
    by_kind = {
        static: {one.publisher_id: one.publisher for one in own if one.static == static}
        for static in (True, False)
    }
    for publishers in by_kind.values():
        if len(publishers) > 1:
            names = [
                name if count == 1 else f"{name} ({'twice' if count == 2 else f'{count} times'})"
                for name, count in sorted(Counter(publishers.values()).items())
            ]
            text = f"{frame} is published by {len(publishers)} publishers: {', '.join(names)}"
            yield Finding("publishers", frame, text)
    if all(by_kind.values()):
        still, moving = (sorted({*by_kind[static].values()}) for static in (True, False))
        text = f"{frame} is published as static by {', '.join(still)} and as dynamic by {', '.join(moving)}"
        yield Finding("mixed", frame, text)


def _unnormalized(own: Sequence[Stream], alive: Collection[int] | None) -> Iterator[Finding]:
    """What buffers of this project accept, and tf2 of newer releases refuses."""
    for one in own:
        if one.unnormalized and not (one.static and alive is not None and one.publisher_id not in alive):
            which = f"{counted(one.unnormalized, 'transform')} of {one.frame} by {one.publisher}"
            has, them = ("has", "it") if one.unnormalized == 1 else ("have", "them")
            text = (
                f"{which} {has} a rotation whose length is not 1: "
                f"tf2 of ROS 2 Kilted and later refuses {them}"
            )
            yield Finding("unnormalized", one.frame, text)


def _clock_offset(stream: Stream) -> float | None:
    """How much earlier all its stamps are than their reception, if that means that a clock is another one."""
    least, most = stream.delay_min, stream.delay_max
    if least is not None and least > SAME_CLOCK_S:
        return least
    return most if most is not None and most < -SAME_CLOCK_S else None


def _of_other_clocks(streams: Sequence[Stream], clock: str) -> Iterator[Finding]:
    by_publisher: dict[tuple[str, bool], dict[str, float]] = {}
    for one in streams:
        offset = _clock_offset(one)
        if offset is not None:
            by_publisher.setdefault((one.publisher, offset > 0.0), {})[one.frame] = offset
    for (publisher, is_behind), offsets in sorted(by_publisher.items()):
        size = min(map(abs, offsets.values()))
        long = f"{three_digits(size / 3600.0)} hours" if size < DAY_S else span(size)
        where = f"{long} {'behind' if is_behind else 'ahead of'} {clock}"
        why = "only one of the two is simulated (see use_sim_time), or a clock is wrong"
        text = f"the stamps of {first_names([*offsets])} by {publisher} are {where}: {why}"
        yield Finding("clocks", "", text, tuple(offsets))


def _told_apart(stream: Stream, others: Sequence[Stream], recorded: bool) -> str:
    """
    A name for one of the dynamic streams of a frame: its publisher, and what the others do not share.

    In a recording, the publisher may be unknown: its name is then that of the topic.
    """
    text = stream.frame
    if any(one.parent != stream.parent for one in others):
        text += f" in {stream.parent}"
    if not recorded or any(one.publisher_id != stream.publisher_id for one in others):
        text += f" by {stream.publisher}"
    return text


def _of_stream(stream: Stream, name: str, limits: Limits, recorded: bool) -> Iterator[Finding]:
    """The rules for a dynamic stream."""

    def found(kind: str, sentence: str) -> Finding:
        return Finding(kind, stream.frame, f"{name} {sentence}")

    if stream.delay_min is not None and -stream.delay_min > limits.max_future:
        yield found("future", f"is stamped up to {span(-stream.delay_min)} ahead")
    rate = stream.rate if recorded and stream.rate is not None else _rate_at_most(stream)
    wanted = limits.min_rate
    if wanted is not None and rate is not None and rate < wanted * (1 - limits.rate_margin):
        hz, minimum = three_digits(rate), three_digits(wanted)
        yield found("rate", f"is published at {hz} Hz; the minimum is {minimum} Hz")
    how, delay, allowed = "up to", stream.delay_max, limits.max_delay
    if allowed is None and stream.period is not None:
        allowed = max(limits.delay, limits.delay_periods * stream.period)
        # The delay of stamps that stand still grows, but that is another problem.
        stands_still = stream.stalled - stream.silence > allowed
        how, delay = "on average", None if stands_still else stream.delay
    if allowed is not None and delay is not None and delay > allowed:
        yield found("delay", f"is {how} {span(delay)} old when received; the limit is {span(allowed)}")
    if stream.period is None:
        return
    usual = f"; its period is {span(stream.period)}"
    longest = max(limits.stale, limits.stale_periods * stream.period)
    if stream.silence > longest:
        since = "before the end" if recorded else "ago"
        yield found("stale", f"was last received {span(stream.silence)} {since}{usual}")
    elif stream.stalled > longest:
        yield found("stale", f"has had no newer stamp for {span(stream.stalled)}{usual}")
    if stream.count >= limits.gap_count and stream.gap > longest_interval(stream, limits):
        yield found("gap", f"was not received for {span(stream.gap)}{usual}")


def longest_interval(stream: Stream, limits: Limits) -> float:
    """Get the longest time between two transforms of a stream that is not a gap, in seconds."""
    return inf if stream.period is None else max(limits.gap, limits.gap_periods * stream.period)


def _rate_at_most(stream: Stream) -> float | None:
    # Including the time since the last transform, because the next one may be overdue.
    if stream.count == 0:
        return 0.0
    if stream.first <= 0.0:
        return stream.rate
    since = (stream.count + 1) / stream.first
    return since if stream.rate is None else min(stream.rate, since)


def _as_expected(
    frame: str, newest: Stream, own: Sequence[Stream], expected: Expectation
) -> Iterator[Finding]:
    if expected.parent is not None:
        others = sorted({one.parent for one in own} - {expected.parent})
        if newest.parent != expected.parent:
            yield Finding("parent", frame, f"{frame} has the parent {newest.parent}, not {expected.parent}")
        elif others:
            text = f"{frame} also has the parent {' and '.join(others)}, not only {expected.parent}"
            yield Finding("parent", frame, text)
    if expected.static is not None and newest.static != expected.static:
        kinds = {True: "static", False: "dynamic"}
        text = f"{frame} is {kinds[newest.static]}, not {kinds[expected.static]}"
        yield Finding("static", frame, text)


# What the figures of streams do not show.


S = 1_000_000_000
SAME_VALUE = 1e-6  # meters, and of the components of a quaternion
# Poses at one stamp that are closer are the same.
POSES_APART_M, POSES_APART_DEGREES = 1e-3, 0.1
JUMP_AHEAD_NS = 10 * S  # by so much more than the time of reception
ALTERNATIONS = 3  # a clock that was set goes back and ahead less often
COMPONENTS = ("x", "y", "z", "roll", "pitch", "yaw")


@dataclass(frozen=True)
class Received:
    """
    What was received, in the order of arrival.

    :param records: of ``tf2_ros.records.RECORD``.
    :param frames: by the ids in the records, as ``publishers`` and ``values``.
    :param when: describes a time of reception, which is in ns.
    """

    records: NDArray[np.void]
    frames: Sequence[str]
    publishers: Sequence[str]
    values: Sequence[Sequence[float]]
    when: Callable[[int], str]

    def findings(self, alive: Collection[int] | None = None, begin_ns: int | None = None) -> list[Finding]:
        """
        Find static transforms that differ or change, and stamps that were not set.

        :param alive: ids of the publishers that still exist; None: all count.
        :param begin_ns: what changed before this time of reception does not count.
        """
        accepted = taken(self.records)
        static = accepted["static"] != 0
        known = static & (accepted["value"] < len(self.values))
        return [
            *self._of_values(accepted[known], alive, begin_ns),
            *self._of_unset(accepted[~static]),
        ]

    def _of_values(
        self, static: NDArray[np.void], alive: Collection[int] | None, begin_ns: int | None
    ) -> Iterator[Finding]:
        table = np.array(self.values).reshape(-1, 7)
        with np.errstate(all="ignore"):  # some are refused
            table[:, 3:] /= np.linalg.norm(table[:, 3:], axis=1, keepdims=True)
        if alive is not None:
            static = static[np.isin(static["publisher"], [*alive])]
        for (child, publisher), own in _groups(static, "child", "publisher"):
            poses, parents = table[own["value"]], own["parent"]
            changes = np.flatnonzero(~_are_same(poses[1:], poses[:-1]) | (parents[1:] != parents[:-1]))
            if begin_ns is not None:
                changes = changes[own["received_ns"][changes + 1] >= begin_ns]
            if len(changes):
                name = f"{self.frames[child]} in {self.frames[parents[-1]]} by {self.publishers[publisher]}"
                at = slice(changes[-1], changes[-1] + 2)
                old, new = _told_apart_by(poses[at])
                if len({*parents[at]}) > 1:
                    old, new = (f"parent {self.frames[one]}" for one in parents[at])
                how = "changed" if len(changes) == 1 else f"changed {len(changes)} times, last"
                when = self.when(int(own["received_ns"][at][-1]))
                text = f"{name} is static and {how} from {old} to {new}, {when}"
                lasting = "lookups at any time use the last one"
                yield Finding("values", self.frames[child], f"{text}: {lasting}")
        for (child, parent), both in _groups(static, "child", "parent"):
            last = {number: own["value"][-1] for (number,), own in _groups(both, "publisher")}
            poses = table[[*last.values()]]
            if not _are_same(poses, poses[:1]).all():
                parts = zip(_told_apart_by(poses), last, strict=True)
                which = ", ".join(f"{value} by {self.publishers[number]}" for value, number in parts)
                text = (
                    f"{self.frames[child]} in {self.frames[parent]} is static with different values: {which}"
                )
                yield Finding("values", self.frames[child], text)

    def _of_unset(self, moving: NDArray[np.void]) -> Iterator[Finding]:
        suspects = np.unique(moving["child"][moving["stamp_ns"] == 0])
        moving = moving[np.isin(moving["child"], suspects)]
        for (child, number), own in _groups(moving, "child", "publisher"):
            # Before a node receives a simulated time, its time is 0.
            later = own[np.argmax(own["stamp_ns"] != 0) :]
            count = int(np.count_nonzero(later["stamp_ns"] == 0))
            if count > 1:
                which = f"{counted(count, 'transform')} of {self.frames[child]} by {self.publishers[number]}"
                text = f"{which} have the stamp 0, because the publisher does not set it"
                yield Finding("unset", self.frames[child], text)

    def of_equal_stamps(self, histories: Iterable[History]) -> Iterator[Finding]:
        """Find dynamic frames with poses that differ at one stamp."""
        for one in histories:
            stamps, name = one.stamps_ns, printable(one.frame)
            first, other = _of_equal(stamps)
            may_differ = (stamps[first] != 0) & (one.parents[first] == one.parents[other])
            first, other = first[may_differ], other[may_differ]
            away = np.linalg.norm(one.translations[other] - one.translations[first], axis=1)
            cosines = np.abs((one.rotations[other] * one.rotations[first]).sum(axis=1))
            turned = np.degrees(2.0 * np.arccos(np.minimum(cosines, 1.0)))
            is_wide = (away >= POSES_APART_M) | (turned >= POSES_APART_DEGREES)
            if is_wide.any():
                wide = first[is_wide]
                parent, at = one.parents.item(wide.min()), counted(len(np.unique(stamps[wide])), "stamp")
                apart = f"{three_digits(away[is_wide].max())} m and {three_digits(turned[is_wide].max())}"
                text = (
                    f"{name} in {printable(parent)} has different poses at {at}, up to {apart} degrees"
                    f" apart, first at {stamps[wide].min() / S:.3f} s: lookups mix them"
                )
                yield Finding("values", one.frame, text)

    def jumps(self, advice: str = "") -> Iterator[Finding]:
        """
        Find stamps that went back or ahead, because the clock of the robot did, or that are of two clocks.

        :param advice: how to separate what was received before and after.
        """
        moving = taken(self.records)
        moving = moving[(moving["static"] == 0) & (moving["stamp_ns"] != 0)]
        found: dict[str, dict[str, tuple[int, int, int]]] = {"both": {}, "back": {}, "ahead": {}}
        for (child, _), own in _groups(moving, "child", "publisher"):
            for way, jump in _jumps_of(own["stamp_ns"], own["received_ns"]):
                found[way][self.frames[child]] = jump
        hows = {
            "both": (
                "alternate between two clocks, and went back",
                "two publishers send them at the same time",
            ),
            "back": ("went back", f"lookups mix what was received before and after{advice}"),
            "ahead": ("jumped ahead", f"lookups interpolate across this{advice}"),
        }
        for way, frames in found.items():
            if frames:
                at_ns, size_ns, _ = min(frames.values())
                often = max(count for *_, count in frames.values())
                times = "" if often == 1 else f" {often} times, first"
                how, so = hows[way]
                what = f"the stamps of {first_names(sorted(frames))} {how}{times} by {span(size_ns / S)}"
                yield Finding("clock", "", f"{what}, {self.when(at_ns)}: {so}", tuple(sorted(frames)))


def _of_equal(stamps: NDArray[np.int64]) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Find where ascending stamps are equal, as pairs; a buffer keeps few samples of one stamp."""
    first: NDArray[np.intp] = np.arange(len(stamps))
    firsts, others = [first[:0]], [first[:0]]
    while len(first):
        distance = len(firsts)
        first = first[: first.searchsorted(len(stamps) - distance)]
        first = first[stamps[first] == stamps[first + distance]]
        firsts.append(first)
        others.append(first + distance)
    return np.concatenate(firsts), np.concatenate(others)


def _jumps_of(
    stamps: NDArray[np.int64], received: NDArray[np.int64]
) -> Iterator[tuple[str, tuple[int, int, int]]]:
    """Find how stamps jump, in the order of arrival: "both", "back" or "ahead"; first time, ns, how often."""
    steps = np.diff(stamps)
    rises = steps - np.diff(received)
    # A single late transform is not a clock that went back.
    back = np.flatnonzero(np.maximum(stamps[1:-1], stamps[2:]) < stamps[:-2] - JUMP_BACK_NS)
    newest = np.maximum.accumulate(stamps)[:-1]
    ahead = np.flatnonzero(stamps[1:] - newest - np.diff(received) > JUMP_AHEAD_NS)
    least = JUMP_BACK_NS if len(back) else JUMP_AHEAD_NS
    down, up = np.flatnonzero(steps < -least), np.flatnonzero(rises > least)
    if min(len(down), len(up)) >= ALTERNATIONS:
        yield "both", (int(received[down[0] + 1]), -int(steps[down[0]]), len(down))
        return
    for way, places, sizes in (("back", back, -steps), ("ahead", ahead, rises)):
        if len(places):
            yield way, (int(received[places[0] + 1]), int(sizes[places[0]]), len(places))


def _groups(records: NDArray[np.void], *names: str) -> Iterator[tuple[tuple[int, ...], NDArray[np.void]]]:
    """Get the records with the same ids in these fields, in their order."""
    if not len(records):
        return
    keys = np.stack([records[name] for name in names])
    order = np.lexsort(keys[::-1])
    edges = np.flatnonzero((np.diff(keys[:, order], axis=1) != 0).any(axis=0)) + 1
    for own in np.split(order, edges):
        yield tuple(keys[:, own[0]].tolist()), records[own]


def _are_same(poses: NDArray[np.float64], others: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Compare N rows x y z qx qy qz qw; opposite quaternions are the same rotation."""
    turns = poses[:, 3:], others[:, 3:]
    apart = np.minimum(*(np.abs(turns[0] + sign * turns[1]).max(axis=1) for sign in (1, -1)))
    away = np.abs(poses[:, :3] - others[:, :3]).max(axis=1)
    same: NDArray[np.bool_] = np.maximum(away, apart) <= SAME_VALUE
    return same


def _told_apart_by(poses: NDArray[np.float64]) -> list[str]:
    """Describe N rows x y z qx qy qz qw by the components in which they differ."""
    rpy = np.unwrap(rpy_from_matrices(to_matrix((poses[:, :3], poses[:, 3:]))), axis=0)
    table = np.hstack([poses[:, :3], rpy])
    spread = np.ptp(table, axis=0)
    shown = np.flatnonzero(spread > SAME_VALUE)
    if not len(shown):  # near a pole
        shown = np.arange(len(COMPONENTS))
    digits = [3 if one >= 1e-3 else 6 for one in spread]
    return [" ".join(f"{COMPONENTS[k]} {row[k]:.{digits[k]}f}" for k in shown) for row in table.tolist()]
