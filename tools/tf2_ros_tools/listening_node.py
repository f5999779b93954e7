"""Nodes of programs, and listening: which transforms arrive, who publishes them, and what is wrong."""

# First, because their errors say in one line what is missing, or that another tf2_ros is imported.
from tf2_ros.records import Recording
from tf2_ros.transform_listener import DEFAULT_STATIC_TF_TOPIC, DEFAULT_TF_TOPIC, TransformListener

# isort: split

import re
import threading
import time
from argparse import Namespace
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import NoReturn

import numpy as np
import rclpy
from numpy.typing import NDArray
from rclpy.exceptions import InvalidHandle, NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.signals import SignalHandlerOptions

from tf2_py import TransformException
from tf2_ros import Buffer
from tf2_ros_tools.findings import Expectation, Finding, Limits, Received, find, milliseconds
from tf2_ros_tools.output import counted, three_digits
from tf2_ros_tools.program import UsageError
from tf2_ros_tools.streams import Refused, Stream, Streams, moving_on

S = 1_000_000_000
LONGEST_PERIOD_S = 1e9  # about what time.sleep accepts, in seconds
CALLBACK_END_WAIT_S = 1.0  # for a callback that runs when the program is to end


@contextmanager
def spun_node(name: str, options: Namespace) -> Iterator[Node]:
    """
    A node for a ``with`` statement. A thread spins it, so that it knows the simulated time.

    :param options: of the command line.
    :raises UsageError: the command line contains a name or a parameter that ROS refuses.

    The main thread must not wait inside rclpy, because no signal would reach it there.
    """
    # Without the handlers of rclpy, which would shut the context down while the program uses it.
    rclpy.init(args=options.ros_arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node(name)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        thread = threading.Thread(target=_spin, args=(executor,), daemon=True)
        thread.start()
        try:
            yield node
        finally:
            # This also ends the thread, which may use the executor until then.
            rclpy.try_shutdown()
            thread.join(CALLBACK_END_WAIT_S)
            if not thread.is_alive():
                executor.shutdown()
                node.destroy_node()
    except (NameValidationException, ParameterException) as refusal:
        raise UsageError(str(refusal)) from None
    finally:
        rclpy.try_shutdown()


def wait() -> NoReturn:
    """Wait in the main thread until Ctrl-C or SIGTERM."""
    while True:
        time.sleep(1.0)


class Pace:
    """
    The ticks of a loop, at a constant rate from now on.

    Missed ticks are skipped, whether the process was stopped, its output had to wait for a reader, or the
    loop is slower than the rate. The others keep their times.

    :param period_s: from one tick to the next, in seconds.
    """

    def __init__(self, period_s: float) -> None:
        self._period_ns = max(round(min(period_s, LONGEST_PERIOD_S) * S), 1)
        self.due_ns = time.monotonic_ns()  # when the next tick is due

    def advance(self, now_ns: int) -> None:
        """If the next tick is due at this time of the monotonic clock, go on to the first one after it."""
        missed = max(now_ns - self.due_ns, -1) // self._period_ns + 1
        self.due_ns += missed * self._period_ns

    def next_s(self) -> float:
        """Go on to the next tick; return how long to wait for it, in seconds, which is above 0."""
        now_ns = time.monotonic_ns()
        self.advance(now_ns)
        return (self.due_ns - now_ns) / S


def _spin(executor: SingleThreadedExecutor) -> None:
    while executor.context.ok():
        try:
            executor.spin()
        except InvalidHandle:
            continue  # a part of the node was destroyed while the executor gathered them
        except ExternalShutdownException:
            return
        except Exception:
            if executor.context.ok():
                raise
            # The context ended between two checks of the executor.


TOPICS = (DEFAULT_TF_TOPIC, DEFAULT_STATIC_TF_TOPIC)


@contextmanager
def filled_buffer(
    node: Node,
    recording: Recording | None = None,
    *,
    topics: Sequence[str] = TOPICS,
    cache_time: float | None = None,
    qos: QoSProfile | None = None,
) -> Iterator[Buffer]:
    """
    A buffer for a ``with`` statement. A listener fills it, and it follows the clock of the node.

    :param recording: records what arrives.
    :param topics: the topic of dynamic transforms and the topic of static transforms.
    :param cache_time: how far each frame's history reaches back, in seconds. None: the default of buffers.
    :param qos: of dynamic transforms. None: the default of listeners.
    :raises UsageError: the receiver, which recording needs, does not support this release of ROS 2 or its
        middleware.
    """
    buffer = Buffer(cache_time, node)
    # A program that only observes must not answer those who ask the robot for its frames.
    if buffer.srv is not None:
        node.destroy_service(buffer.srv)
        buffer.srv = None
    try:
        listener = TransformListener(
            buffer, node, qos=qos, recording=recording, tf_topic=topics[0], tf_static_topic=topics[1]
        )
    except NotImplementedError as refusal:
        raise UsageError(str(refusal)) from None
    with listener:
        yield buffer


DRAIN_S = 1.0  # the longest time between two calls of `drain`
GID_BYTES = 16  # of a gid in a recording; in the graph of Humble, zeros follow them
UNKNOWN_NODE = "_NODE_NAME_UNKNOWN_"  # of an endpoint whose node the graph does not know yet, or any more


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


class Listening:
    """
    Listens to transforms; made by :func:`listening`.

    :meth:`drain` must be called every few seconds, as :meth:`listen` does. ``topics`` are their full names,
    and ``where`` is a phrase that names them and the ROS domain.
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
        self.where = f"on {' and '.join(self.topics)} in ROS domain {node.context.get_domain_id()}"
        self._streams = Streams(window_s)
        self._window_ns = None if window_s is None else round(window_s * S)
        self._names: dict[bytes, str] = {}  # of publishers, by gid

    def listen(self, seconds: float) -> None:
        """Listen in the main thread for this time, or until a signal."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            time.sleep(min(left, DRAIN_S))
            self.drain()

    def drain(self) -> None:
        """
        Account for everything that has arrived since the last call.

        Except for dynamic transforms before the first message on /clock: until then, simulated time is 0.
        """
        records: NDArray[np.void] = self._recording.take()
        self._streams.add(records[(records["received_ns"] > 0) | (records["static"] != 0)])
        if not self._names.keys() >= {*self._recording.publishers()}:
            self._look_up_publishers()  # now, because it may exit before the report

    def records(self) -> NDArray[np.void]:
        """The records of the window, and some before it."""
        return self._streams.kept(self._node.get_clock().now().nanoseconds)

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
        now_ns = self._node.get_clock().now().nanoseconds
        gids = self._recording.publishers()
        alive = self._look_up_publishers()
        publishers = [self._name_of(gid) for gid in gids]
        streams, refused = self._streams.report(now_ns, self.frames(), publishers)
        if now_ns <= 0:
            text = "use_sim_time is set, and no time was received on /clock, so nothing is judged"
            findings = [Finding("clock", "", text)]
        else:
            alive_ids = None
            # With some middlewares, messages have no gids, or others than those of the graph.
            if not {*alive, *self._names}.isdisjoint(gids):
                alive_ids = {number for number, gid in enumerate(gids) if gid in alive}
            also, where = [*self._of_reception(now_ns), *self._of_unfit_publishers()], self.where
            also += self._of_records(now_ns, publishers, alive_ids)
            findings = find(streams, limits, expectations, alive_ids, refused=refused, where=where, also=also)
        chain = None if ends is None else self._chain(ends, now_ns)
        if chain is not None and chain.frames is not None:
            streams = [one for one in streams if one.frame in chain.frames]
            findings = [one for one in findings if one.frame in ("", *chain.frames)]
        return Report(now_ns / S, streams, refused, findings, chain, self._recording.messages)

    def _of_reception(self, now_ns: int) -> Iterator[Finding]:
        """Find what is wrong with the clock and with what could not be accounted for."""
        clocks = [self._name_of(gid) for gid in self._publishers_of("/clock")]
        several = f"/clock has {len(clocks)} publishers, {' and '.join(sorted(clocks))}"
        jump = self._streams.jump_back(now_ns)
        if jump is not None:
            text = f"the clock jumped back by {three_digits(jump)} s{f': {several}' * (len(clocks) > 1)}"
            yield Finding("clock", "", f"{text}; only what was received after that is judged")
        elif len(clocks) > 1:
            yield Finding("clock", "", f"{several}: a jump from one time to the other clears buffers")
        if count := self._recording.malformed:
            yield Finding("malformed", "", f"{counted(count, 'message')} could not be read")
        if count := self._recording.lost:
            yield Finding("lost", "", f"{counted(count, 'transform')} arrived too fast to be recorded")

    def _of_records(
        self, now_ns: int, publishers: Sequence[str], alive: Collection[int] | None
    ) -> list[Finding]:
        def ago(time_ns: int) -> str:
            return f"{three_digits((now_ns - time_ns) / S)} s ago"

        values = self._recording.values()
        received = Received(self._streams.kept(now_ns), self.frames(), publishers, values, ago)
        begin_ns = None if self._window_ns is None else now_ns - self._window_ns
        return received.findings(alive, begin_ns)

    def _of_unfit_publishers(self) -> Iterator[Finding]:
        for subscription in self._node.subscriptions:
            if (topic := subscription.topic_name) in self.topics:
                for gid, qos in self._publishers_of(topic).items():
                    compatibility, reasons = qos_check_compatible(qos, subscription.qos_profile)
                    if compatibility == QoSCompatibility.ERROR:
                        errors = ", ".join(re.findall("ERROR: ([^;]+)", reasons)).lower()
                        text = f"listeners receive nothing from {self._name_of(gid)} on {topic}: {errors}"
                        yield Finding("qos", "", text)

    def _look_up_publishers(self) -> set[bytes]:
        return {gid for topic in self.topics for gid in self._publishers_of(topic)}

    def _publishers_of(self, topic: str) -> dict[bytes, QoSProfile]:
        """Get the gids and profiles of a topic's publishers, and note their names."""
        publishers = self._node.get_publishers_info_by_topic(topic)
        infos = {bytes(one.endpoint_gid)[:GID_BYTES]: one for one in publishers}
        for gid, one in infos.items():
            # A publisher that has exited keeps its name.
            if one.node_name != UNKNOWN_NODE:
                self._names[gid] = f"{one.node_namespace.rstrip('/')}/{one.node_name}"
        return {gid: one.qos_profile for gid, one in infos.items()}

    def _name_of(self, gid: bytes) -> str:
        """The name of a publisher; until the graph knows it, a part of its gid, if it has any."""
        unknown = f"{gid.hex()[:12]}..{gid.hex()[-8:]}" if any(gid) else "an unknown publisher"
        return self._names.get(gid) or unknown

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


@contextmanager
def listening(
    node: Node,
    window_s: float | None = None,
    *,
    topics: tuple[str, str] = TOPICS,
    cache_time: float | None = None,
) -> Iterator[Listening]:
    """
    Listen in a ``with`` statement.

    :param window_s: the period over which figures are computed. None: all time.
    :param topics: see :func:`filled_buffer`.
    :param cache_time: see the same function.
    """
    recording = Recording()
    with filled_buffer(node, recording, topics=topics, cache_time=cache_time) as buffer:
        yield Listening(node, buffer, recording, topics, window_s)
