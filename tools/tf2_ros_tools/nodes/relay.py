# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Send chosen transforms on to other topics, by rules: what the program tf2_relay does.

A ``Rule`` is read from YAML; the help of tf2_relay explains its keys. A ``Relay`` applies a rule to a
buffer: it chooses transforms, thins them out, and names them anew. ``Relaying`` runs all rules of a file in a
node: it subscribes and publishes.
"""

from tf2_ros_tools.nodes.filled_buffer import filled_buffer

import math
import re
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from geometry_msgs.msg import PoseStamped, TransformStamped
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile

from tf2_msgs.msg import TFMessage
from tf2_py import BufferCore, FrameInfo, TransformException, stored_name
from tf2_py.printable import printable
from tf2_ros import TransformBroadcaster
from tf2_ros_tools.common.output import not_known
from tf2_ros_tools.common.pace import Pace
from tf2_ros_tools.common.program import UsageError
from tf2_ros_tools.common.yaml_files import (
    NOT_NEGATIVE,
    Key,
    boolean,
    frame_name,
    nonempty_text,
    number_in,
    read_keys,
    read_list,
)
from tf2_ros_tools.diagnosis.stream_statistics import path_to_root

S = 1_000_000_000
LATEST = 0  # asks a buffer for the newest time at which it has everything that a lookup needs
TOPICS = DYNAMIC, STATIC = "/tf", "/tf_static"
POSE = "PoseStamped"
EXAMPLE = "{to: [/remote/tf, /remote/tf_static], frames: [map, base_link], rate: 5}"


@dataclass(frozen=True)
class Threshold:
    """Send what has moved by more than this, in meters and radians, or is due after ``repeat`` seconds."""

    translation: float
    rotation: float
    repeat: float = 1.0


@dataclass(frozen=True)
class Rule:
    """One rule; the help of tf2_relay explains the keys."""

    label: str  # for messages
    source: tuple[str, ...]
    to: tuple[str, ...]
    frames: tuple[str, ...] = ()
    subtree: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    collapse: bool = False
    rate: float = 10.0
    threshold: Threshold | None = None
    prefix: str = ""
    rename: Mapping[str, str] = field(default_factory=dict)
    is_pose: bool = False  # sends the pose of a frame in another one instead of transforms

    def new_name(self, frame: str) -> str:
        """The name under which a frame is sent."""
        return self.rename.get(frame, stored_name(self.prefix + frame))


# Read rules.


def _topic(value: Any) -> str | None:
    is_topic = isinstance(value, str) and re.fullmatch(r"(~?/)?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", value, re.ASCII)
    return value if is_topic else None


def _names(read: Callable[[Any], str | None], count: int | None = None) -> Callable[[Any], Any]:
    """Reads a name or a list of names; exactly ``count`` different ones, if it is given."""

    def read_names(value: Any) -> tuple[str | None, ...] | None:
        found = tuple(map(read, value if isinstance(value, list) else [value]))
        is_count = count is None or len(found) == len({*found}) == count
        return found if found and None not in found and is_count else None

    return read_names


def _new_names(value: Any) -> dict[str | None, str | None] | None:
    if not isinstance(value, dict):
        return None
    names = {frame_name(old): frame_name(new) for old, new in value.items()}
    return names if len({*names.values()}) == len(value) and None not in {*names, *names.values()} else None


_TWO_TOPICS = "two topics, for dynamic and static transforms, such as [/relay/tf, /relay/tf_static]"
_FRAMES = Key("the name of a frame, or a list of names", _names(frame_name))
_KEYS_OF_THRESHOLD = {
    "translation": NOT_NEGATIVE._replace(is_required=True),
    "rotation": NOT_NEGATIVE._replace(is_required=True),
    "repeat": NOT_NEGATIVE,
}
_KEYS = {
    "name": Key("a text", nonempty_text),
    "from": Key(_TWO_TOPICS, _names(_topic, 2)),
    "to": Key(_TWO_TOPICS, _names(_topic, 2), is_required=True),
    "rate": Key("a number of Hz from 0.0001 to 1000", number_in(0.0001, 1000.0)),
    "threshold": Key("a mapping", lambda value: value),
    "prefix": Key("a text", nonempty_text),
    "rename": Key("a mapping from names of frames to different new names", _new_names),
    "frames": _FRAMES,
    "subtree": _FRAMES,
    "exclude": _FRAMES,
    "collapse": Key("true or false", boolean),
    "as": Key(POSE, lambda value: value if value == POSE else None),
}
_KEYS_OF_POSE = {
    **{key: one for key, one in _KEYS.items() if key not in ("subtree", "exclude", "collapse")},
    "to": Key("one topic, for a pose", _names(_topic, 1), is_required=True),
    "frames": Key("[PARENT, CHILD], for a pose", _names(frame_name, 2), is_required=True),
}


def read_rules(path: Path, resolve: Callable[[str], str]) -> list[Rule]:
    """
    Read a YAML file: a list of rules.

    :param resolve: gives the full name of a topic.
    :raises UsageError: it cannot be read, or something in it is wrong; the text contains the rule and the
        key.
    """
    document = read_list(path, "rules", EXAMPLE)
    try:
        rules = [_rule(f"rule {number}", given, resolve) for number, given in enumerate(document, start=1)]
        sources = {topic for rule in rules for topic in rule.source}
        for rule in rules:
            if read := [topic for topic in rule.to if topic in sources]:
                raise ValueError(f"{rule.label}: 'to': a rule reads from {read[0]}, so none may send to it")
    except (ValueError, RuntimeError) as refusal:  # the latter of rcl: a name is too long
        raise UsageError(f"{path}: {refusal}") from None
    return rules


def _rule(label: str, given: Any, resolve: Callable[[str], str]) -> Rule:
    is_mapping = isinstance(given, dict)
    if is_mapping and nonempty_text(given.get("name")) is not None:
        label = f"{label} ({given['name']})"
    read = read_keys(label, given, _KEYS_OF_POSE if is_mapping and "as" in given else _KEYS)
    if "threshold" in read:
        limits = read_keys(f"{label}: threshold", read["threshold"], _KEYS_OF_THRESHOLD)
        read["threshold"] = Threshold(**limits)
    rule = Rule(
        label,
        source=tuple(map(resolve, read.pop("from", TOPICS))),
        to=tuple(map(resolve, read.pop("to"))),
        is_pose=read.pop("as", None) is not None,
        **{key: value for key, value in read.items() if key != "name"},
    )
    if len(rule.frames) == 1 and not rule.subtree:
        raise ValueError(
            f"{label}: 'frames' needs at least two frames. To send one frame and its descendants, use "
            "'subtree'"
        )
    if rule.collapse and not (rule.frames or rule.subtree):
        raise ValueError(f"{label}: 'collapse' requires 'frames' or 'subtree'")
    return rule


# Choose what is sent.


class Link(NamedTuple):
    """A transform that is sent: of ``child`` in ``parent``."""

    parent: str
    child: str
    is_static: bool  # as all frames on its path


def links_of(rule: Rule, frames: Mapping[str, FrameInfo]) -> list[Link]:
    """
    Choose the transforms that a rule sends.

    :param frames: those of the buffer.

    The chosen frames that are connected form a tree, whose root is the frame at which they meet. Frames
    between them are added, or are left out if the rule collapses chains.
    """
    above = {name: path_to_root(frames, name) for name in frames}

    def link(parent: str, child: str) -> Link:
        between = {*above[parent]} ^ {*above[child]}
        return Link(parent, child, all(frames[one].static for one in between))

    if rule.is_pose:
        return [link(*rule.frames)] if {*rule.frames} <= frames.keys() else []
    excluded, tops = {*rule.exclude}, {*rule.subtree}
    trees: dict[str, list[str]] = {}
    for name, path in sorted(above.items()):
        is_chosen = name in rule.frames or not tops.isdisjoint(path) or not (rule.frames or tops)
        if is_chosen and excluded.isdisjoint(path):
            trees.setdefault(path[-1], []).append(name)
    links = []
    for members in trees.values():
        common = set.intersection(*({*above[name]} for name in members))
        top = next(name for name in above[members[0]] if name in common)
        below = {*members} if rule.collapse else {one for name in members for one in above[name]} - common
        for child in sorted(below - {top}):
            links.append(link(next(one for one in above[child][1:] if one in below or one == top), child))
    return links


@dataclass
class _State:
    """What was sent of a link."""

    newest_ns: int | None = None  # of what was last sent or withheld
    sent: TransformStamped | None = None
    sent_s: float = 0.0  # of the monotonic clock
    withheld: TransformStamped | None = None  # the newest transform, because it has not moved


class Relay:
    """
    Applies a rule to a buffer.

    :param owners: which rule sends which frame, by topic and new name; all rules share it, so that no two of
        them send frames with the same name to a topic.
    """

    def __init__(
        self, rule: Rule, buffer: BufferCore, owners: dict[tuple[str, str], tuple["Relay", str]]
    ) -> None:
        self.rule = rule
        self.buffer = buffer
        self.targets: list[Target] = []  # for dynamic and static transforms, or for poses
        self.pace = Pace(1.0 / rule.rate)
        self._owners = owners
        self._tree: dict[str, tuple[str | None, bool]] = {}
        self._links: list[Link] = []
        self._conflicts: list[str] = []
        self._states: defaultdict[str, _State] = defaultdict(_State)  # by child

    def static_transforms(self) -> list[TransformStamped]:
        """All static transforms that the rule sends."""
        newest = (self._look_up(link) for link in self._present_links() if link.is_static)
        return [self._named(one) for one in newest if one is not None]

    def dynamic_transforms(self, now_s: float, clock_ns: int) -> list[TransformStamped]:
        """
        Get the new transforms that receivers need, and the last ones at rest of frames that begin to move.

        :param now_s: the time of the monotonic clock.
        :param clock_ns: the time of the node's clock.
        """
        needed: list[TransformStamped] = []
        for link in self._present_links():
            if link.is_static and not self.rule.is_pose:
                continue
            state = self._states[link.child]
            if (transform := self._new(link, state, clock_ns)) is not None:
                needed += self._needed(transform, state, now_s)
        return [self._named(one) for one in needed]

    def problems(self) -> list[str]:
        """Get a text for each frame that the rule names and nobody has published, or that it cannot send."""
        named = (*self.rule.frames, *self.rule.subtree, *self.rule.exclude, *self.rule.rename)
        unknown = [name for name in dict.fromkeys(named) if name not in self._tree]
        return [f"{self.rule.label}: {not_known(name, self._tree)}" for name in unknown] + self._conflicts

    def _look_up(self, link: Link) -> TransformStamped | None:
        try:
            return self.buffer.lookup_transform_core(link.parent, link.child, LATEST)
        except TransformException:
            return None  # a chain has no common time yet, or is none any more

    def _present_links(self) -> list[Link]:
        frames = self.buffer.frames()
        tree = {name: (info.parent, info.static) for name, info in frames.items()}
        if tree != self._tree:
            self._tree, self._links, self._conflicts = tree, [], []
            found = links_of(self.rule, frames)
            names = {self.rule.new_name(link.parent): link.parent for link in found}
            for link in found:
                name, sender = self.rule.new_name(link.child), (self, link.child)
                owners = [self._owners.setdefault((topic, name), sender) for topic in self.rule.to]
                if names.setdefault(name, link.child) == link.child and {*owners} == {sender}:
                    self._links.append(link)
                else:
                    self._conflicts.append(
                        f"{self.rule.label}: {link.child} is not sent: the name {name} is already used"
                    )
        return self._links

    def _new(self, link: Link, state: _State, clock_ns: int) -> TransformStamped | None:
        """Get the newest transform of a link, unless it is known."""
        newest = self._look_up(link)
        if newest is None:
            return None
        if link.is_static:  # a pose of frames that do not move
            newest.header.stamp.sec, newest.header.stamp.nanosec = divmod(clock_ns, S)
        before_ns, state.newest_ns = state.newest_ns, _stamp_ns(newest)
        if before_ns is not None and state.newest_ns < before_ns:
            state.withheld = None  # simulated time went back, which cleared the buffer
        return None if state.newest_ns == before_ns else newest

    def _needed(self, transform: TransformStamped, state: _State, now_s: float) -> Iterator[TransformStamped]:
        limits = self.rule.threshold
        if limits is not None and state.sent is not None:
            distance, angle = _difference(transform.transform, state.sent.transform)
            if distance > limits.translation or angle > limits.rotation:
                if state.withheld is not None:
                    # Otherwise receivers would interpolate over the time in which it stood still.
                    yield state.withheld
            elif now_s - state.sent_s < limits.repeat:
                state.withheld = transform
                return
        state.sent, state.sent_s, state.withheld = transform, now_s, None
        yield transform

    def _named(self, transform: TransformStamped) -> TransformStamped:
        transform.header.frame_id = self.rule.new_name(transform.header.frame_id)
        transform.child_frame_id = self.rule.new_name(transform.child_frame_id)
        return transform


def _stamp_ns(transform: TransformStamped) -> int:
    return int(transform.header.stamp.sec * S + transform.header.stamp.nanosec)


def _difference(one: Any, other: Any) -> tuple[float, float]:
    """The distance between two transforms, and the angle, which is exact also if it is small."""
    t, u, q, r = one.translation, other.translation, one.rotation, other.rotation
    p = (q.x, q.y, q.z, q.w)
    apart = math.dist(p, (r.x, r.y, r.z, r.w)), math.dist(p, (-r.x, -r.y, -r.z, -r.w))
    return math.dist((t.x, t.y, t.z), (u.x, u.y, u.z)), 4.0 * math.atan2(min(apart), max(apart))


# Apply rules in a node.


MAINTAIN_S = 0.5  # between two looks at static transforms
PATIENCE_S = 5.0  # until a warning about a frame that nobody has published


class Target(TransformBroadcaster):
    """
    A topic to which rules send.

    :param use: DYNAMIC, STATIC or POSE.
    """

    def __init__(self, use: str, publisher: Publisher) -> None:
        self.use = use
        self.pub_tf = publisher
        self._latched: list[TransformStamped] = []

    def send(self, transforms: list[TransformStamped]) -> None:
        """Send these, unless they are none, or static ones that were sent before."""
        if self.use == POSE:
            for one in transforms:
                message = PoseStamped(header=one.header)
                message.pose.orientation = one.transform.rotation
                moved, place = one.transform.translation, message.pose.position
                place.x, place.y, place.z = moved.x, moved.y, moved.z
                self.pub_tf.publish(message)
        elif transforms != self._latched:
            if self.use == STATIC:
                self._latched = transforms
            self.sendTransform(transforms)


class Relaying:
    """
    Applies rules in a node.

    :param path: the file with the rules.
    :param stack: closes what receives transforms.
    :raises UsageError: the rules are wrong.
    """

    def __init__(self, node: Node, path: Path, stack: ExitStack) -> None:
        self._node = node
        self._stack = stack
        self._sources: dict[tuple[str, ...], BufferCore] = {}
        self._targets: dict[tuple[str, str], Target] = {}  # by topic and use
        self._relays: list[Relay] = []
        owners: dict[tuple[str, str], tuple[Relay, str]] = {}
        for rule in read_rules(path, node.resolve_topic_name):
            relay = Relay(rule, self._buffer(rule.source), owners)
            try:
                uses = [POSE] if rule.is_pose else TOPICS
                relay.targets = [self._target(*one) for one in zip(rule.to, uses, strict=True)]
            except RuntimeError as refusal:  # of rcl: above all, a topic has messages of another type
                raise UsageError(f"{path}: {rule.label}: {refusal}") from None
            self._relays.append(relay)
        self._warned: set[str] = set()
        self._patience_s = time.monotonic() + PATIENCE_S

    def run(self) -> NoReturn:
        """Relay until a signal."""
        maintaining = Pace(MAINTAIN_S)
        paces = [maintaining, *(relay.pace for relay in self._relays)]
        while True:
            now_ns = time.monotonic_ns()
            if now_ns >= maintaining.due_ns:
                self._maintain(now_ns / S)
            for relay in self._relays:
                if now_ns >= relay.pace.due_ns:
                    clock_ns = self._node.get_clock().now().nanoseconds
                    relay.targets[0].send(relay.dynamic_transforms(now_ns / S, clock_ns))
            for pace in paces:
                pace.advance(now_ns)
            wake_ns = min(pace.due_ns for pace in paces)
            time.sleep(max(wake_ns - time.monotonic_ns(), 0) / S)

    def _buffer(self, topics: tuple[str, ...]) -> BufferCore:
        if topics not in self._sources:
            self._sources[topics] = self._stack.enter_context(filled_buffer(self._node, topics=topics))
        return self._sources[topics]

    def _target(self, topic: str, use: str) -> Target:
        if (topic, use) not in self._targets:
            durability = DurabilityPolicy.TRANSIENT_LOCAL if use == STATIC else DurabilityPolicy.VOLATILE
            qos = QoSProfile(depth=1 if use == STATIC else 100, durability=durability)
            kind = PoseStamped if use == POSE else TFMessage
            publisher = self._node.create_publisher(kind, topic, qos)
            self._targets[topic, use] = Target(use, publisher)
        return self._targets[topic, use]

    def _maintain(self, now_s: float) -> None:
        """Send static transforms, and warn: what is needed only seldom."""
        statics: defaultdict[Target, list[TransformStamped]] = defaultdict(list)
        for relay in self._relays:
            if not relay.rule.is_pose:
                statics[relay.targets[1]] += relay.static_transforms()
        for target, transforms in statics.items():
            target.send(transforms)
        if now_s >= self._patience_s:
            problems = {problem for relay in self._relays for problem in relay.problems()}
            for problem in problems - self._warned:
                self._warned.add(problem)
                self._node.get_logger().warning(printable(problem))
