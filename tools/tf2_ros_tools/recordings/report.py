# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Report the contents of a recording, and its problems."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from tf2_py import stored_name
from tf2_py.printable import printable
from tf2_ros_tools.common.output import span
from tf2_ros_tools.diagnosis.findings import SAME_CLOCK_S, Expectation, Finding, Limits, Received, find
from tf2_ros_tools.diagnosis.stream_statistics import Refused, Stream, Streams, without_delays
from tf2_ros_tools.recordings.bag_reader import listed

if TYPE_CHECKING:
    from tf2_ros_tools.recordings.bag_loader import BagContents

S = 1_000_000_000
# A recording often ends with the shutdown of the robot, for which launch allows five seconds.
LIMITS = Limits(stale=5.0)
# How `tf2_bag rewrite` cures a finding, by its kind.
CURES = {
    "parents": "`tf2_bag rewrite --drop PARENT,{}` leaves one out",
    "mixed": "`tf2_bag rewrite --statics` replaces both",
}


@dataclass(frozen=True)
class Report:
    """All that is known about a recording; times are log times, in seconds."""

    streams: list[Stream]  # as they are at the end; ``silence`` is before the last transform
    refused: list[Refused]
    findings: list[Finding]
    begin: float | None  # when the first transform was received; None: there is none
    end: float | None
    transforms: int
    clocks_differ: bool  # stamps and log times come from two clocks, so all delays are None

    @property
    def seconds(self) -> float:
        """The time from the first transform to the last one."""
        return 0.0 if self.begin is None or self.end is None else self.end - self.begin


def report(
    heard: BagContents,
    limits: Limits = LIMITS,
    expectations: Mapping[str, Expectation] = {},
    headers: Mapping[str, str] = {},
) -> Report:
    """
    Report the contents of a recording, and its problems by the rules of ``tf2_check``.

    :param limits: what is accepted.
    :param expectations: of frames, by their names.
    :param headers: the frames that messages of other topics name, by the topic.

    The time of the report is the time of the last dynamic transform, because a recorder often outlives the
    robot. If it outlives the robot for long, this is one finding, not one for each frame.
    """
    records = heard.records
    also = [Finding("malformed", "", text) for text in heard.notes]
    if not len(records):
        where = f"({'; '.join(heard.absent)})" if heard.absent else ""
        found = find([], limits, expectations, where=where, also=also)
        return Report([], [], found, None, None, 0, False)
    times, static = records["received_ns"], records["static"] != 0
    now_ns = int((times if static.all() else times[~static]).max())
    figures = Streams()
    figures.add(records)
    streams, refused = figures.report(now_ns, heard.frames, heard.publishers)
    delays = [abs(one.delay) for one in streams if one.delay is not None]
    # One frame whose stamps are of the clock of the log times is enough to show that others are not.
    differ = min(delays, default=0.0) > SAME_CLOCK_S
    if differ:
        streams = [without_delays(one) for one in streams]
    received = Received(records, heard.frames, heard.publishers, heard.values, _at_log_time)
    also += received.findings()
    also += received.of_equal_stamps(heard.buffer.histories().values())
    also += (jumps := [*received.jumps("; `start` and `end`, or --start and --end, separate them")])
    # Stamps that went back are not newer than all before, but they advance.
    advancing = {name for one in jumps for name in one.frames}
    judged = [replace(one, stalled=one.silence) if one.frame in advancing else one for one in streams]
    silence = 0.0 if heard.end_ns is None or static.all() else (heard.end_ns - now_ns) / S
    if silence > limits.stale:
        text = f"no dynamic transform was received in the last {span(silence)}"
        also.append(Finding("stale", "", text))
    also += _of_headers(headers, {name for one in streams for name in (one.frame, one.parent)})
    found = find(judged, limits, expectations, refused=refused, recorded=True, also=also)
    found = [
        replace(one, text=f"{one.text}; {CURES[one.kind].format(one.frame)}") if one.kind in CURES else one
        for one in found
    ]
    begin, end = int(times.min()) / S, int(times.max()) / S
    return Report(streams, refused, found, begin, end, len(records), differ)


def _of_headers(headers: Mapping[str, str], known: Collection[str]) -> Iterator[Finding]:
    """Find messages that no lookup can transform, because of the frame in their header."""
    topics: dict[str, list[str]] = {}
    for topic, frame in headers.items():
        topics.setdefault(frame, []).append(topic)
    for frame, own in topics.items():
        name, stored = printable(frame), stored_name(frame)
        what = f"messages on {listed(own)} are in {name}"
        if stored not in known:
            cure = "`tf2_bag rewrite --statics` adds one"
            yield Finding("headers", stored, f"{what}, which no transform has; {cure}")
        elif stored != frame:
            cure = f"`tf2_bag rewrite --rename {printable(stored)}={printable(stored)}` removes the slash"
            yield Finding("headers", stored, f"{what}, but lookups refuse names that begin with /; {cure}")


def _at_log_time(time_ns: int) -> str:
    return f"at log time {time_ns / S:.3f} s"
