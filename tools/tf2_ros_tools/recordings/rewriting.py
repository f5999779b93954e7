# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Write a recording anew, with other transforms and names of frames; the rest remains as it was recorded."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import partial
from os import PathLike
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from tf2_py import BufferCore, History, stored_name
from tf2_py.atomic_files import whole_file
from tf2_py.printable import printable
from tf2_py.typing import TimeLike
from tf2_ros import TransformStamped
from tf2_ros.serialization import MessageSource, read_transforms, serialize_arrays, serialize_transforms
from tf2_ros_tools.common.bools import bool_of
from tf2_ros_tools.common.optional_libraries import require
from tf2_ros_tools.common.output import not_known
from tf2_ros_tools.common.program import UsageError
from tf2_ros_tools.common.static_transforms import check_tree, normalize, read_file
from tf2_ros_tools.recordings.bag_loader import (
    DESCRIPTION,
    FROM_URDF,
    TOPICS,
    BagContents,
    PoseTopics,
    Topics,
    Urdfs,
    Wanted,
    check_times,
    poses_on,
    progress_bar,
    read_contents,
    robots_of,
    sources_of,
    wanted,
)
from tf2_ros_tools.recordings.bag_reader import (
    LAST_NS,
    TF_TYPES,
    BagError,
    Raw,
    Recorded,
    S,
    is_static,
    listed,
    open_recording,
)
from tf2_ros_tools.recordings.copying import Channel, Item, Key, Mcaps, Others, Output, in_ros_2
from tf2_ros_tools.recordings.frame_names import Names, renaming
from tf2_ros_tools.recordings.joints_and_poses import EMPTY, Joints, Source, converted
from tf2_ros_tools.recordings.saved_buffers import DYNAMIC, STATIC
from tf2_ros_tools.recordings.trajectories import Trajectory
from tf2_ros_tools.urdf import fixed, one_in_a_loop

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

LAST_STAMP_NS = ((1 << 31) - 1) * S  # in 2038; a wrong clock gives later log times
Change: TypeAlias = Callable[[Item], "Raw | None"]


@dataclass(frozen=True)
class Edits:
    """
    What to change; see :func:`rewrite`.

    :param what: the topics with the transforms and their prefixes, the part of the recording, and what
        becomes transforms.
    :param statics: replace all recorded transforms of their frames; with new names.
    :param dropped: frames whose transforms are left out, with the parent in which they are; None: in any.
    :param renamed: new names of frames by the recorded ones.
    :param prefix: is put in front of the names of all frames that are not in ``renamed``, on all topics.
    :param only_transforms: whether all other topics are left out.
    :raises ValueError: nothing would change, or one contradicts another.
    """

    what: Wanted
    statics: Sequence[TransformStamped] = ()
    dropped: Collection[tuple[str | None, str]] = ()
    renamed: Mapping[str, str] = field(default_factory=dict)
    prefix: str = ""
    only_transforms: bool = False

    def __post_init__(self) -> None:
        what = self.what
        prefixes = {*what.prefixes.values()}
        selects = what.limited or what.others or self.only_transforms
        names = self.renamed or self.prefix or any(prefixes)
        if not (selects or names or self.statics or self.dropped or what.trajectory):
            raise ValueError(
                "nothing to change: expected a trajectory, statics, or something to drop or rename"
            )
        _refuse_names("rename", self.renamed.values())
        _refuse_names("prefix", filter(None, (self.prefix, *map(stored_name, prefixes))))
        if self.prefix and any(prefixes):
            raise ValueError("expected `prefix` (--prefix) or prefixes of topics (--topic), got both")
        if self.statics and len(prefixes) > 1:
            raise ValueError("statics are of one robot: expected its topics, got those of several")
        if what.robots and len(prefixes) > 1:  # whose fixed joints become static transforms
            raise ValueError("a URDF is of one robot: expected its topics, got those of several")
        if what.trajectory is None:
            return
        if len(prefixes) > 1:
            raise ValueError("a trajectory is of one robot: expected its topics, got those of several")
        child = what.trajectory.child
        new = self.renamed.get(child, f"{self.prefix or stored_name(next(iter(prefixes)))}{child}")
        given = [one.child_frame_id for one in self.statics]
        if new in given or child in [one for _, one in self.dropped]:
            raise ValueError(f"the trajectory replaces the transforms of {child}: statics and drop must not")

    def prefix_of(self, topic: str) -> str | None:
        """Get the prefix of the frames on a topic; None: the topic remains as it is."""
        found = self.what.prefix_of(topic) if any(self.what.prefixes.values()) else self.prefix
        return found and stored_name(found)

    def topic(self, *, static: bool, near: str = "") -> str:
        """
        Get the topic for new transforms.

        :param near: the topic that they are from.
        """
        named = [one for one in self.what.with_transforms if is_static(one) == static]
        if not named:
            name = STATIC if static else DYNAMIC
            return f"{next(iter(self.what.prefixes)).rpartition('/')[0]}{name}"
        return max(named, key=lambda one: len(os.path.commonprefix((one.rpartition("/")[0] + "/", near))))


def _refuse_names(argument: str, names: Iterable[str]) -> None:
    """
    Refuse new names of frames, or prefixes of these, that would make frames which cannot be looked up.

    :raises ValueError: one is.
    """
    for name in names:
        if not name or name.startswith("/") or "\0" in name:
            raise ValueError(f"{argument}: expected the name of a frame, got {name!r}")
        try:
            name.encode()
        except UnicodeEncodeError:
            raise ValueError(f"{argument}: expected a name in UTF-8, got {name!r}") from None


def rewrite(
    recording: str | PathLike[str],
    output: str | PathLike[str],
    *,
    topics: Topics = TOPICS,
    start: TimeLike | None = None,
    end: TimeLike | None = None,
    poses: PoseTopics | None = None,
    urdf: Urdfs = None,
    trajectory: Trajectory | None = None,
    statics: str | PathLike[str] | Iterable[TransformStamped] = (),
    drop: Iterable[str | tuple[str, str]] = (),
    rename: Mapping[str, str] = {},
    prefix: str = "",
    only_transforms: bool = False,
    progress: bool | None = None,
) -> None:
    """
    Write a recording with all its topics to an ``.mcap`` file, with other transforms or names of frames.

    Names in ``drop``, ``rename`` and ``trajectory`` are those of the recording, those in ``statics`` are the
    new ones.

    :param recording: see :func:`load`.
    :param output: the file, which is replaced when the new one is complete.
    :param topics: the topics with the transforms. A mapping of names to prefixes changes the names of frames
        on these topics and on all topics below their namespaces, and no others.
    :param start: leave out what was recorded before this log time. Of static and transient-local topics, all
        messages remain, and those from before are moved to this time. None: from the beginning.
    :param end: likewise, what was recorded after this log time. None: to the end.
    :param poses: see :func:`load`; the transforms are added to the topic with transforms.
    :param urdf: see :func:`load`; likewise.
    :param trajectory: corrects the transforms of a frame; see :func:`load`.
    :param statics: static transforms, or a YAML file with them, as for ``static_transform_publisher --file``.
        They replace all recorded transforms of their frames.
    :param drop: frames whose transforms are left out, or pairs ``(parent, frame)``.
    :param rename: new names by the recorded ones.
    :param prefix: is put in front of the names of all other frames, on all topics.
    :param only_transforms: leave out all topics but ``topics``.
    :param progress: see :func:`load`.
    :raises BagError: see :func:`load`; or a frame that was named does not exist. Nothing is written then.
    :raises OSError: the file cannot be written. An existing file remains unchanged.
    :raises TypeError, ValueError: see :func:`load`; or nothing would change, or arguments contradict each
        other; or ``output`` is the recording, or not a file.

    Warnings are those of :func:`load`, and name topics whose frames keep their names, but should not.
    """
    if not isinstance(prefix, str):
        raise TypeError(f"prefix: expected a str, got {type(prefix).__name__}")
    edits = Edits(
        wanted(topics, start, end, poses, urdf, trajectory),
        _read_statics(statics),
        _read_drop(drop),
        _read_rename(rename),
        stored_name(prefix),
        bool_of(only_transforms, "only_transforms"),
    )
    for text in write(recording, output, edits, progress):
        warnings.warn(f"{printable(os.fspath(recording))}: {text}", stacklevel=2)


def _read_drop(given: Iterable[str | tuple[str, str]]) -> list[tuple[str | None, str]]:
    if isinstance(given, str):
        raise TypeError(f"drop: expected a list of frames, got a str: use [{given!r}]")
    dropped: list[tuple[str | None, str]] = []
    for one in given:
        match one:
            case str(child):
                dropped.append((None, stored_name(child)))
            case (str(parent), str(child)):
                dropped.append((stored_name(parent), stored_name(child)))
            case _:
                raise TypeError(f"drop: expected a frame or a pair (parent, frame), got {one!r}")
    return dropped


def _read_rename(given: Mapping[str, str]) -> dict[str, str]:
    if not isinstance(given, Mapping):
        raise TypeError(f"rename: expected a dict of names, got {type(given).__name__}")
    for name in (*given, *given.values()):
        if not isinstance(name, str):
            raise TypeError(f"rename: expected the name of a frame, got {name!r}")
    names = {stored_name(old): stored_name(new) for old, new in given.items()}
    if len(names) < len(given):
        raise ValueError("rename: expected one new name of each frame, got two of one")
    return names


def _read_statics(given: str | PathLike[str] | Iterable[TransformStamped]) -> list[TransformStamped]:
    if isinstance(given, str | PathLike):
        try:
            return read_file(Path(given))
        except UsageError as refusal:
            raise ValueError(str(refusal)) from None
    statics, buffer = deepcopy([*given]), BufferCore()
    for one in statics:
        if not (hasattr(one, "header") and hasattr(one, "child_frame_id")):
            raise TypeError(f"statics: expected a TransformStamped, got {type(one).__name__}")
        one.header.frame_id, one.child_frame_id = map(stored_name, (one.header.frame_id, one.child_frame_id))
    check_tree("statics", statics)
    if buffer.set_transforms(statics, "statics", static=True) < len(statics):
        raise ValueError("statics: a buffer refuses some of them, and has logged why")
    return statics


def write(
    path: str | PathLike[str], output: str | PathLike[str], edits: Edits, progress: bool | None = None
) -> list[str]:
    """
    Rewrite a recording.

    :return: sentences to warn of.
    :raises BagError, OSError, ValueError: see :func:`rewrite`.
    """
    require("mcap", "bag")
    _refuse_output(Path(path), Path(output))
    with open_recording(path) as recorded:
        check_times(recorded, edits.what)
        _check_topics(recorded, edits.what)
    heard = _heard(path, edits.what, progress)
    with (
        whole_file(output) as file,
        in_ros_2(Path(path), Path(output).parent) as own,
        open_recording(own) as recorded,
    ):
        recorded.path = os.fspath(path)
        source = Mcaps(recorded) if recorded.is_mcap else Others(recorded)
        target = Output(file, source)
        edited = _Rewriting(target, recorded, edits, heard, source.channels)
        total = sum(one.count for one in recorded.topics.values())
        with progress_bar(recorded.path, total, " messages", progress) as count:
            last_ns = None
            try:
                for item in target.items():
                    edited.add(item)
                    last_ns = item.log_ns
                    count(1)
            except Exception as error:
                reason = recorded.explain(error, last_ns)
                if reason is error:
                    raise
                raise reason from error
        edited.finish()
        target.finish()
        notes = [] if heard is None else heard.warnings
        return [*notes, *edited.notes(), *recorded.shortfalls(recorded.topics)]


def _refuse_output(path: Path, output: Path) -> None:
    """
    Refuse to write over the recording, into its folder, or to what is not a file.

    :raises ValueError: so it would be.
    """
    recorded, written = (Path(os.path.realpath(one)) for one in (path, output))
    if recorded in (written, *written.parents):
        raise ValueError(f"{printable(str(output))} is the recording; choose another file")
    if output.exists() and not output.is_file():
        raise ValueError(f"{printable(str(output))} is not a file; choose another one")


def _check_topics(recorded: Recorded, what: Wanted) -> None:
    """
    Check that the topics with transforms can be edited.

    :raises BagError: see :func:`tf2_ros_tools.bag.load`; or they are not in CDR, as those of Foxglove.
    """
    name = printable(recorded.path)
    # Those that nobody named may be missing.
    named = {*what.prefixes, *what.others} - ({*TOPICS} if {*what.prefixes} == {*TOPICS} else set())
    if missing := named - recorded.topics.keys():
        raise BagError(f"{name} has no topic {listed(missing)}; its topics are {listed(recorded.topics)}")
    if not named and recorded.topics.keys().isdisjoint(TOPICS):
        return
    encoding = "ros1" if recorded.files[0].suffix == ".bag" else "cdr"
    for one in sources_of(recorded, what):
        about = recorded.topics[one.topic]
        for role, given, expected in (
            ("type", about.msgtype, TF_TYPES),
            ("encoding", about.encoding, (encoding,)),
        ):
            if given not in expected:
                where = f"{name}, topic {printable(one.topic)}"
                raise BagError(f"{where}: expected the {role} {expected[0]}, got {printable(given)}")


def _heard(path: str | PathLike[str], what: Wanted, progress: bool | None) -> BagContents | None:
    """Get the transforms with recorded names, if a trajectory corrects them, or others become transforms."""
    if what.trajectory is None and not what.others:
        return None
    what = replace(what, prefixes=dict.fromkeys(what.prefixes, ""))
    return read_contents(path, what, records=bool(what.robots), progress=progress)


class _NewNames:
    """The new names of frames, topic by topic, and the tree that these frames are in."""

    def __init__(self, recorded: Recorded, edits: Edits) -> None:
        self._recorded, self._edits = recorded, edits
        self._by_prefix: dict[str, Names] = {}
        self._outside: dict[str, Names] = {}  # topics of other namespaces, whose frames keep their names
        self._unknown: dict[str, list[str]] = {}  # other topics whose frames do, by the reason
        self._new: set[str] = set()  # names of the frames with transforms, and of their parents
        self._parents: dict[str, str] = {}  # the last one of each, with new names
        self._recorded_parents: dict[str, str] = {}
        self._children: dict[str, set[str]] = {}  # those with transforms, by the new name

    def on(self, topic: str) -> Names:
        """Get the names of the frames on a topic."""
        prefix = self._edits.prefix_of(topic)
        if prefix is None:
            return self._outside.setdefault(topic, Names({}, ""))
        return self._by_prefix.setdefault(prefix, Names(self._edits.renamed, prefix))

    def renaming(self, about: Connection) -> Change | None:
        """Get what renames the frames in the messages of a topic without transforms; None: nothing does."""
        names = self.on(about.topic)
        is_outside = about.topic in self._outside  # its frames are only read
        if not about.msgcount or not (names or is_outside):
            return None
        try:
            rename = renaming(about, names)
        except Exception as error:  # the parsers define error classes only for some kinds of damage
            if not is_outside:
                why = shorten(str(error) or repr(error), 120, placeholder=" …")  # it may quote a definition
                self._unknown.setdefault(why, []).append(about.topic)
            return None

        def renamed(item: Item) -> Raw:
            assert rename is not None
            try:
                return rename(item.raw)
            except Exception as error:  # likewise
                self._recorded.malformed(about.topic, item.log_ns, ValueError(str(error) or repr(error)))

        return rename and renamed

    def rename(self, one: TransformStamped, names: Names, topic: str, log_ns: int) -> bool:
        """Rename the frames of a transform; return whether something has changed."""
        before = one.header.frame_id, one.child_frame_id
        parent, child = map(names.of, before)
        new_parent, new_child = map(stored_name, (parent, child))
        self._new.update((new_parent, new_child))
        self._parents[new_child] = new_parent
        old_parent, old_child = map(stored_name, before)
        self._recorded_parents[old_child] = old_parent
        self._children.setdefault(new_child, set()).add(old_child)
        if new_parent == new_child and old_parent != old_child:
            both = " and ".join(before)
            text = f"the frames {both}, which a transform connects, would both be {parent}"
            self._recorded.malformed(topic, log_ns, ValueError(text))
        one.header.frame_id, one.child_frame_id = parent, child
        return before != (parent, child)

    def seen(self) -> set[str]:
        """Get the recorded names of all frames, except those on topics of other namespaces."""
        return set().union(*(one.seen for one in self._by_prefix.values()))

    def notes(self, given: Mapping[str, TransformStamped]) -> Iterator[str]:
        """
        Say which new transforms are not connected, and which topics name frames as before.

        :param given: the new static transforms, by their frames.
        """
        changed: set[str] = set().union(*(one.changed for one in self._by_prefix.values()))
        parents = {one.header.frame_id for one in given.values()} - self._new - {*given}
        if self._new and parents:
            advice = "; `statics` has the new names of frames" if parents & changed else ""
            yield f"no recorded transform has {listed(parents)}, the parent of a new static one{advice}"
        described = [
            topic
            for topic in self._recorded.topics
            if topic.rpartition("/")[2] == DESCRIPTION and self._edits.prefix_of(topic) is not None
        ]
        if changed and described:
            yield f"frames keep their names in the URDF on {listed(described)}"
        for why, topics in self._unknown.items():
            yield f"frames keep their names on {listed(topics)}: {why}"
        parents_of_given = {child: stored_name(one.header.frame_id) for child, one in given.items()}
        trees = self._recorded_parents, self._parents, {**self._parents, **parents_of_given}
        old, renamed, final = map(one_in_a_loop, trees)
        if final is not None and renamed is None:
            yield f"with the new static transforms, {printable(final)} is its own ancestor"
        if renamed is not None and old is None:
            yield f"with the new names, {printable(renamed)} is its own ancestor"
        for child, recorded in self._children.items():
            if len(recorded) > 1:
                yield f"the transforms of {listed(recorded)} are now all of {printable(child)}"
        outside = [topic for topic, names in self._outside.items() if names.seen & changed]
        if outside:
            yield f"renamed frames keep their names on {listed(outside)}, topics of other namespaces"


class _Rewriting:
    """Writes the messages of a recording, changed."""

    def __init__(
        self,
        output: Output,
        recorded: Recorded,
        edits: Edits,
        heard: BagContents | None,
        channels: Mapping[Key, Channel],
    ) -> None:
        what = edits.what
        self._output, self._recorded, self._edits = output, recorded, edits
        self._begin_ns = -LAST_NS if what.start_ns is None else what.start_ns
        self._end_ns = LAST_NS if what.end_ns is None else what.end_ns
        self._names = _NewNames(recorded, edits)
        self._frames: set[str] = set()  # those with transforms, and their parents
        self._used: set[tuple[str | None, str]] = set()  # of `dropped`
        self._moved: _Samples | None = None
        self._given = {stored_name(one.child_frame_id): one for one in edits.statics}
        if what.trajectory is not None and heard is not None:
            names = self._names.on(edits.topic(static=False))
            history, odometry, moving = what.trajectory.played(heard.buffer)
            self._refuse_other_odometry(odometry, names)
            self._moved = _Samples(names, history, moving)
        self._sources = {} if heard is None else self._converters(heard)
        self._statics = {**self._given}  # with those recorded so far
        self._last: tuple[int, Item] | None = None  # message with dynamic transforms
        self._numbers: dict[str, int] = {}  # of the channels with transforms
        self._static_topic = edits.topic(static=True) if self._given else ""
        self._topics = {*what.with_transforms, self._static_topic}
        self._changes = {key: self._change(key, one) for key, one in channels.items()}
        self._latched = {
            key for key, one in channels.items() if one.is_latched or is_static(one.connection.topic)
        }
        if self._given:
            self._publish_statics()

    def _refuse_other_odometry(self, odometry: Collection[str], names: Names) -> None:
        """
        Refuse a trajectory if the transforms to the frame whose poses it has will be others than recorded.

        :raises BagError: so it is; the corrected transforms would not lead to these poses.
        """
        several = {child for parent, child in self._edits.dropped if parent is not None}
        for frame in odometry:
            if frame in several or names.of(frame) in self._given:
                raise BagError(
                    f"{printable(self._recorded.path)}: the trajectory is computed with the recorded"
                    f" transforms of {printable(frame)}, which statics or drop change: rewrite the recording"
                    " with these first, and the file that is written with the trajectory"
                )

    def add(self, item: Item) -> None:
        """Write a message of the recording, unless it is left out or loses all its transforms."""
        if not self._begin_ns <= item.log_ns <= self._end_ns:
            if item.channel not in self._latched:
                return
            item = item._replace(log_ns=min(max(item.log_ns, self._begin_ns), self._end_ns))
        change = self._changes[item.channel]
        raw = item.raw if change is None else change(item)
        number = self._output.numbers.get(item.channel)
        if raw is not None and number is not None:
            self._output.write(number, item, raw)

    # What happens to the messages of a topic.

    def _change(self, key: Key, channel: Channel) -> Change | None:
        """Copy a channel, and get what changes its messages; None: nothing does."""
        about = channel.connection
        topic = about.topic
        if topic in self._topics:
            number = self._output.add_channel(key, channel)
            self._numbers.setdefault(topic, number)
            names = self._names.on(topic)
            return lambda item: self._transforms(item, topic, number, names)
        rename: Change | None = None
        if not self._edits.only_transforms:
            self._output.add_channel(key, channel)
            rename = self._names.renaming(about)
        return partial(self._convert, about, rename) if topic in self._sources else rename

    def _converters(self, heard: BagContents) -> dict[str, Source]:
        """Get what makes transforms of poses and joint states. Fixed joints become new static transforms."""
        what, robots = self._edits.what, robots_of(self._recorded, self._edits.what)
        computed = [i for i, name in enumerate(heard.publishers) if name in {FROM_URDF, *robots}]
        recorded = heard.records["child"][~np.isin(heard.records["publisher"], computed)]
        known = {heard.frames[child] for child in np.unique(recorded)}
        for topic, robot in robots.items():
            names = self._names.on(topic)
            for one in read_transforms(fixed(robot, known), MessageSource(FROM_URDF)):
                if self._keeps(one):
                    self._names.rename(one, names, FROM_URDF, 0)
                    self._given.setdefault(one.child_frame_id, one)
        joints = {topic: Joints(robot, known) for topic, robot in robots.items()}
        return {**poses_on(self._recorded, what), **joints}

    def _convert(self, about: Connection, rename: Change | None, item: Item) -> Raw | None:
        """Write the transforms of a pose or a joint state, and get its message."""
        own = [(about, item.log_ns, item.raw)]
        [(_, _, raw)] = converted(own, self._sources, self._recorded.malformed)
        if raw != EMPTY:
            topic = self._edits.topic(static=False, near=about.topic)
            number, names = self._number_of(topic, DYNAMIC), self._names.on(about.topic)
            data = self._transforms(item._replace(raw=raw), topic, number, names)
            if data is not None:
                self._output.write(number, item, data)
        return item.raw if rename is None else rename(item)

    def _number_of(self, topic: str, like: str) -> int:
        if topic not in self._numbers:
            self._numbers[topic] = self._output.add_transforms(topic, like)
        return self._numbers[topic]

    # What happens to transforms.

    def _transforms(self, item: Item, topic: str, number: int, names: Names) -> Raw | None:
        """Change the transforms of a message; None: it has lost all of them."""
        try:
            found = read_transforms(item.raw, MessageSource(topic))
        except ValueError as error:
            self._recorded.malformed(topic, item.log_ns, error)
        kept = [one for one in found if self._keeps(one)]
        due = [] if is_static(topic) else self._due(found)
        is_renamed = [self._names.rename(one, names, topic, item.log_ns) for one in kept]
        kept = [one for one in kept if stored_name(one.child_frame_id) not in self._given]
        if topic == self._static_topic:  # a late subscriber gets only the last message
            self._statics.update((stored_name(one.child_frame_id), one) for one in kept)
            return serialize_transforms(self._statics.values())
        if not is_static(topic):
            self._last = number, item
        if due or any(is_renamed) or len(kept) < len(found):
            return serialize_transforms([*kept, *due]) if kept or due else None
        return item.raw

    def _keeps(self, one: TransformStamped) -> bool:
        """Whether a transform is neither dropped nor replaced by corrected ones."""
        child, parent = stored_name(one.child_frame_id), stored_name(one.header.frame_id)
        self._frames.update((child, parent))
        drops = {(None, child), (parent, child)}.intersection(self._edits.dropped)
        self._used |= drops
        return not drops and (self._moved is None or child != self._moved.frame)

    def _due(self, found: Sequence[TransformStamped]) -> list[TransformStamped]:
        """Take the corrected samples up to the newest odometry of a message."""
        if self._moved is None:
            return []
        clocks = self._moved.clocks
        stamps = [
            one.header.stamp for one in found if not clocks or stored_name(one.child_frame_id) in clocks
        ]
        return self._moved.until(max(one.sec * S + one.nanosec for one in stamps)) if stamps else []

    def _publish_statics(self) -> None:
        """Write the new static transforms as the first message."""
        number = self._number_of(self._static_topic, STATIC)
        time_ns = max(self._recorded.start_ns or 0, self._begin_ns)
        for one in self._given.values():
            normalize(one)
            one.header.stamp.sec, one.header.stamp.nanosec = divmod(min(time_ns, LAST_STAMP_NS), S)
        data = serialize_transforms(self._given.values())
        self._output.write(number, Item((0, 0), time_ns, time_ns, 0, data), data)

    def finish(self) -> None:
        """
        Write the corrected samples that are left.

        :raises BagError: a frame that was named is not there.
        """
        left = [] if self._moved is None else self._moved.until(None)
        if left and self._last is not None:
            number, item = self._last
            self._output.write(number, item, serialize_transforms(left))
        name, seen = printable(self._recorded.path), self._frames | self._names.seen()
        for frame in self._edits.renamed:
            if frame not in seen:
                raise BagError(f"{name}: {not_known(frame, seen)}")
        for parent, child in self._edits.dropped:
            if (parent, child) not in self._used:
                if child not in self._frames or parent is None:
                    raise BagError(f"{name}: {not_known(child, self._frames, 'with transforms')}")
                raise BagError(f"{name}: {printable(child)} has no transforms in {printable(parent)}")

    def notes(self) -> Iterator[str]:
        """Say what else the user should know."""
        yield from self._names.notes(self._given)
        if self._edits.only_transforms and (left := [*self._left_out()]):
            yield f"the transforms on {listed(left)} are left out; `topics` or `--topic` keeps them"

    def _left_out(self) -> Iterator[str]:
        """Get the topics with transforms in the namespaces of those that were named."""
        spaces = {topic.rpartition("/")[0] for topic in self._topics}
        for topic, about in self._recorded.topics.items():
            space, _, name = topic.rpartition("/")
            if topic not in self._topics and space in spaces and name in ("tf", "tf_static") and about.count:
                yield topic


class _Samples:
    """
    The corrected samples of a frame, which are taken in the order of their stamps.

    :param clocks: the frames at whose stamps they are due; none: at those of all frames.
    """

    def __init__(self, names: Names, history: History, clocks: Collection[str]) -> None:
        self.frame, self.clocks = history.frame, clocks
        self._names, self._history, self._taken = names, history, 0

    def until(self, time_ns: int | None) -> list[TransformStamped]:
        """Take the samples up to a time; None: all."""
        one, begin = self._history, self._taken
        end = len(one.stamps_ns) if time_ns is None else int(one.stamps_ns.searchsorted(time_ns, "right"))
        if end <= begin:
            return []
        self._taken = end
        child = self._names.of(one.frame)
        frames = [(self._names.of(parent), child) for parent in one.parents[begin:end].tolist()]
        values = np.hstack((one.translations[begin:end], one.rotations[begin:end]))
        return read_transforms(
            serialize_arrays(frames, one.stamps_ns[begin:end], values), MessageSource(DYNAMIC)
        )
