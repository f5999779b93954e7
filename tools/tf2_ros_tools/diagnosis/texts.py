# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Describe streams and findings as text, and print the findings of a check."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

from tf2_py.printable import counted
from tf2_ros_tools.common.output import show, show_json
from tf2_ros_tools.common.program import FAILURE, SUCCESS
from tf2_ros_tools.diagnosis.findings import Finding
from tf2_ros_tools.diagnosis.stream_statistics import Stream


def stream_line(stream: Stream) -> str:
    """Describe a stream: frame, parent, publisher, rate and delays."""
    parts = [f"parent {stream.parent}", f"publisher {stream.publisher}", rate_label(stream)]
    if stream.delay is not None:
        parts += [delay_label(stream), f"jitter {milliseconds(stream.jitter)} ms"]
    return f"{stream.frame}: {', '.join(parts)}"


def rate_text(stream: Stream) -> str:
    """The rate in Hz; a question mark if it is unknown."""
    return "?" if stream.rate is None else f"{stream.rate:.1f}"


def rate_label(stream: Stream) -> str:
    """Describe how often transforms are received."""
    return "static" if stream.static else f"{rate_text(stream)} Hz"


def delay_label(stream: Stream) -> str:
    """Describe how old transforms are when they are received; empty if that is unknown."""
    if stream.delay is None:
        return ""
    return f"delay {milliseconds(stream.delay)} ms, max {milliseconds(stream.delay_max)} ms"


def milliseconds(seconds: float | None) -> str:
    """A duration in ms; empty if there is none."""
    return "" if seconds is None else f"{1e3 * seconds:.1f}"


def line_of(finding: Finding) -> str:
    """Describe a finding on one line."""
    return f"{finding.kind}: {finding.text}"


def lines_of(wrong: Sequence[Finding], streams: Sequence[Stream], of_what: str) -> Iterator[str]:
    """
    Describe findings, each on a line, and on the last line their number.

    :param of_what: how much was received, for example ``12 messages, 5 s``.
    """
    yield from map(line_of, wrong)
    verdict = counted(len(wrong), "problem") if wrong else "no problems"
    yield f"{verdict} in {frame_count(streams)} ({of_what})"


def frame_count(streams: Sequence[Stream]) -> str:
    """Count the frames, including roots, as in the list of trees."""
    return counted(len({name for stream in streams for name in (stream.frame, stream.parent)}), "frame")


def conclude(options: Namespace, report: Any, of_what: str, head: Mapping[str, Any]) -> int:
    """
    Print the findings of a report that are not ignored, as the options of a check say; return the status.

    :param report: of :mod:`tf2_ros_tools.recordings.report` or of :mod:`tf2_ros_tools.listening.session`.
    :param of_what: see :func:`lines_of`.
    :param head: what a JSON object begins with, after the verdict.
    """
    wrong = [finding for finding in report.findings if finding.kind not in options.ignore]
    if options.json:
        show_json({"ok": not wrong, **head, **asdict(replace(report, findings=wrong))})
    else:
        show(*lines_of(wrong, report.streams, of_what))
    return FAILURE if wrong else SUCCESS
