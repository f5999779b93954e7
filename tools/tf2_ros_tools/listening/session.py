# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Listen to the transforms of a robot: which arrive, who publishes them, and what is wrong."""

# First, because its errors say in one line that another tf2_ros is imported.
from tf2_ros.records import Recording

# isort: split

import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from tf2_py import TransformException
from tf2_py.printable import counted
from tf2_ros import Buffer
from tf2_ros_tools.common.output import span
from tf2_ros_tools.diagnosis.findings import Expectation, Finding, Limits, Received, find
from tf2_ros_tools.diagnosis.stream_statistics import Refused, Stream, Streams, moving_on
from tf2_ros_tools.diagnosis.texts import milliseconds

if TYPE_CHECKING:
    from tf2_ros_tools.live.feed import Feed

S = 1_000_000_000
TOPICS = ("/tf", "/tf_static")  # of dynamic and of static transforms
DRAIN_S = 1.0  # the longest time between two calls of `drain`


@dataclass(frozen=True)
class Chain:
    """What connects two frames."""

    ends: tuple[str, str]
    frames: list[str] | None  # None: they are not connected
    delay: tuple[float, float] | None  # mean and maximum, in seconds; None: nothing dynamic has arrived
    text: str  # all of that, in words


@dataclass(frozen=True)
class Report:
    """All that is known at one moment; if it has a chain, of the frames on it."""

    time: float  # of the node's clock, in seconds
    streams: list[Stream]
    refused: list[Refused]
    findings: list[Finding]
    chain: Chain | None
    messages: int


def publisher_name(names: Mapping[bytes, str], gid: bytes) -> str:
    """The name of a publisher; until it is known, a part of its gid, if it has any."""
    unknown = f"{gid.hex()[:12]}..{gid.hex()[-8:]}" if any(gid) else "an unknown publisher"
    return names.get(gid) or unknown


class Session(Protocol):
    """
    What fills the buffer of a program, and what the program asks of it. ``where`` is a phrase with the
    topics and the robot; it may change. ``names`` are the known names of publishers, by their ids in a
    recording.
    """

    buffer: Buffer
    names: dict[bytes, str]

    @property
    def where(self) -> str:
        """Return the phrase."""
        ...

    @property
    def feed(self) -> "Feed | None":
        """Return what receives without ROS; None: a node does."""
        ...

    def now_ns(self) -> int:
        """Return the time on the clock of the buffer, in ns."""
        ...

    def require_open(self) -> None:
        """
        Raise if nothing can arrive any more.

        :raises RunError: the reception has ended; the text says why.
        """

    def info(self, text: str) -> None:
        """Log a line."""

    def look_up_publishers(self) -> Collection[bytes]:
        """Note the names of publishers; return the ids of the present ones, or none if it knows no ids."""
        ...

    def log_no_refusals(self) -> None:
        """Have the buffer not log which transforms it refuses."""

    def clock_publishers(self) -> list[str]:
        """Return the names of those who publish /clock."""
        ...

    def findings(self) -> Iterator[Finding]:
        """Find what else is wrong with the reception."""
        ...


class Listening:
    """
    Listens to transforms; made by :func:`listening`.

    :meth:`drain` must be called every few seconds, as :meth:`listen` does. ``buffer`` is that of the session.
    """

    def __init__(self, session: Session, recording: Recording, window_s: float | None) -> None:
        self.session = session
        self.buffer = session.buffer
        self._recording = recording
        self._streams = Streams(window_s)
        self._window_ns = None if window_s is None else round(window_s * S)

    def listen(self, seconds: float) -> None:
        """
        Listen in the main thread for this time, or until a signal.

        :raises RunError: the reception has ended; the text says why.
        """
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            time.sleep(min(left, DRAIN_S))
            self.drain()
            self.session.require_open()

    def drain(self) -> None:
        """
        Account for everything that has arrived since the last call.

        Except for dynamic transforms before the first message on /clock: until then, simulated time is 0.
        """
        records: NDArray[np.void] = self._recording.take()
        if not self.session.names.keys() >= {*self._recording.publishers()}:
            self.session.look_up_publishers()  # now, because one may exit before the report
        self._streams.add(records[(records["received_ns"] > 0) | (records["static"] != 0)])

    def records(self) -> NDArray[np.void]:
        """The records of the window, and some before it."""
        return self._streams.kept(self.session.now_ns())

    def frames(self) -> list[str]:
        """The names of the frames, indexed by the numbers in the records."""
        return self._recording.frames()

    def report(
        self,
        limits: Limits,
        expectations: Mapping[str, Expectation] = {},
        ends: tuple[str, str] | None = None,
    ) -> Report:
        """Report the present state; ``ends``: two frames, to report what connects them."""
        self.drain()
        now_ns = self.session.now_ns()
        gids = self._recording.publishers()
        alive = self.session.look_up_publishers()
        publishers = [publisher_name(self.session.names, gid) for gid in gids]
        streams, refused = self._streams.report(now_ns, self.frames(), publishers)
        if now_ns <= 0:
            text = "use_sim_time is set, but /clock was not received, so nothing is checked"
            findings = [Finding("clock", "", text)]
        else:
            alive_ids = None
            # With some middlewares, messages have no gids, or others than those of the graph.
            if alive and not {*alive, *self.session.names}.isdisjoint(gids):
                alive_ids = {number for number, gid in enumerate(gids) if gid in alive}
            also = [*self._of_reception(now_ns), *self.session.findings()]
            also += self._of_records(now_ns, publishers, alive_ids)
            where = self.session.where
            findings = find(streams, limits, expectations, alive_ids, refused=refused, where=where, also=also)
        chain = None if ends is None else self._chain(ends, now_ns)
        if chain is not None and chain.frames is not None:
            streams = [one for one in streams if one.frame in chain.frames]
            findings = [
                one
                for one in findings
                if one.frame in ("", *chain.frames) and (not one.frames or {*one.frames} & {*chain.frames})
            ]
        return Report(now_ns / S, streams, refused, findings, chain, self._recording.messages)

    def _of_reception(self, now_ns: int) -> Iterator[Finding]:
        """Find what is wrong with the clock and with what could not be accounted for."""
        clocks = self.session.clock_publishers()
        several = f"/clock has {len(clocks)} publishers, {' and '.join(sorted(clocks))}"
        jump = self._streams.jump_back(now_ns)
        if jump is not None:
            text = f"the clock jumped back by {span(jump)}{f': {several}' * (len(clocks) > 1)}"
            yield Finding("clock", "", f"{text}; earlier dynamic transforms are not checked")
        elif len(clocks) > 1:
            yield Finding("clock", "", f"{several}: each jump between their times clears buffers")
        if count := self._recording.malformed:
            yield Finding("malformed", "", f"{counted(count, 'message')} could not be read")
        if count := self._recording.lost:
            yield Finding("lost", "", f"{counted(count, 'transform')} arrived too fast to be recorded")

    def _of_records(
        self, now_ns: int, publishers: Sequence[str], alive: Collection[int] | None
    ) -> list[Finding]:
        def ago(time_ns: int) -> str:
            # Of static transforms, the last ones are kept when the clock jumps back.
            if time_ns > now_ns:
                return "before the clock jumped back"
            return f"{span((now_ns - time_ns) / S)} ago"

        values = self._recording.values()
        received = Received(self._streams.kept(now_ns), self.frames(), publishers, values, ago)
        begin_ns = None if self._window_ns is None else now_ns - self._window_ns
        return [
            *received.findings(alive, begin_ns),
            *received.of_equal_stamps(self.buffer.histories().values()),
            *received.jumps(),
        ]

    def _chain(self, ends: tuple[str, str], now_ns: int) -> Chain:
        try:
            frames = self.buffer.path(ends[1], ends[0])  # as printed, from the first to the second
        except TransformException as reason:
            return Chain(ends, None, None, str(reason))
        children = [self.frames().index(name) for name in moving_on(self.buffer.frames(), frames)]
        delay = self._streams.net_delay(children, now_ns)
        text = "no net delay"
        if delay is not None:
            mean, most = map(milliseconds, delay)
            text = f"net delay {mean} ms, max {most} ms"
        return Chain(ends, frames, delay, f"{' -> '.join(frames)}: {text}")
