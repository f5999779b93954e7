# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Provide the session of a feed, for programs that listen without ROS 2: what ``--live`` names."""

import logging
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

from tf2_py.printable import counted, printable
from tf2_ros import Buffer
from tf2_ros.records import Recording
from tf2_ros_tools.common.program import RunError, UsageError
from tf2_ros_tools.diagnosis.findings import Finding
from tf2_ros_tools.live import connect
from tf2_ros_tools.live.broadcaster import OWN
from tf2_ros_tools.live.feed import Feed
from tf2_ros_tools.live.transport import DISCOVERY_S


class FeedSession:
    """A :class:`~tf2_ros_tools.listening.session.Session` of a feed."""

    def __init__(self, feed: Feed, where: str) -> None:
        self.feed, self.buffer = feed, feed.buffer
        self.where = f"on {' and '.join(feed.topics)} at {where}"
        # Messages without a gid, and what this program sends, are recorded with these instead.
        self._without_gid = {one.encode(): one for one in (where, OWN)}
        self.names = self._without_gid.copy()
        self._began = time.monotonic()

    def now_ns(self) -> int:
        return time.time_ns()

    def require_open(self) -> None:
        if why := self.feed.why_ended():
            raise RunError(why)

    def info(self, text: str) -> None:
        lines = "\n".join(map(printable, text.split("\n")))
        sys.stderr.write(f"[INFO] {lines}\n")

    def log_no_refusals(self) -> None:
        logging.getLogger("tf2_py").setLevel(logging.CRITICAL + 1)

    def look_up_publishers(self) -> set[bytes]:
        nodes = {bytes.fromhex(one.id): one.node for one in self.feed.publishers()}
        self.names.update((gid, node) for gid, node in nodes.items() if node)
        return {*nodes, *self._without_gid}

    def clock_publishers(self) -> list[str]:
        return []

    def findings(self) -> Iterator[Finding]:
        """Find what the wire has lost, and why nothing was received."""
        for topic, heard in self.feed.topics.items():
            if heard.lost:
                yield Finding("lost", "", f"{counted(heard.lost, 'message')} on {topic} were lost on the way")
        seconds = time.monotonic() - self._began
        published = {one.topic for one in self.feed.publishers()}
        topics = self.feed.topics
        silent = [topic for topic, heard in topics.items() if heard.last is None]
        # Before DISCOVERY_S, what was sent may still be on its way.
        if published.intersection(silent) and seconds >= DISCOVERY_S:
            yield Finding("qos", "", self.feed.why_silent(seconds))
        elif len(silent) == len(topics):
            yield Finding("nothing", "", self.feed.why_silent(seconds))


@contextmanager
def live_session(
    where: str,
    recording: Recording | None = None,
    *,
    topics: tuple[str, str],
    cache_time: float | None = None,
) -> Iterator[FeedSession]:
    """A session of a robot, see :func:`tf2_ros_tools.listening.session_choice.session`."""
    try:
        feed = connect(
            where,
            buffer=Buffer(cache_time),
            topic=topics[0],
            static_topic=topics[1],
            recording=recording,
        )
    except ValueError as refusal:
        raise UsageError(str(refusal)) from None
    except ConnectionError as failure:
        raise RunError(str(failure)) from None
    with feed:
        yield FeedSession(feed, where)
