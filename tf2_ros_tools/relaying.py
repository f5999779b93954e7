"""Run the rules of tf2_relay in a node: subscribe, publish, and count."""

# First, because its errors say in one line what is missing, or that another tf2_ros is imported.
from tf2_ros_tools.listening import filled_buffer

# isort: split

import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from geometry_msgs.msg import PoseStamped, TransformStamped
from nav_msgs.msg import Odometry
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile

from tf2_msgs.msg import TFMessage
from tf2_py import BufferCore, TransformException
from tf2_ros import TransformBroadcaster
from tf2_ros.records import Recording
from tf2_ros_tools.output import counted, printable
from tf2_ros_tools.program import UsageError
from tf2_ros_tools.relay import ALL_RATE, STATIC, Relay, Rule, read_rules

MAINTAIN_S = 0.5  # between two looks at static transforms, and at the file
LOOK_S = 0.05  # between two looks at what has arrived, at most
ALL_S = 0.01  # between two messages of a rule that sends every transform
PATIENCE_S = 5.0  # until a warning about a frame that nobody has published
JUMP_NS = 1_000_000_000  # all stamps go back further than this when a recording begins again
ACTIVE_S = 0.5  # how long after its last transform a publisher counts as active
AVERAGING_S, MOST_AVERAGING_S = 0.1, 5.0  # of the velocities in an Odometry; buffers keep 10 s


class Source:
    """The two topics that rules read, and the buffer that they fill."""

    def __init__(self, topics: tuple[str, ...], buffer: BufferCore, recording: Recording) -> None:
        self.name = " and ".join(topics)
        self.buffer = buffer
        self.count: Counter[str] = Counter()
        self._recording = recording
        self._newest_ns: dict[int, int] = {}  # by number of the child
        # By number of the publisher and the child: the time of the last transform, and whether it was behind.
        self._active: dict[tuple[int, int], tuple[float, bool]] = {}

    def look(self, now_s: float) -> tuple[list[tuple[str, int]], bool]:
        """
        Count what has arrived since the last call.

        :param now_s: the time of the monotonic clock.
        :return: the children and stamps of dynamic transforms, and whether time has gone back.
        """
        _ = "" in self.buffer  # as any read, it inserts and records what has arrived
        records, names = self._recording.take(), self._recording.frames()
        self.count.update(transforms=len(records))
        self.count["messages"] = self._recording.messages
        moving = records[(records["static"] == 0) & (records["refusals"] == 0)]
        arrived: list[tuple[int, int, int]] = moving[["publisher", "child", "stamp_ns"]].tolist()
        # All that are active, because one publisher with a wrong clock is no reason to forget the others.
        for publisher, child, stamp_ns in arrived:
            is_behind = stamp_ns < self._newest_ns.get(child, stamp_ns) - JUMP_NS
            self._active[publisher, child] = now_s, is_behind
        self._active = {key: last for key, last in self._active.items() if last[0] > now_s - ACTIVE_S}
        went_back = bool(self._active) and all(is_behind for _, is_behind in self._active.values())
        if went_back:
            self._newest_ns.clear()
            self._active.clear()
        for _, child, stamp_ns in arrived:
            # After time went back, the last of each counts, because the first ones may be from before.
            known_ns = stamp_ns if went_back else self._newest_ns.get(child, stamp_ns)
            self._newest_ns[child] = max(stamp_ns, known_ns)
        return [(names[child], stamp_ns) for _, child, stamp_ns in arrived], went_back


class _Target(TransformBroadcaster):
    """
    A topic to which rules send.

    :param publisher: None in a dry run.
    :param dry: gets the transforms in a dry run.
    """

    def __init__(self, topic: str, use: str, publisher: Publisher | None, dry: BufferCore) -> None:
        self.topic = topic
        self.use = use
        self.count: Counter[str] = Counter()
        self.pub_tf = publisher
        self._latched: list[TransformStamped] = []
        self._dry = dry

    def send(self, transforms: list[TransformStamped]) -> None:
        """Send these; static ones only if they differ from those before, which they replace."""
        if transforms == self._latched:
            return
        if self.use == STATIC:
            self._latched = transforms
        self.count.update(messages=1, transforms=len(transforms))
        if self.pub_tf is None:
            self._dry.set_transforms(transforms, "tf2_relay", self.use == STATIC)
        else:
            self.sendTransform(transforms)

    def send_pose(self, pose: PoseStamped | Odometry) -> None:
        """Send a message that is not for tf2."""
        self.count.update(messages=1)
        if self.pub_tf is not None:
            self.pub_tf.publish(pose)


@dataclass
class _Running:
    """A rule that is applied, and the topics to which it sends: dynamic transforms, or poses; static ones."""

    relay: Relay
    targets: list[_Target]
    due_s: float  # of the monotonic clock


class Relaying:
    """
    Applies rules in a node.

    :param path: the file with the rules, which are read again when it changes.
    :param is_dry: publish nothing.
    :param stack: closes what receives transforms.
    :raises UsageError: the rules are wrong.
    """

    def __init__(self, node: Node, path: Path, is_dry: bool, stack: ExitStack) -> None:
        self._node = node
        self._path = path
        self._is_dry = is_dry
        self._stack = stack
        # Topics remain until the program ends, also if the rules no longer name them.
        self._sources: dict[tuple[str, ...], Source] = {}
        self._targets: dict[tuple[str, str], _Target] = {}  # by topic and use
        self._dry: dict[str, BufferCore] = defaultdict(BufferCore)  # by topics
        self._version = _version(path)
        self._apply()

    def run(self, seconds: float) -> None:
        """Relay for this time, or until a signal."""
        end_s = time.monotonic() + seconds
        maintain_s = 0.0
        while (now_s := time.monotonic()) < end_s:
            if now_s >= maintain_s:
                self._maintain(now_s)
                maintain_s = now_s + MAINTAIN_S
            self._look(now_s)
            for one in self._running:
                if now_s >= one.due_s:
                    rate = one.relay.rule.rate
                    period_s = ALL_S if rate == ALL_RATE else 1.0 / rate
                    one.due_s = max(one.due_s + period_s, now_s)
                    self._send_dynamic(one, now_s)
            wake_s = min(now_s + LOOK_S, maintain_s, end_s, *(one.due_s for one in self._running))
            time.sleep(max(wake_s - time.monotonic(), 0.0))

    def report(self) -> Iterator[str]:
        """Describe in lines what was received and sent, or would be, and the trees if nothing was sent."""
        sources, targets = self._sources.values(), self._targets.values()
        for source in sources:
            source.look(time.monotonic())
        if self._is_dry:
            trees = [(f"in, {source.name}", source.buffer) for source in sources]
            trees += [(f"out, {topics}", buffer) for topics, buffer in self._dry.items()]
            for name, buffer in trees:
                yield f"{name}:"
                yield from (f"  {line}" for line in buffer.tree().splitlines())
        counts = [(f"in, {source.name}", source.count) for source in sources]
        counts += [(f"out, {target.topic}", target.count) for target in targets]
        for name, count in counts:
            of_trees = f", {counted(count['transforms'], 'transform')}" if count["transforms"] else ""
            yield f"{name}: {counted(count['messages'], 'message')}{of_trees}"

    def problems(self) -> list[str]:
        """Get a text for each frame that a rule names, but that cannot be sent."""
        return [text for one in self._running for text in one.relay.problems()]

    def _apply(self) -> None:
        """Read the rules, and replace those before."""
        running: list[_Running] = []
        owners: dict[tuple[str, str], tuple[Relay, str]] = {}
        for rule in read_rules(self._path, self._node.resolve_topic_name):
            try:
                source = self._source(rule.source)
                targets = [self._target(rule, topic, use) for topic, use in rule.uses]
            except RuntimeError as refusal:  # of rcl: above all, a topic has messages of another type
                raise UsageError(f"{rule.label}: {refusal}") from None
            running.append(_Running(Relay(rule, source.buffer, owners), targets, time.monotonic()))
        self._running = running
        self._warned: set[str] = set()
        self._patience_s = time.monotonic() + PATIENCE_S

    def _source(self, topics: tuple[str, ...]) -> Source:
        if topics not in self._sources:
            recording = Recording()
            buffer = self._stack.enter_context(filled_buffer(self._node, recording, topics=topics))
            self._sources[topics] = Source(topics, buffer, recording)
        return self._sources[topics]

    def _target(self, rule: Rule, topic: str, use: str) -> _Target:
        if (topic, use) not in self._targets:
            durability = DurabilityPolicy.TRANSIENT_LOCAL if use == STATIC else DurabilityPolicy.VOLATILE
            qos = QoSProfile(depth=1 if use == STATIC else 100, durability=durability)
            kind = {"PoseStamped": PoseStamped, "Odometry": Odometry}.get(use, TFMessage)
            publisher = None if self._is_dry else self._node.create_publisher(kind, topic, qos)
            dry = BufferCore() if rule.pose else self._dry[" and ".join(rule.to)]
            self._targets[topic, use] = _Target(topic, use, publisher, dry)
        return self._targets[topic, use]

    def _maintain(self, now_s: float) -> None:
        """Read the rules if they changed, send static transforms, and warn: what is needed only seldom."""
        log, version = self._node.get_logger(), _version(self._path)
        if not self._is_dry and version != self._version:
            self._version = version
            try:
                self._apply()
                log.info(f"Read {self._path} again")
            except UsageError as refusal:
                log.error(f"{' '.join(str(refusal).split())}; the old rules stay")
        # Nothing on topics that the rules no longer name.
        statics = {
            target: list[TransformStamped]() for target in self._targets.values() if target.use == STATIC
        }
        for one in self._running:
            if not one.relay.rule.pose:
                statics[one.targets[1]] += one.relay.static_transforms()
        for target, transforms in statics.items():
            target.send(transforms)
        if not self._is_dry and now_s >= self._patience_s:
            for problem in {*self.problems()} - self._warned:
                self._warned.add(problem)
                log.warning(printable(problem))

    def _look(self, now_s: float) -> None:
        """Let the rules know what has arrived."""
        clock: Any = self._node.get_clock()
        for source in self._sources.values():
            arrived, went_back = source.look(now_s)
            if went_back and not clock.ros_time_is_active:  # otherwise the buffer follows it
                source.buffer.clear()
                text = "The stamps of all frames went back; forgetting what was received before"
                self._node.get_logger().warning(text)
            for one in self._running:
                if one.relay.buffer is not source.buffer:
                    continue
                if went_back:
                    one.relay.forget()  # and what has just arrived, too
                else:
                    one.relay.note(arrived)

    def _send_dynamic(self, one: _Running, now_s: float) -> None:
        clock_ns = self._node.get_clock().now().nanoseconds
        transforms = one.relay.dynamic_transforms(now_s, clock_ns)
        if not one.relay.rule.pose:
            one.targets[0].send(transforms)
            return
        for transform in transforms:
            one.targets[0].send_pose(pose_message(one.relay, transform))


def pose_message(relay: Relay, transform: TransformStamped) -> Any:
    """Make the message of a rule for a pose."""
    message: Any = PoseStamped(header=transform.header)
    pose = message.pose
    if relay.rule.pose == "Odometry":
        message = Odometry(header=transform.header, child_frame_id=transform.child_frame_id)
        pose = message.pose.pose
        _set_twist(message.twist.twist, relay)
    pose.orientation = transform.transform.rotation
    moved = transform.transform.translation
    pose.position.x, pose.position.y, pose.position.z = moved.x, moved.y, moved.z
    return message


def _set_twist(twist: Any, relay: Relay) -> None:
    parent, child = relay.rule.frames
    interval = Duration(seconds=min(max(AVERAGING_S, 1.0 / relay.rule.rate), MOST_AVERAGING_S))
    with suppress(TransformException):  # there are too few transforms yet
        time_ns = relay.buffer.get_latest_common_time(parent, child)
        linear, angular = relay.buffer.lookupVelocityFullCore(
            child, parent, child, (0.0, 0.0, 0.0), child, time_ns, interval
        )
        twist.linear.x, twist.linear.y, twist.linear.z = linear
        twist.angular.x, twist.angular.y, twist.angular.z = angular


def _version(path: Path) -> tuple[int, ...] | None:
    """What changes whenever a file does; None if it does not exist."""
    try:
        found = path.stat()
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino
