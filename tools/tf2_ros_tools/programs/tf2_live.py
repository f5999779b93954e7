# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Show what a robot sends to a machine without ROS 2."""

from __future__ import annotations

import sys
import time
from argparse import Namespace
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from math import inf
from typing import TYPE_CHECKING

from tf2_ros_tools.common.optional_libraries import require
from tf2_ros_tools.common.options import positive_number
from tf2_ros_tools.common.output import counted, show, show_json, three_digits
from tf2_ros_tools.common.program import FAILURE, SUCCESS, Parser, RunError, run

if TYPE_CHECKING:
    from tf2_ros_tools.diagnosis.stream_statistics import Stream
    from tf2_ros_tools.live.feed import Heard
    from tf2_ros_tools.live.transport import Publisher

LISTEN_S = 5.0  # after which DDS has found all publishers

PARSER = Parser(
    "tf2_live",
    "Listen to a robot for a while, without ROS 2 on this machine. Show who publishes which frames how "
    "often, which messages were lost, and by how much the clocks differ. If nothing arrives on a topic, say "
    "why.\n\n"
    "Exit status: 0 if transforms arrived on both /tf and /tf_static; 1 if not, for example because a robot "
    "publishes on only one of them; 2 after wrong usage.",
    """\
  tf2_live dds://                      robots in the ROS domain ROS_DOMAIN_ID, found by multicast
  tf2_live dds://?peers=192.168.0.7    this robot, on a network without multicast
  tf2_live zenoh://robot:7447          the Zenoh router of a robot
  tf2_live ws://robot:8765 -o tf.mcap  the foxglove_bridge of a robot; save what arrives""",
    node=False,
)
PARSER.add_argument(
    "where", metavar="WHERE", help="the robot: dds://, dds://?peers=HOST, zenoh://HOST:7447 or ws://HOST:8765"
)
PARSER.add_argument(
    "-t",
    type=positive_number,
    metavar="S",
    default=LISTEN_S,
    help=f"listen for S seconds; {LISTEN_S:g} by default",
)
PARSER.add_argument("-o", "--output", metavar="FILE", help="save what has arrived as a recording in mcap")
PARSER.add_argument("--json", action="store_true", help="print the result as one line of JSON")


def live(options: Namespace) -> int:
    """Listen, and print what has arrived; return the exit status."""
    from tf2_ros.records import Recording
    from tf2_ros_tools.diagnosis.findings import Limits
    from tf2_ros_tools.listening.session import TOPICS, Listening
    from tf2_ros_tools.live.feed_session import live_session

    if options.output is not None:
        require("mcap", "bag")
    recording = Recording()
    cache_time = None if options.output is None else inf  # a recording keeps all
    with live_session(options.where, recording, topics=TOPICS, cache_time=cache_time) as session:
        heard = Listening(session, recording, None)
        seconds, began_s = options.t, time.monotonic()
        session.info(f"Listening {session.where} for {three_digits(seconds)} s ...")
        try:
            heard.listen(seconds)
        except RunError:  # the feed has ended, and `why_silent` says why
            seconds = time.monotonic() - began_s
        feed = session.feed
        # Before the report, which may know more: what arrives meanwhile must not seem to be missing from it.
        topics, publishers, silence = feed.topics, feed.publishers(), feed.why_silent(seconds)
        streams = heard.report(Limits()).streams
        if options.json:
            facts = {
                "seconds": seconds,
                "topics": {name: asdict(one) for name, one in topics.items()},
                "streams": [asdict(one) for one in streams],
                "publishers": [one._asdict() for one in publishers],
                "clock_offset": feed.clock_offset,
                "silence": silence or None,
            }
            show_json(facts)
        else:
            lines = _lines(topics, publishers, streams)
            show(*lines, *_clock(feed.clock_offset), *([silence] if silence else []))
        if options.output is not None:
            from tf2_ros_tools.recordings.saved_buffers import save

            save(session.buffer, options.output)
    return FAILURE if silence else SUCCESS


def _lines(
    topics: Mapping[str, Heard], publishers: Sequence[Publisher], streams: Sequence[Stream]
) -> Iterator[str]:
    for topic, heard in topics.items():
        rate = "" if heard.rate is None else f", {heard.rate:.1f} a second"
        lost = "" if heard.lost is None else f"{heard.lost} lost, "
        yield f"{topic}: {counted(heard.count, 'message')}{rate}; {lost}{heard.malformed} malformed"
    for publisher, frames in sorted(_frames_of(streams).items()):
        yield f"{publisher}: {', '.join(frames)}"
    quiet = {one.node for one in publishers if one.node} - {one.publisher for one in streams}
    yield from (f"{name}: nothing has arrived" for name in sorted(quiet))


def _clock(offset: float | None) -> Iterator[str]:
    if offset is not None:
        yield f"clock: messages arrive at least {three_digits(offset)} s after they were sent"


def _frames_of(streams: Sequence[Stream]) -> dict[str, list[str]]:
    frames: dict[str, list[str]] = {}
    for one in streams:
        rate = "static" if one.static or one.rate is None else f"{one.rate:.1f} Hz"
        frames.setdefault(one.publisher, []).append(f"{one.frame} ({rate})")
    return frames


main = partial(run, PARSER, live)

if __name__ == "__main__":
    sys.exit(main())
