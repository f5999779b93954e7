"""The rules of tf2_relay: read them from YAML, choose and thin out transforms, and name them anew."""

import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, field
from difflib import get_close_matches
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any, NamedTuple

from tf2_py import BufferCore, FrameInfo, TransformException
from tf2_ros import TransformStamped
from tf2_ros_tools.output import not_known
from tf2_ros_tools.program import UsageError, read_list

S = 1_000_000_000
LATEST = 0  # asks a buffer for the newest time at which it has everything that a lookup needs
LAST_NS = (2**31 - 1) * S  # the last stamp that a message can hold
NOW = "now"
TREE, POSES = "TFMessage", ("PoseStamped", "Odometry")


@dataclass(frozen=True)
class Threshold:
    """Only what has moved further is sent: metres, radians; or what was sent ``repeat`` seconds ago."""

    translation: float
    rotation: float
    repeat: float = 1.0


@dataclass(frozen=True)
class Rule:
    """One rule; docs/programs.md explains the keys."""

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
    shift_ns: int | None = 0  # None: such that the first transform is stamped with the present time
    message: str = TREE

    def new_name(self, frame: str) -> str:
        """The name under which a frame is sent."""
        return self.rename.get(frame, self.prefix + frame)


# Read rules.


class _Key(NamedTuple):
    expected: str
    read: Callable[[Any], Any]  # raises a ValueError, or returns None, for what is not as expected


def _text(value: Any) -> str | None:
    return value if isinstance(value, str) and value else None


def _topic(value: Any) -> str | None:
    is_topic = isinstance(value, str) and re.fullmatch(r"(~?/)?[A-Za-z_]\w*(/[A-Za-z_]\w*)*", value, re.ASCII)
    return value if is_topic else None


def _frame(value: Any) -> str | None:
    return _text(value.removeprefix("/")) if isinstance(value, str) else None


def _all_of(read: Callable[[Any], str | None]) -> Callable[[Any], tuple[str | None, ...] | None]:
    def read_all(value: Any) -> tuple[str | None, ...] | None:
        found = tuple(map(read, value if isinstance(value, list) else [value]))
        return found if found and None not in found else None

    return read_all


def _number(value: Any) -> float | None:
    # YAML reads 1e-3 as a string.
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        return None
    number = float(value)
    return number if abs(number) <= LAST_NS / S else None  # which NaN is not either


def _rate(value: Any) -> float | None:
    rate = _number(value)
    return rate if rate is not None and 0.0 < rate <= 1000.0 else None


def _at_least_0(value: Any) -> float | None:
    number = _number(value)
    return number if number is not None and number >= 0.0 else None


def _new_names(value: Any) -> dict[str | None, str | None] | None:
    if not isinstance(value, dict):
        return None
    names = {_frame(old): _frame(new) for old, new in value.items()}
    return names if len({*names.values()}) == len(value) and None not in {*names, *names.values()} else None


_TOPICS = _Key(
    "two topics, for dynamic and static transforms, such as [/relay/tf, /relay/tf_static]", _all_of(_topic)
)
_FRAMES = _Key("the name of a frame, or a list of names", _all_of(_frame))
_LIMIT = _Key("a number that is not negative", _at_least_0)
_KEYS_OF_THRESHOLD = {
    "translation": _LIMIT,
    "rotation": _LIMIT,
    "repeat": _Key("a number of seconds", _at_least_0),
}
_KEYS = {
    "name": _Key("a text", _text),
    "from": _TOPICS,
    "to": _TOPICS,
    "frames": _FRAMES,
    "subtree": _FRAMES,
    "exclude": _FRAMES,
    "collapse": _Key("true or false", lambda value: value if isinstance(value, bool) else None),
    "rate": _Key("a number of Hz above 0, at most 1000", _rate),
    "threshold": _Key(
        "a mapping with translation (m), rotation (rad) and perhaps repeat (s)",
        lambda value: value if isinstance(value, dict) and {"translation", "rotation"} <= {*value} else None,
    ),
    "prefix": _Key("a text", _text),
    "rename": _Key("a mapping from names of frames to different new names", _new_names),
    "shift": _Key(f"a number of seconds, or {NOW}", lambda value: value if value == NOW else _number(value)),
    "as": _Key(f"one of {', '.join(POSES)}", lambda value: value if value in POSES else None),
}


def read_rules(path: Path) -> list[Rule]:
    """
    Read a YAML file: a list of rules.

    :raises UsageError: it cannot be read, or something in it is wrong; the text names the rule and the key.
    """
    document = read_list(path, "tf2_relay", "rules")
    try:
        return [_rule(f"rule {number}", given) for number, given in enumerate(document, start=1)]
    except ValueError as refusal:
        raise UsageError(f"{path}: {refusal}") from None


def _read(label: str, given: Any, keys: Mapping[str, _Key]) -> dict[str, Any]:
    if not isinstance(given, dict):
        raise ValueError(f"{label} must be a mapping with keys such as to and frames, not {given!r}")
    read = {}
    for key, value in given.items():
        if key not in keys:
            near = get_close_matches(str(key), keys, n=1)
            advice = f"did you mean {near[0]}?" if near else f"the keys are {', '.join(keys)}"
            raise ValueError(f"{label}: {key!r} is not a key; {advice}")
        try:
            read[key] = keys[key].read(value)
        except (ValueError, OverflowError):
            read[key] = None
        if read[key] is None:
            raise ValueError(f"{label}: {key} must be {keys[key].expected}, not {value!r}")
    return read


def _rule(label: str, given: Any) -> Rule:
    if isinstance(given, dict) and _text(given.get("name")) is not None:
        label = f"{label} ({given['name']})"
    read = _read(label, given, _KEYS)
    read.pop("name", None)
    if "threshold" in read:
        read["threshold"] = Threshold(**_read(f"{label}: threshold", read["threshold"], _KEYS_OF_THRESHOLD))
    shift = read.pop("shift", 0.0)
    rule = Rule(
        label,
        source=read.pop("from", ("/tf", "/tf_static")),
        to=read.pop("to", ()),
        shift_ns=None if shift == NOW else round(shift * S),
        message=read.pop("as", TREE),
        **read,
    )
    is_pose = rule.message != TREE
    of_tree = bool(rule.subtree or rule.exclude or rule.collapse)
    for is_wrong, text in (
        (not _is_pair(rule.source), f"from must be {_TOPICS.expected}"),
        (not is_pose and not _is_pair(rule.to), f"to must be {_TOPICS.expected}"),
        (is_pose and len(rule.to) != 1, f"to must be one topic, for {rule.message}"),
        (is_pose and not _is_pair(rule.frames), f"frames must be [PARENT, CHILD], for {rule.message}"),
        (is_pose and of_tree, f"subtree, exclude and collapse are not for {rule.message}"),
        (
            len(rule.frames) == 1 and not rule.subtree,
            "frames must be two or more; for one with all below it, use subtree",
        ),
        (
            rule.collapse and not (rule.frames or rule.subtree),
            "collapse needs frames or subtree, for what remains",
        ),
    ):
        if is_wrong:
            raise ValueError(f"{label}: {text}")
    return rule


def _is_pair(names: tuple[str, ...]) -> bool:
    return len(names) == 2 and names[0] != names[1]


def refuse_circles(rules: Collection[Rule], resolve: Callable[[str], str]) -> None:
    """
    Raise a UsageError if transforms would come back to where they were read, or a topic has two uses.

    :param resolve: gives the full name of a topic.
    """
    uses: dict[str, str] = {}
    graph: dict[str, set[str]] = {}
    for rule in rules:
        is_pose = rule.message != TREE
        for topic, use in zip(rule.to, (rule.message if is_pose else "/tf", "/tf_static"), strict=False):
            before = uses.setdefault(resolve(topic), use)
            if before != use:
                raise UsageError(
                    f"{rule.label}: to must not use {topic} like {use}: a rule uses it like {before}"
                )
            graph.setdefault(resolve(topic), set()).update(() if is_pose else map(resolve, rule.source))
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as circle:
        topics = " and ".join(dict.fromkeys(circle.args[1]))
        raise UsageError(f"rules read what they send on {topics}; from and to must differ") from None


# Choose what is sent.


class Link(NamedTuple):
    """A transform that is sent: of ``child`` in ``parent``."""

    parent: str
    child: str
    is_static: bool


def links_of(rule: Rule, frames: Mapping[str, FrameInfo]) -> list[Link]:
    """
    Choose the transforms that a rule sends.

    :param frames: those of the buffer.

    The chosen frames that are connected form a tree, whose root is the frame at which they meet. Frames
    between them are added, or are left out if the rule collapses chains.
    """
    if rule.message != TREE:
        return [Link(rule.frames[0], rule.frames[1], False)] if {*rule.frames} <= frames.keys() else []
    above = {name: _ancestors(name, frames) for name in frames}
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
        between = (
            () if rule.collapse else (one for name in members for one in above[name] if one not in common)
        )
        kept = {*members, top, *between}
        for child in sorted(kept - {top}):
            path = above[child]
            place = next(number for number, name in enumerate(path) if number and name in kept)
            links.append(Link(path[place], child, all(frames[one].static for one in path[:place])))
    return links


def _ancestors(name: str, frames: Mapping[str, FrameInfo]) -> list[str]:
    """The frame, its parent, and so on up to the root; in a loop, up to where it closes."""
    path: dict[str, None] = {}
    above: str | None = name
    while above is not None and above in frames and above not in path:
        path[above] = None
        above = frames[above].parent
    return [*path]


@dataclass
class _Sent:
    """What receivers know of a frame."""

    transform: TransformStamped
    time_s: float  # of the monotonic clock
    withheld: TransformStamped | None = None  # the newest transform, which they do not know


class Relay:
    """
    Applies a rule to a buffer.

    :param owners: the rules that send to the same topics share this dictionary, so that no two of them send
        frames with the same name.
    """

    def __init__(self, rule: Rule, buffer: BufferCore, owners: dict[str, tuple["Relay", str]]) -> None:
        self.rule = rule
        self.buffer = buffer
        self._owners = owners
        self._tree: dict[str, tuple[str | None, bool]] = {}
        self._links: list[Link] = []
        self._conflicts: list[str] = []
        self.forget()

    def forget(self) -> None:
        """Begin anew, because time has jumped back."""
        self._stamps_ns: dict[str, int] = {}  # of the newest transforms
        self._sent: dict[str, _Sent] = {}
        self._offset_ns = self.rule.shift_ns

    def static_transforms(self) -> list[TransformStamped]:
        """All static transforms that the rule sends."""
        return [
            self._named(one)
            for link in self._present_links()
            if link.is_static
            for one in self._look_up(link)
        ]

    def dynamic_transforms(self, now_s: float, clock_ns: int) -> list[TransformStamped]:
        """
        Get the new transforms that receivers need; of each frame, the oldest first.

        :param now_s: the time of the monotonic clock.
        :param clock_ns: the time of the node's clock.
        """
        needed: list[TransformStamped] = []
        for link in self._present_links():
            for transform in () if link.is_static else self._look_up(link):
                stamp_ns = _stamp_ns(transform)
                # A pose of static frames has the stamp 0.
                if stamp_ns == 0 or stamp_ns != self._stamps_ns.get(link.child):
                    self._stamps_ns[link.child] = stamp_ns
                    needed += self._needed(link.child, transform, now_s)
        if self._offset_ns is None and needed:
            self._offset_ns = clock_ns - max(self._stamps_ns.values())
        return [self._named(self._shifted(one)) for one in needed]

    def problems(self) -> list[str]:
        """Get a text for each frame that the rule names and nobody has published, or that it cannot send."""
        named = (*self.rule.frames, *self.rule.subtree, *self.rule.exclude, *self.rule.rename)
        unknown = [name for name in dict.fromkeys(named) if name not in self._tree]
        return [f"{self.rule.label}: {not_known(name, self._tree)}" for name in unknown] + self._conflicts

    def _present_links(self) -> list[Link]:
        frames = self.buffer.frames()
        tree = {name: (info.parent, info.static) for name, info in frames.items()}
        if tree != self._tree:
            self._tree, self._links, self._conflicts = tree, [], []
            found = links_of(self.rule, frames)
            names = {self.rule.new_name(link.parent): link.parent for link in found}
            for link in found:
                name, sender = self.rule.new_name(link.child), (self, link.child)
                if (
                    names.setdefault(name, link.child) == link.child
                    and self._owners.setdefault(name, sender) == sender
                ):
                    self._links.append(link)
                else:
                    self._conflicts.append(
                        f"{self.rule.label}: {link.child} is not sent: {name} is another frame"
                    )
        return self._links

    def _look_up(self, link: Link) -> Iterator[TransformStamped]:
        try:
            yield self.buffer.lookup_transform_core(link.parent, link.child, LATEST)
        except TransformException:
            return  # a chain has no common time yet, or is none any more

    def _needed(self, child: str, transform: TransformStamped, now_s: float) -> Iterator[TransformStamped]:
        limits, sent = self.rule.threshold, self._sent.get(child)
        if limits is not None and sent is not None:
            distance, angle = _difference(transform.transform, sent.transform.transform)
            if distance > limits.translation or angle > limits.rotation:
                if sent.withheld is not None:
                    # Otherwise receivers would interpolate over the time in which it stood still.
                    yield sent.withheld
            elif now_s - sent.time_s < limits.repeat:
                sent.withheld = transform
                return
        if limits is not None:
            self._sent[child] = _Sent(transform, now_s)
        yield transform

    def _shifted(self, transform: TransformStamped) -> TransformStamped:
        if self._offset_ns:
            shifted_ns = min(max(_stamp_ns(transform) + self._offset_ns, 0), LAST_NS)
            transform.header.stamp.sec, transform.header.stamp.nanosec = divmod(shifted_ns, S)
        return transform

    def _named(self, transform: TransformStamped) -> TransformStamped:
        if self.rule.prefix or self.rule.rename:
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
