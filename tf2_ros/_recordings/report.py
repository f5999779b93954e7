"""Owns what is said of a whole recording: figures of its frames, and what is wrong with them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tf2_py._internal import three_digits
from tf2_ros._traffic.expectations import Expectation
from tf2_ros._traffic.findings import Finding, Limits, find
from tf2_ros._traffic.settling import Settling
from tf2_ros._traffic.streams import Refused, Reported, Stream, Streams

if TYPE_CHECKING:
    from tf2_ros._recordings.hearing import Heard

__all__ = ["LIMITS", "Report", "report"]

S = 1_000_000_000
# Beyond this, stamps and log times are not of one clock: a simulation, or the recording of a replay.
SAME_CLOCK_S = 3600.0
# A recording often ends with the shutdown of the robot, and launch gives its programs five seconds for that.
LIMITS = Limits(stale=5.0)
NOTHING_EXPECTED: Mapping[str, Expectation] = MappingProxyType({})


@dataclass(frozen=True)
class Report:
    """What there is to tell of a recording; times are log times, in seconds."""

    streams: list[Stream]  # as they are at the end; ``silence`` is before the last transform
    refused: list[Refused]
    findings: list[Finding]
    begin: float | None  # when the first transform was received; None: there is none
    end: float | None
    transforms: int
    clocks_differ: bool  # stamps and log times are of two clocks: delays mean nothing, and are None


def report(
    heard: Heard, limits: Limits = LIMITS, expectations: Mapping[str, Expectation] = NOTHING_EXPECTED
) -> Report:
    """
    Say what a recording holds, and what is wrong with it, by the rules of ``tf2_check``.

    :param limits: from where on something is wrong.
    :param expectations: of frames, by their names.

    The present of a recording is its last dynamic transform: a recorder often stays on when the robot is
    off. Where it stays on for long, that is one finding, and not one for each frame.
    """
    records = heard.records
    if not len(records):
        return Report([], [], find([], limits, expectations), None, None, 0, False)
    received, static = records["received_ns"], records["static"] != 0
    now_ns = int((received if static.all() else received[~static]).max())
    streams, refused = _reported(heard, now_ns)
    # A recorder discovers publishers as any listener does, and is sent late what it has missed.
    judged = _reported(heard, now_ns, Settling().early(records)).streams
    differ = _clocks_differ(streams)
    if differ:
        streams, judged = ([_without_delays(one) for one in some] for some in (streams, judged))
    found = find(judged, limits, expectations, refused=refused, recorded=True)
    if heard.end_ns is not None and not static.all():
        found = [*_of_the_end((heard.end_ns - now_ns) / S, limits), *found]
    begin, end = int(received.min()) / S, int(received.max()) / S
    return Report(streams, refused, found, begin, end, len(records), clocks_differ=differ)


def _reported(heard: Heard, now_ns: int, early: NDArray[np.bool_] | None = None) -> Reported:
    streams = Streams()
    streams.add(heard.records, early)
    return streams.report(now_ns, heard.frames, heard.publishers)


def _of_the_end(silence: float, limits: Limits) -> Iterator[Finding]:
    if silence > limits.stale:
        text = f"no dynamic transform was received in the last {three_digits(silence)} s"
        yield Finding("stale", "", text, {"silence": silence})


def _clocks_differ(streams: Sequence[Stream]) -> bool:
    delays = [abs(one.delay) for one in streams if one.delay is not None]
    return bool(delays) and float(np.median(delays)) > SAME_CLOCK_S


def _without_delays(stream: Stream) -> Stream:
    return replace(stream, delay=None, delay_max=None, delay_min=None, jitter=None)
