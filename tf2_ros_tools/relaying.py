"""Run the rules of tf2_relay in a node: subscribe, publish, and count."""

# First, because its errors say in one line what is missing, or that another tf2_ros is imported.
from tf2_ros_tools.listening import filled_buffer

# isort: split

import time
from collections import Counter, defaultdict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import serialize_message

from tf2_msgs.msg import TFMessage
from tf2_py import BufferCore, TransformException
from tf2_ros import TransformBroadcaster
from tf2_ros.records import Recording
from tf2_ros_tools.output import counted, printable, readable_size
from tf2_ros_tools.program import UsageError, sleep
from tf2_ros_tools.relay import TREE, Relay, Rule, read_rules, refuse_circles

CARE_S = 0.5  # between two looks at static transforms, at the file, and at what has arrived
PATIENCE_S = 5.0  # until a warning about a frame that nobody has published
JUMP_NS = 1_000_000_000  # all stamps go back further than this when a recording begins again
AVERAGING_S = 0.1  # of the velocities in an Odometry


class _Source:
    """The two topics that rules read, and the buffer that they fill."""

    def __init__(self, node: Node, topics: tuple[str, ...], count: Counter[str]) -> None:
        self._count = count
        self._messages = 0
        self._recording = Recording()
        self._newest_ns: dict[int, int] = {}  # by number of the child
        self._stack = ExitStack()
        self.buffer = self._stack.enter_context(filled_buffer(node, self._recording, topics=topics))
        self.close = self._stack.close

    def look(self) -> bool:
        """Count what has arrived since the last call, and return whether time has gone back."""
        records, names = self._recording.take(), self._recording.frames()
        pairs, counts = np.unique(records[["parent", "child"]], return_counts=True)
        messages, self._messages = self._recording.messages - self._messages, self._recording.messages
        size = messages * _size(())
        for (parent, child), count in zip(pairs.tolist(), counts.tolist(), strict=True):
            size += count * (_size([(names[parent], names[child])]) - _size(()))
        self._count.update(messages=messages, transforms=len(records), bytes=size)
        moving = records[records["static"] == 0]
        newest_ns: dict[int, int] = {}
        for child in np.unique(moving["child"]).tolist():
            newest_ns[child] = int(moving["stamp_ns"][moving["child"] == child].max())
        # All frames, because one publisher with a wrong clock is no reason to forget the others.
        went_back = bool(newest_ns) and all(
            stamp_ns < self._newest_ns.get(child, stamp_ns) - JUMP_NS for child, stamp_ns in newest_ns.items()
        )
        if went_back:
            self._newest_ns.clear()
        for child, stamp_ns in newest_ns.items():
            self._newest_ns[child] = max(stamp_ns, self._newest_ns.get(child, stamp_ns))
        return went_back


class _Broadcaster(TransformBroadcaster):
    """Sends to any topic."""

    def __init__(self, publisher: Publisher) -> None:
        self.pub_tf = publisher


class _Target:
    """
    A topic to which rules send.

    :param message: the name of its type.
    :param dry: gets the transforms, and nothing is published.
    """

    def __init__(
        self,
        node: Node,
        topic: str,
        message: str,
        is_static: bool,
        count: Counter[str],
        dry: BufferCore | None,
    ) -> None:
        self._count = count
        self._is_static = is_static
        self._latched: list[TransformStamped] = []
        self._dry = dry
        kind = {TREE: TFMessage, "PoseStamped": PoseStamped, "Odometry": Odometry}[message]
        durability = DurabilityPolicy.TRANSIENT_LOCAL if is_static else DurabilityPolicy.VOLATILE
        qos = QoSProfile(depth=1 if is_static else 100, durability=durability)
        self.publisher = None if dry is not None else node.create_publisher(kind, topic, qos)

    def send(self, transforms: list[TransformStamped]) -> None:
        """Send these; static ones only if they differ from those before, which they replace."""
        if transforms == self._latched:
            return
        if self._is_static:
            self._latched = transforms
        names = [(one.header.frame_id, one.child_frame_id) for one in transforms]
        self._count.update(messages=1, transforms=len(names), bytes=_size(names))
        if self._dry is not None:
            self._dry.set_transforms(transforms, "tf2_relay", self._is_static)
        elif self.publisher is not None:
            _Broadcaster(self.publisher).sendTransform(transforms)

    def close(self, node: Node) -> None:
        """Stop publishing."""
        if self.publisher is not None:
            node.destroy_publisher(self.publisher)

    def send_pose(self, pose: PoseStamped | Odometry) -> None:
        """Send a message that is not for tf2."""
        data = serialize_message(pose)
        self._count.update(messages=1, bytes=len(data))
        if self.publisher is not None:
            self.publisher.publish(data)


def _size(names: Sequence[tuple[str, str]]) -> int:
    """The bytes of a serialised message with transforms that have these parents and children."""
    size = 4  # of the number of transforms; behind the four bytes at which alignment begins
    for parent, child in names:
        size = -(-(size + 8 + 4 + len(parent.encode()) + 1) // 4) * 4
        size = -(-(size + 4 + len(child.encode()) + 1) // 8) * 8 + 7 * 8
    return size + 4


@dataclass
class _Running:
    """A rule that is applied, and the topics to which it sends: dynamic transforms, or poses; static ones."""

    relay: Relay
    source: _Source
    targets: list[_Target]
    due_s: float = 0.0  # of the monotonic clock


class Relaying:
    """
    Applies rules in a node; for a ``with`` statement.

    :param path: the file with the rules, which are read again when it changes.
    :param is_dry: publish nothing.
    :raises UsageError: the rules are wrong.
    """

    def __init__(self, node: Node, path: Path, is_dry: bool) -> None:
        self._node = node
        self._path = path
        self._version = _version(path)
        self._is_dry = is_dry
        self._received: dict[str, Counter[str]] = defaultdict(Counter)  # by topics
        self._sent: dict[str, Counter[str]] = defaultdict(Counter)  # by topic
        self._dry: dict[str, BufferCore] = defaultdict(BufferCore)  # by topics
        self._sources: dict[tuple[str, ...], _Source] = {}
        self._targets: dict[tuple[str, str, bool], _Target] = {}
        self._running: list[_Running] = []
        self._apply(read_rules(path))

    def __enter__(self) -> "Relaying":
        return self

    def __exit__(self, *_: object) -> None:
        for source in self._sources.values():
            source.close()

    def run(self, seconds: float) -> None:
        """Relay for this time, or until a signal."""
        end_s = time.monotonic() + seconds
        care_s = 0.0
        while (now_s := time.monotonic()) < end_s:
            if now_s >= care_s:
                self._care(now_s)
                care_s = now_s + CARE_S
            for one in self._running:
                if now_s >= one.due_s:
                    one.due_s = max(one.due_s + 1.0 / one.relay.rule.rate, now_s)
                    self._send_dynamic(one, now_s)
            wake_s = min(care_s, end_s, *(one.due_s for one in self._running))
            sleep(max(wake_s - time.monotonic(), 0.0))

    def report(self) -> Iterator[str]:
        """Describe in lines what was received and sent, or would be, and the trees if nothing was sent."""
        for one in self._running:
            one.source.look()
        arrived = {" and ".join(topics): source.buffer for topics, source in self._sources.items()}
        for way, buffers in (("in", arrived), ("out", self._dry)) if self._is_dry else ():
            for topics, buffer in buffers.items():
                yield f"{way}, {topics}:"
                yield from (f"  {line}" for line in buffer.tree().splitlines())
        for where, count in self._received.items():
            yield f"in, {where}: {_amount(count)}"
        for topic, count in self._sent.items():
            yield f"out, {topic}: {_amount(count)}"
        received, sent = (
            sum(one["bytes"] for one in counts.values()) for counts in (self._received, self._sent)
        )
        if received:
            yield f"saved: {readable_size(received - sent)} of {readable_size(received)}"

    def _apply(self, rules: Sequence[Rule]) -> None:
        resolve = self._node.resolve_topic_name
        refuse_circles(rules, resolve)
        sources: dict[tuple[str, ...], _Source] = {}
        targets: dict[tuple[str, str, bool], _Target] = {}
        owners: dict[str, dict[str, tuple[Relay, str]]] = {}
        running = []
        with ExitStack() as undo:
            for rule in rules:
                topics, to = tuple(map(resolve, rule.source)), tuple(map(resolve, rule.to))
                sources[topics] = (
                    sources.get(topics) or self._sources.get(topics) or self._source(topics, undo)
                )
                keys = [(topic, rule.message, place == 1) for place, topic in enumerate(to)]
                for key in keys:
                    targets[key] = (
                        targets.get(key) or self._targets.get(key) or self._target(rule.label, key, to, undo)
                    )
                # Rules that have a topic in common must not both send a frame.
                shared = next((owners[topic] for topic in to if topic in owners), {})
                owners.update(dict.fromkeys(to, shared))
                relay = Relay(rule, sources[topics].buffer, shared)
                running.append(_Running(relay, sources[topics], [targets[key] for key in keys]))
            undo.pop_all()
        for key in self._targets.keys() - targets.keys():
            self._targets[key].close(self._node)
        for topics in self._sources.keys() - sources.keys():
            self._sources[topics].close()
        self._sources, self._targets, self._running = sources, targets, running
        self._warned: set[str] = set()
        self._patience_s = time.monotonic() + PATIENCE_S

    def _source(self, topics: tuple[str, ...], undo: ExitStack) -> _Source:
        source = _Source(self._node, topics, self._received[" and ".join(topics)])
        undo.callback(source.close)
        return source

    def _target(
        self, label: str, key: tuple[str, str, bool], to: tuple[str, ...], undo: ExitStack
    ) -> _Target:
        shown = self._dry[" and ".join(to)] if key[1] == TREE else BufferCore()
        dry = shown if self._is_dry else None
        try:
            target = _Target(self._node, *key, self._sent[key[0]], dry)
        except RuntimeError as refusal:  # of rcl: above all, the topic has messages of another type
            raise UsageError(f"{label}: cannot send to {key[0]}: {refusal}") from None
        undo.callback(target.close, self._node)
        return target

    def _care(self, now_s: float) -> None:
        """Do what is needed from time to time only."""
        log = self._node.get_logger()
        if not self._is_dry and (version := _version(self._path)) != self._version:
            self._version = version
            try:
                self._apply(read_rules(self._path))
                log.info(f"Read {self._path} again")
            except UsageError as refusal:
                log.error(f"{' '.join(str(refusal).split())}; the old rules stay")
        for source in self._sources.values():
            if source.look():
                clock: Any = self._node.get_clock()
                if not clock.ros_time_is_active:  # otherwise the buffer follows it
                    source.buffer.clear()
                    log.warning("The stamps of all frames went back; forgetting what was received before")
                for one in self._running:
                    if one.source is source:
                        one.relay.forget()
        statics: dict[_Target, list[TransformStamped]] = defaultdict(list)
        for one in self._running:
            if one.relay.rule.message == TREE:
                statics[one.targets[1]] += one.relay.static_transforms()
        for target, transforms in statics.items():
            target.send(transforms)
        for problem in self.problems() if now_s >= self._patience_s and not self._is_dry else ():
            if problem not in self._warned:
                self._warned.add(problem)
                log.warning(printable(problem))

    def problems(self) -> list[str]:
        """Get a text for each frame that a rule names, but that cannot be sent."""
        return [text for one in self._running for text in one.relay.problems()]

    def _send_dynamic(self, one: "_Running", now_s: float) -> None:
        clock = self._node.get_clock().now()
        transforms = one.relay.dynamic_transforms(now_s, clock.nanoseconds)
        if one.relay.rule.message == TREE:
            one.targets[0].send(transforms)
            return
        for transform in transforms:
            if transform.header.stamp.sec == transform.header.stamp.nanosec == 0:
                transform.header.stamp = clock.to_msg()  # of frames that do not move
            one.targets[0].send_pose(_pose(one.relay, transform))


def _pose(relay: Relay, transform: TransformStamped) -> Any:
    is_odometry = relay.rule.message == "Odometry"
    message: Any = Odometry(child_frame_id=transform.child_frame_id) if is_odometry else PoseStamped()
    message.header = transform.header
    pose: Any = message.pose.pose if is_odometry else message.pose
    pose.orientation = transform.transform.rotation
    moved = transform.transform.translation
    pose.position.x, pose.position.y, pose.position.z = moved.x, moved.y, moved.z
    if is_odometry:
        parent, child = relay.rule.frames
        interval = Duration(seconds=max(AVERAGING_S, 1.0 / relay.rule.rate))
        twist = message.twist.twist
        with suppress(TransformException):  # there are too few transforms yet
            linear, angular = relay.buffer.lookupVelocityFullCore(
                child,
                parent,
                child,
                (0.0, 0.0, 0.0),
                child,
                relay.buffer.get_latest_common_time(parent, child),
                interval,
            )
            twist.linear.x, twist.linear.y, twist.linear.z = linear
            twist.angular.x, twist.angular.y, twist.angular.z = angular
    return message


def _amount(count: Counter[str]) -> str:
    of_trees = f"{counted(count['transforms'], 'transform')}, " if count["transforms"] else ""
    return f"{counted(count['messages'], 'message')}, {of_trees}{readable_size(count['bytes'])}"


def _version(path: Path) -> tuple[int, ...] | None:
    """What changes whenever a file does; None if it does not exist."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino
