"""Owns listening for the programs that watch transforms: what arrives, from whom, and what is wrong."""

import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from rclpy.duration import Duration
from rclpy.node import Node

from tf2_ros._receive.rcl import problem
from tf2_ros._receive.receiver_thread import can_receive
from tf2_ros._receive.recording import Recording
from tf2_ros._traffic.chains import NetDelay, chain_between, moving_on, newest_streams
from tf2_ros._traffic.expectations import Expectation
from tf2_ros._traffic.findings import Finding, Limits, find
from tf2_ros._traffic.settling import Settling
from tf2_ros._traffic.streams import Refused, Stream, Streams
from tf2_ros.buffer import Buffer
from tf2_ros.cli._node import filled_buffer
from tf2_ros.transform_listener import DEFAULT_STATIC_TF_TOPIC, DEFAULT_TF_TOPIC, TransformListener
from tf2_ros_cython.cli._program import UsageError, sleep

__all__ = ["Chain", "Listening", "Report", "listening"]

S = 1_000_000_000
DRAIN_S = 1.0  # at least so often
TOPICS = (DEFAULT_TF_TOPIC, DEFAULT_STATIC_TF_TOPIC)
UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"  # in the graph, of an endpoint whose node is not known yet, or no more


@dataclass(frozen=True)
class Chain:
    """What connects two frames."""

    ends: tuple[str, str]
    frames: list[str] | None  # None: they are not connected
    delay: tuple[float, float] | None  # mean and maximum, in seconds; None: nothing dynamic has arrived


@dataclass(frozen=True)
class Report:
    """What there is to tell at one moment."""

    time: float  # of the node's clock, in seconds
    streams: list[Stream]
    refused: list[Refused]
    findings: list[Finding]
    chain: Chain | None
    messages: int
    malformed: int  # messages that could not be read
    lost: int  # transforms that arrived faster than they could be noted


class RecordingListener(TransformListener):
    """
    A listener whose receiver notes who sent each transform and when.

    :param recording: gets what is noted.
    :param topics: of dynamic and of static transforms.
    """

    def __init__(self, buffer: Buffer, node: Node, recording: Recording, topics: tuple[str, str]) -> None:
        self._recording = recording
        super().__init__(buffer, node, tf_topic=topics[0], tf_static_topic=topics[1])


class Listening:
    """
    Listens to transforms; made by :func:`listening`.

    :meth:`drain` must be called every few seconds, as :meth:`listen` does. ``topics`` are their full names.
    """

    def __init__(
        self,
        node: Node,
        buffer: Buffer,
        recording: Recording,
        topics: tuple[str, str],
        window_s: float | None,
    ) -> None:
        self.buffer = buffer
        self._node = node
        self._recording = recording
        self.topics = [node.resolve_topic_name(name) for name in topics]
        self._window_s = window_s
        self._streams = Streams(window_s)
        self._settling = Settling()
        self._net_delay: NetDelay | None = None
        self._names: dict[bytes, str] = {}  # of publishers, by gid

    def listen(self, seconds: float, kept: list[NDArray[np.void]] | None = None) -> None:
        """Listen so long, in the main thread, until a signal; ``kept`` gets the records, in pieces."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            sleep(min(left, DRAIN_S))
            records = self.drain()
            if kept is not None:
                kept.append(records)

    def drain(self) -> NDArray[np.void]:
        """Account for what has arrived since the last call, and return its records, all of them."""
        records: NDArray[np.void] = self._recording.take()
        # Until the first message of /clock, simulated time is 0, and no delay is known.
        records = records[(records["received_ns"] > 0) | (records["static"] != 0)]
        self._streams.add(records, self._settling.early(records))
        if self._net_delay is not None:
            self._net_delay.add(records)  # early ones, too: it is of the newest stamps, whenever they arrive
        if not self._names.keys() >= {*self._recording.publishers()}:
            self._look_up_publishers()  # now: it may end before the report
        return records

    def frames(self) -> list[str]:
        """The names of the frames, by the numbers in the records."""
        return self._recording.frames()

    def report(
        self,
        limits: Limits,
        expectations: Mapping[str, Expectation] = {},
        ends: tuple[str, str] | None = None,
    ) -> Report:
        """What there is to tell now; ``ends``: two frames, to tell what connects them."""
        self.drain()
        now_ns = self._node.get_clock().now().nanoseconds
        gids = self._recording.publishers()
        alive = self._look_up_publishers()
        publishers = [self._names.get(gid) or _short(gid) for gid in gids]
        streams, refused = self._streams.report(now_ns, self._recording.frames(), publishers)
        alive_ids = {number for number, gid in enumerate(gids) if gid in alive}
        findings = find(streams, limits, expectations, alive_ids, refused=refused)
        return Report(
            time=now_ns / S,
            streams=streams,
            refused=refused,
            findings=findings,
            chain=None if ends is None else self._chain(ends, streams, now_ns),
            messages=self._recording.messages,
            malformed=self._recording.malformed,
            lost=self._recording.lost,
        )

    def _look_up_publishers(self) -> set[bytes]:
        alive = set()
        for topic in self.topics:
            for one in self._node.get_publishers_info_by_topic(topic):
                gid = bytes(one.endpoint_gid)
                alive.add(gid)
                # One that has ended keeps the name that it had.
                if one.node_name != UNKNOWN_NODE:
                    self._names[gid] = f"{one.node_namespace.rstrip('/')}/{one.node_name}"
        return alive

    def _chain(self, ends: tuple[str, str], streams: Sequence[Stream], now_ns: int) -> Chain:
        newest = newest_streams(streams)
        frames = chain_between(newest, *ends)
        if frames is None:
            self._net_delay = None
            return Chain(ends, None, None)
        numbers = {name: number for number, name in enumerate(self._recording.frames())}
        children = [numbers[name] for name in moving_on(newest, frames)]
        if self._net_delay is None or self._net_delay.children != children:
            self._net_delay = NetDelay(children, self._window_s)
        return Chain(ends, frames, self._net_delay.report(now_ns))


@contextmanager
def listening(
    node: Node,
    window_s: float | None = None,
    *,
    topics: tuple[str, str] = TOPICS,
    cache_time: Duration | None = None,
) -> Iterator[Listening]:
    """
    Listen in a ``with`` statement.

    :param window_s: the time that figures are about. None: all time.
    :param topics: of dynamic and of static transforms.
    :param cache_time: of the buffer; see :func:`filled_buffer`.
    :raises UsageError: the receiver does not know the ROS 2 that runs.
    """
    if not can_receive():
        raise UsageError(f"who sends transforms cannot be noted here: {problem()}")
    recording = Recording()
    listen = partial(RecordingListener, recording=recording, topics=topics)
    with filled_buffer(node, listen, cache_time) as buffer:
        yield Listening(node, buffer, recording, topics, window_s)


def _short(gid: bytes) -> str:
    text = gid.hex()
    return f"{text[:12]}..{text[-8:]}"
