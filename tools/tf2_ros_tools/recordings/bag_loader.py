# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Load recordings into buffers, and read their transforms."""

import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from math import inf
from os import PathLike
from typing import Any, Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tf2_py.printable import counted, printable
from tf2_py.typing import DurationLike, TimeLike
from tf2_ros import Buffer, TransformStamped
from tf2_ros.records import Recording
from tf2_ros.serialization import MessageSource, insert_messages, read_transforms
from tf2_ros_tools.common.bools import bool_of
from tf2_ros_tools.common.optional_libraries import require
from tf2_ros_tools.common.output import first_names
from tf2_ros_tools.recordings import foxglove_messages
from tf2_ros_tools.recordings.bag_reader import (
    TF_TYPES,
    BagError,
    RawMessage,
    Recorded,
    as_time_ns,
    is_static,
    listed,
    open_recording,
    typestore,
)
from tf2_ros_tools.recordings.header_stamps import stamps_of
from tf2_ros_tools.recordings.joints_and_poses import (
    JOINT_STATE,
    NAMED,
    POSES,
    Frames,
    Joints,
    Poses,
    Source,
    converted,
)
from tf2_ros_tools.recordings.trajectories import Keyframes, Trajectory
from tf2_ros_tools.urdf import Robot, fixed, parse, unmatched
from tf2_ros_tools.urdf import load as load_urdf

TOPICS = ("/tf", "/tf_static")
Topics: TypeAlias = Iterable[str] | Mapping[str, str]
# A robot, the path or text of a URDF, or True: the description in the recording.
Urdf: TypeAlias = Robot | str | PathLike[str] | Literal[True]
Urdfs: TypeAlias = Urdf | Mapping[str, Urdf] | None
# Parents and children by topic; None: as the messages say.
PoseTopics: TypeAlias = Mapping[str, Frames | None]

S = 1_000_000_000
JOINT_STATES = "/joint_states"
DESCRIPTION, STRING = "robot_description", "std_msgs/msg/String"
# The authority of transforms from fixed joints.
FROM_URDF = "urdf"

UNLIMITED_BYTES = (1 << 63) - 1


@dataclass(frozen=True)
class Wanted:
    """
    What to read: topics with the prefixes of their frames, and log times; None: no limit.

    ``poses`` has the topics whose poses are read, with the parent and the child, or None. ``robots`` has the
    robots whose joint states are read, by topic; None: as the recording describes it. ``trajectory`` corrects
    what was read.
    """

    prefixes: Mapping[str, str]
    start_ns: int | None
    end_ns: int | None
    poses: PoseTopics
    robots: Mapping[str, Robot | None]
    trajectory: Keyframes | None = None

    @property
    def limited(self) -> bool:
        return self.start_ns is not None or self.end_ns is not None

    @property
    def others(self) -> list[str]:
        """The topics whose messages are not transforms themselves."""
        return [*self.poses, *self.robots]

    @property
    def with_transforms(self) -> list[str]:
        """The topics of ``prefixes`` whose messages are transforms."""
        path = None if self.trajectory is None else self.trajectory.topic
        return [topic for topic in self.prefixes if topic not in (*self.others, path)]

    def prefix_of(self, topic: str) -> str | None:
        """
        Get the prefix of the frames that the messages of another topic name: that of the topic, or that of
        the transforms in its namespace or in the closest one above. None: they are in other namespaces.
        """
        if topic in self.prefixes:
            return self.prefixes[topic]
        found: dict[str, set[str]] = {}
        for one, prefix in self.prefixes.items():
            if not is_static(one):
                found.setdefault(one.rpartition("/")[0], set()).add(prefix)
        namespace = topic
        while namespace:
            namespace = namespace.rpartition("/")[0]
            if namespace in found:
                prefixes = found[namespace]
                return prefixes.pop() if len(prefixes) == 1 else ""
        return None


def wanted(
    topics: Topics = TOPICS,
    start: TimeLike | None = None,
    end: TimeLike | None = None,
    poses: PoseTopics | None = None,
    urdf: Urdfs = None,
    trajectory: Trajectory | None = None,
) -> Wanted:
    """
    Check the arguments that determine what is read, and read the files of a trajectory.

    :raises TypeError: ``topics`` is a str, ``poses`` has something other than pairs of frames, or a time has
        a wrong type.
    :raises ValueError: ``topics`` is empty, or ``end`` is before ``start``.
    :raises FileNotFoundError, UrdfError: see :func:`tf2_ros_tools.urdf.load`.
    :raises BagError: see :class:`tf2_ros_tools.recordings.trajectories.Keyframes`.
    """
    if isinstance(topics, str):
        raise TypeError(f"topics: expected a list of names, got a str: use [{topics!r}]")
    prefixes = dict(topics) if isinstance(topics, Mapping) else dict.fromkeys(topics, "")
    if not prefixes:
        raise ValueError("topics: expected at least one topic, got none")
    start_ns = None if start is None else as_time_ns("start", start)
    end_ns = None if end is None else as_time_ns("end", end)
    if start_ns is not None and end_ns is not None and end_ns < start_ns:
        raise ValueError(f"end: expected a time after start ({start_ns} ns), got {end_ns} ns")
    given: Mapping[str, Urdf | None] = urdf if isinstance(urdf, Mapping) else {JOINT_STATES: urdf}
    robots = {topic: _robot(one) for topic, one in given.items() if one is not None}
    if not isinstance(poses or {}, Mapping):
        raise TypeError(f"poses: expected a dict of topics and frames, got {type(poses).__name__}")
    posed = dict(poses or {})
    for topic, frames in posed.items():
        if frames is not None and (isinstance(frames, str) or len(frames) != 2):
            raise TypeError(f"poses: expected (parent, child) or None for {topic}, got {frames!r}")
        if frames is not None and "\0" in "".join(frames):
            raise ValueError(f"poses: a frame name must not contain a NUL character, got {frames!r}")
    keyframes = None if trajectory is None else Keyframes(trajectory)
    return Wanted(prefixes, start_ns, end_ns, posed, robots, keyframes)


def _robot(urdf: Urdf) -> Robot | None:
    if urdf is True:
        return None
    return urdf if isinstance(urdf, Robot) else load_urdf(urdf)


def load(
    path: "str | PathLike[str]",
    *,
    cache_time: DurationLike | None = None,
    topics: Topics = TOPICS,
    start: TimeLike | None = None,
    end: TimeLike | None = None,
    poses: PoseTopics | None = None,
    urdf: Urdfs = None,
    trajectory: Trajectory | None = None,
    progress: bool | None = None,
) -> Buffer:
    """
    Load the transforms of a recording into a new buffer.

    :param path: a rosbag2 folder, or a file that ends in ``.mcap``, ``.db3`` or ``.bag`` (ROS 1). If
        ``.zstd`` follows, the file is decompressed first.
    :param cache_time: how far each frame's history reaches back from its latest sample: a duration, or a
        number of seconds. None: everything is kept.
    :param topics: the names of the topics, or a mapping of their names to prefixes for their frames, for
        example ``{"/robot1/tf": "robot1/"}``. A topic whose last component is ``tf_static`` has static
        transforms.
    :param start: load only dynamic transforms that were recorded at or after this log time. None: from the
        beginning. All static transforms are loaded, whenever they were recorded.
    :param end: load only dynamic transforms that were recorded at or before this log time. None: to the end.
    :param poses: also read the poses of these topics as transforms: of type ``nav_msgs/Odometry``,
        ``geometry_msgs/TransformStamped``, ``geometry_msgs/PoseStamped`` or
        ``geometry_msgs/PoseWithCovarianceStamped``. The names are mapped to the parent and the child, for
        example ``{"/gps/pose": ("map", "gps")}``. None: the names in the messages, which only the first two
        types have.
    :param urdf: also compute the transforms of the joints of this robot, from the joint states on
        ``/joint_states``: its path, its text, a :class:`tf2_ros_tools.urdf.Robot`, or True, which means the
        ``/robot_description`` in the recording. To read other topics, pass a mapping from topics to such
        values; True then means the ``robot_description`` in the namespace of the topic. Frames that have
        transforms on ``topics`` keep them. The authority of fixed joints is ``urdf``.
    :param trajectory: corrects the buffer by poses in a file or on a topic, as
        :func:`tf2_ros.correction.correct` does. None: what was recorded remains as it is.
    :param progress: show a bar, which needs tqdm. None: only if standard error is a terminal, after a second.
    :return: a buffer without a node and without a limit of memory. The authority of a transform is the name
        of its topic.
    :raises FileNotFoundError: the file does not exist.
    :raises BagError: the file is not a recording, is broken, or has none of the topics, or a topic has
        messages of another type; or its joint states have no joint of the robot, or no message was
        recorded between ``start`` and ``end``; or the trajectory is broken, or does not fit the recording.
    :raises UrdfError: see :func:`tf2_ros_tools.urdf.load`.
    :raises ModuleNotFoundError: rosbags is not installed; the text says how to install it.
    :raises TypeError: ``topics`` is a str, ``start`` or ``end`` is not a time, or a value in ``poses`` is not
        a pair.
    :raises ValueError: ``topics`` is empty, or ``end`` is before ``start``.

    The recording need not have all of the topics, and a topic may be empty. Transforms that a buffer refuses,
    such as those with NaN, are logged. Warnings report messages that are left out: joint states whose
    numbers of names and positions differ, and poses without frame names. Other warnings list names in joint
    states that are not joints of the URDF, frames whose stamps are all 0, and topics of which the files of a
    folder have fewer messages than its ``metadata.yaml`` counts.
    """
    what = wanted(topics, start, end, poses, urdf, trajectory)
    found = read_contents(path, what, cache_time=cache_time, records=False, progress=progress)
    for text in found.warnings:
        warnings.warn(f"{printable(os.fspath(path))}: {text}", stacklevel=2)
    return found.buffer


@dataclass(frozen=True)
class BagContents:
    """
    What a recording contains.

    ``records`` is an array of :data:`tf2_ros.records.RECORD`, in the order of the log times, which are its
    times of reception. Its ids are indices into ``frames``, ``publishers`` and ``values``; a publisher is
    the name of a topic. ``start_ns`` and ``end_ns`` are the first and the last log time of all topics, up to
    the end that was wanted; None if there are no messages. ``times_ns`` are the stamps of the topic whose
    stamps were asked for, or None. ``notes`` has a sentence for each topic, and for the trajectory, of which
    something is left out or lost. ``absent`` says what may explain that a frame is unknown. ``corrected`` is
    the frame whose transforms the trajectory has replaced, or None; its records are those of before.
    ``uncorrected`` is the buffer as it was then, or None.
    """

    buffer: Buffer
    records: NDArray[np.void]
    frames: list[str]
    publishers: list[str]
    values: Sequence[tuple[float, ...]]
    start_ns: int | None
    end_ns: int | None
    times_ns: NDArray[np.int64] | None
    notes: list[str]
    absent: list[str]
    corrected: str | None
    uncorrected: Buffer | None

    @property
    def warnings(self) -> list[str]:
        """What programs are warned of: ``notes``, and moving frames whose stamps are all 0."""
        return [
            *self.notes,
            *(
                f"all stamps of {printable(name)} are 0, because its publisher does not set them:"
                " a buffer keeps 64 samples of one stamp, and has no answer for another time"
                for name, one in self.buffer.frames().items()
                if one.parent is not None and not one.static and one.newest_ns == 0 and one.count > 1
            ),
        ]


def read_contents(
    path: "str | PathLike[str]",
    what: Wanted | None = None,
    *,
    cache_time: DurationLike | None = None,
    at: str | None = None,
    records: bool = True,
    on_open: Callable[[Recorded], object] | None = None,
    keeps_uncorrected: bool = False,
    progress: bool | None = None,
) -> BagContents:
    """
    Read a recording as :func:`load` does.

    :param what: None: the transforms on TOPICS.
    :param at: a topic whose stamps are read, too; see :func:`tf2_ros_tools.bag.stamps`.
    :param records: whether each transform is recorded, which takes a third longer. Otherwise, ``records``,
        ``publishers`` and ``values`` are empty.
    :param on_open: called with the recording before it is read.
    :param keeps_uncorrected: whether ``uncorrected`` is a copy, if there is a trajectory.
    """
    what = what or wanted()
    keeps_records, copies = bool_of(records, "records"), bool_of(keeps_uncorrected, "keeps_uncorrected")
    buffer, recording = new_buffer(cache_time), Recording()
    pieces: list[NDArray[np.void]] = []
    with open_recording(path) as recorded:
        if on_open is not None:
            on_open(recorded)
        keyframes, poses, uncorrected = what.trajectory, None, None
        if keyframes is not None:  # first, because it may be wrong
            poses = keyframes.read(recorded, what.prefix_of(keyframes.topic or "") or "")
        notes = fill_buffer(buffer, recorded, what, progress, recording if keeps_records else None, pieces)
        if keyframes is not None and poses is not None:
            uncorrected = copy(buffer) if copies else None
            notes += keyframes.correct(buffer, poses)
        times_ns = None if at is None else stamps_of(recorded, at)
        if at is not None and at not in what.poses:
            notes += recorded.shortfalls([at])
    found = np.concatenate([*pieces, recording.take()])
    found = found[np.argsort(found["received_ns"], kind="stable")]
    publishers = [name.decode() for name in recording.publishers()]
    start_ns, end_ns = recorded.start_ns, recorded.end_ns
    if end_ns is not None and what.end_ns is not None:
        end_ns = min(end_ns, what.end_ns)
    frames, values, absent = recording.frames(), recording.values(), [*_absent(recorded, what)]
    if keyframes is not None:
        frames = [*dict.fromkeys([*frames, *buffer.frames()])]  # a trajectory may add some
    own = (times_ns, notes, absent, None if keyframes is None else keyframes.child, uncorrected)
    return BagContents(buffer, found, frames, publishers, values, start_ns, end_ns, *own)


def _absent(recorded: Recorded, what: Wanted) -> Iterator[str]:
    """Say which of the topics that were named are not there or empty, and that static transforms are not."""
    for topic in what.others:
        if topic not in recorded.topics:
            types = (JOINT_STATE,) if topic in what.robots else (*NAMED, *POSES)
            others = listed(topics_of(recorded, *types))
            yield f"there is no topic {printable(topic)}; the topics of its type are {others}"
        elif not recorded.topics[topic].count:
            yield f"topic {printable(topic)} has no messages"
    transforms = topics_of(recorded, *TF_TYPES, *foxglove_messages.TYPES)
    filled = [name for name in transforms if recorded.topics[name].count]
    static, wanted = {*filter(is_static, filled)}, {*what.prefixes}.intersection(filled)
    if wanted and static.isdisjoint(wanted):
        if static:
            yield f"no static transforms are read: `topics` or `--topic` reads those on {listed(static)}"
        else:
            why = f"they are sent once, often before a recording begins; {WITH_URDF} computes a robot's"
            yield f"no static transforms were recorded: {why}"


def new_buffer(cache_time: DurationLike | None) -> Buffer:
    """Create a buffer that keeps everything, or the last ``cache_time``."""
    buffer = Buffer(inf if cache_time is None else cache_time, max_bytes=UNLIMITED_BYTES)
    # How old the samples are today means nothing; `ages` says so.
    buffer.clock = None  # pyright: ignore[reportAttributeAccessIssue]
    return buffer


def fill_buffer(
    buffer: Buffer,
    recorded: Recorded,
    what: Wanted,
    progress: bool | None = None,
    recording: Recording | None = None,
    records: list[NDArray[np.void]] | None = None,
) -> list[str]:
    """
    Insert the wanted transforms of a recording into a buffer.

    :param recording: records each transform; see :func:`tf2_ros.serialization.insert_messages`.
    :param records: see the same function.
    :return: a sentence for each topic of which messages, or the positions of some joints, are left out or
        lost.
    """
    sources = sources_of(recorded, what)
    robots = robots_of(recorded, what)
    topics = [*(one.topic for one in sources), *(one for one in what.others if one in recorded.topics)]
    total = None if what.limited else sum(recorded.topics[topic].count for topic in topics)
    with progress_bar(recorded.path, total, " messages", progress) as count:
        insert = partial(
            insert_messages,
            buffer,
            on_malformed=recorded.malformed,
            on_broken=recorded.explain,
            recording=recording,
            records=records,
            progress=count,
        )
        for messages in passes(recorded, sources, what):
            insert(messages, sources)

        def insert_converted(sources: Mapping[str, Source]) -> None:
            messages = recorded.checked(recorded.raw(sources, what.start_ns, what.end_ns))
            prefixes = {
                topic: what.prefix_of(topic) or "" for topic in sources if what.poses.get(topic, ()) is None
            }
            targets = [MessageSource(topic, False, prefixes.get(topic, "")) for topic in sources]
            insert(converted(messages, sources, recorded.malformed), targets)

        posed = poses_on(recorded, what)
        insert_converted(posed)
        for topic, one in posed.items():
            if one.left_out and not one.named:
                where = f"{printable(recorded.path)}, topic {printable(topic)}"
                raise BagError(f"{where}: in its messages, {one.reason}; {PASS_FRAMES}")
        # Last, because only then it is known which frames have recorded transforms.
        known = {name for name, one in buffer.frames().items() if one.parent is not None}
        joints = {topic: Joints(robot, known) for topic, robot in robots.items()}
        static = [(FROM_URDF, recorded.start_ns or 0, fixed(robot, known)) for robot in robots.values()]
        insert(static, [MessageSource(FROM_URDF, static=True)], progress=None)
        insert_converted(joints)
        for topic, states in joints.items():
            own = [joint.name for joint in states.robot.joints if joint.type != "fixed"]
            if own and states.names and not states.matched:
                why = f" ({states.reason})" if states.left_out else ""
                raise BagError(
                    f"{printable(recorded.path)}, topic {printable(topic)}: its joint states, of"
                    f" {first_names(states.names)}, have no positions of the URDF's joints,"
                    f" {first_names(own)}{why}"
                )
    notes = [
        f"{counted(one.left_out, 'message')} on {printable(topic)} {'is' if one.left_out == 1 else 'are'}"
        f" left out: {one.reason}"
        for topic, one in (posed | joints).items()
        if one.left_out
    ]
    unmatched_names = {topic: unmatched(one.robot, one.seen) for topic, one in joints.items()}
    notes += [f"on {printable(topic)}, {text}" for topic, text in unmatched_names.items() if text]
    return [*notes, *recorded.shortfalls(topics)]


def poses_on(recorded: Recorded, what: Wanted) -> dict[str, Poses]:
    """Get the wanted topics with poses that the recording has."""
    return {
        topic: Poses(recorded.topics[topic].msgtype, frames)
        for topic, frames in what.poses.items()
        if topic in recorded.topics
    }


def robots_of(recorded: Recorded, what: Wanted) -> dict[str, Robot]:
    """Get the robots by the topics with their joint states."""
    return {topic: robot or _described(recorded, topic) for topic, robot in what.robots.items()}


def _described(recorded: Recorded, states: str) -> Robot:
    """Get the robot that the recording describes in the namespace of a topic with joint states."""
    topic = f"{states.rpartition('/')[0]}/{DESCRIPTION}"
    where = f"{printable(recorded.path)}, topic {printable(topic)}"
    if topic not in recorded.topics:
        raise BagError(f"{where}: the recording lacks this topic; pass the path of a URDF instead")
    _check_type(recorded, topic, STRING)
    raws = [raw for _, _, raw in recorded.checked(recorded.raw([topic]))]
    if not raws:
        raise BagError(f"{where}: it has no messages; pass the path of a URDF")
    try:
        message: Any = typestore().deserialize_cdr(raws[-1], STRING)
        return parse(message.data)
    except Exception as error:  # rosbags defines an error class only for some kinds of damage
        raise BagError(f"{where}: {error}") from error


def sources_of(recorded: Recorded, what: Wanted) -> list[MessageSource]:
    """
    Get the wanted topics that the recording has.

    :raises BagError: it has none of them, or one has another type.
    """
    name = printable(recorded.path)
    found = [topic for topic in what.with_transforms if topic in recorded.topics]
    for topic in found:
        _check_type(recorded, topic, *TF_TYPES, *foxglove_messages.TYPES)
    for topic, frames in what.poses.items():
        if topic in recorded.topics:
            _check_type(recorded, topic, *NAMED, *POSES)
            if frames is None and recorded.topics[topic].msgtype not in NAMED:
                raise BagError(
                    f"{name}, topic {printable(topic)}: a {recorded.topics[topic].msgtype} has no child"
                    f" frame; {PASS_FRAMES}"
                )
    for topic in what.robots:
        if topic in recorded.topics:
            _check_type(recorded, topic, JOINT_STATE)
    if not found and not any(topic in recorded.topics for topic in what.others):
        others = topics_of(recorded, *TF_TYPES, *foxglove_messages.TYPES)
        joints, posed = topics_of(recorded, JOINT_STATE), topics_of(recorded, *NAMED, *POSES)
        advice = ": choose from these with `topics` or `--topic`" if others else ""
        if joints and not others:
            advice += f"; {WITH_URDF} computes them from the joint states on {listed(joints)}"
        if posed and not others:
            advice += f"; {WITH_POSES} reads the poses on {listed(posed)}"
        missing = " or ".join(map(printable, [*what.prefixes, *what.others]))
        raise BagError(f"{name} has no topic {missing}; its topics with transforms: {listed(others)}{advice}")
    return [MessageSource(topic, is_static(topic), what.prefixes[topic]) for topic in found]


PASS_FRAMES = 'pass the frames, as in poses={"/gps/pose": ("map", "gps")} or --poses /gps/pose=map,gps'
WITH_URDF, WITH_POSES = "`urdf` or `--urdf`", "`poses` or `--poses`"


def topics_of(recorded: Recorded, *types: str) -> list[str]:
    return [one.name for one in recorded.topics.values() if one.msgtype in types]


def _check_type(recorded: Recorded, topic: str, *types: str) -> None:
    one = recorded.topics[topic]
    where = f"{printable(recorded.path)}, topic {printable(topic)}"
    if one.msgtype not in types:
        options = {JOINT_STATE: WITH_URDF, **dict.fromkeys((*NAMED, *POSES), WITH_POSES)}
        advice = f"; {options[one.msgtype]} reads it" if one.msgtype in options else ""
        wanted = (
            types[0] if types[0] in TF_TYPES else " or ".join(types)
        )  # few know of the others for transforms
        raise BagError(f"{where}: expected the type {wanted}, got {printable(one.msgtype)}{advice}")
    recorded.require_encoding(topic)


def passes(recorded: Recorded, sources: list[MessageSource], what: Wanted) -> list[Iterator[RawMessage]]:
    """
    Get the messages in one pass, or the static transforms first if times limit the others.

    :raises BagError: no message of the recording is within these times.
    """
    topics = {one.topic for one in sources}
    if not what.limited:
        return [recorded.raw(topics)]
    check_times(recorded, what)
    static = set(filter(is_static, topics))
    return [recorded.raw(static), recorded.raw(topics - static, what.start_ns, what.end_ns)]


def check_times(recorded: Recorded, what: Wanted) -> None:
    first_ns, last_ns = recorded.start_ns, recorded.end_ns
    if first_ns is None or last_ns is None:
        return
    begin = -inf if what.start_ns is None else what.start_ns
    end = inf if what.end_ns is None else what.end_ns
    if begin > last_ns or end < first_ns:
        limits = (("from", what.start_ns), ("up to", what.end_ns))
        wanted = " ".join(f"{word} {ns / S:.3f} s" for word, ns in limits if ns is not None)
        has = f"its log times are {first_ns / S:.3f} to {last_ns / S:.3f} s"
        units = "`start` and `end` are log times in nanoseconds, --start and --end in seconds"
        raise BagError(f"{printable(recorded.path)}: nothing was recorded {wanted}; {has}. {units}")


def transforms(
    path: "str | PathLike[str]",
    *,
    topics: Topics = TOPICS,
    start: TimeLike | None = None,
    end: TimeLike | None = None,
) -> Iterator[tuple[int, bool, TransformStamped]]:
    """
    Read the transforms of a recording one by one, in constant memory.

    :param path: see :func:`load`.
    :param topics: see :func:`load`.
    :param start: see :func:`load`.
    :param end: see :func:`load`.
    :return: an iterator over ``(log time in ns, whether it is static, TransformStamped)``. Without ROS, the
        last is an object with the same fields.

    The transforms are neither checked nor normalized. Arguments and errors are the same as in :func:`load`,
    but everything is raised during the iteration. With ``start`` or ``end``, all static transforms come
    first.
    """
    what = wanted(topics, start, end)
    with open_recording(path) as recorded:
        sources = {one.topic: one for one in sources_of(recorded, what)}
        for messages in passes(recorded, [*sources.values()], what):
            for connection, log_ns, raw in recorded.checked(messages):
                topic = connection.topic
                try:
                    found = read_transforms(raw, sources[topic])
                except ValueError as error:
                    recorded.malformed(topic, log_ns, error)
                for transform in found:
                    yield log_ns, is_static(topic), transform
        for text in recorded.shortfalls(sources):
            warnings.warn(f"{printable(recorded.path)}: {text}", stacklevel=2)


def static_transforms(
    path: "str | PathLike[str]", topics: Topics = TOPICS
) -> tuple[list[TransformStamped], list[str]]:
    """
    Read only the static transforms of a recording: the last one of each frame, as a buffer keeps it.

    :param path: see :func:`load`.
    :param topics: see :func:`load`; only those with static transforms are read.
    :return: the transforms, and what :func:`fill_buffer` returns. Frames with names that lookups refuse are
        left out.
    :raises BagError: see :func:`load`; or there are no such transforms.
    """
    buffer, what = new_buffer(None), wanted(topics)
    with open_recording(path) as recorded:
        static = [topic for topic, one in recorded.topics.items() if is_static(topic) and one.count]
        own = {topic: prefix for topic, prefix in what.prefixes.items() if topic in static}
        notes = fill_buffer(buffer, recorded, replace(what, prefixes=own)) if own else []
    found = [
        buffer.lookup_transform(one.parent, name, 0)
        for name, one in buffer.frames().items()
        if one.parent is not None and "/" not in (name[0], one.parent[0])
    ]
    if not found:
        advice = "they are sent once, often before a recording; robot_state_publisher sends those of a URDF"
        if others := [topic for topic in static if topic not in own]:
            advice = f"`--topic` reads those on {listed(others)}"
        names = " or ".join(map(printable, what.prefixes))
        raise BagError(f"{printable(recorded.path)} has no static transforms on {names}: {advice}")
    return found, notes


BAR_AFTER_S = 1.0


@contextmanager
def progress_bar(
    name: str, total: int | None, unit: str, progress: bool | None
) -> Iterator[Callable[[int], object]]:
    """
    Show a bar during a ``with`` statement, which gets a function that adds a number to what is done.

    :param progress: whether to show it. None: only if standard error is a terminal, after one second.
    """
    require("tqdm", "bag")
    from tqdm.auto import tqdm

    # For tqdm, disable=None disables the bar unless standard error is a terminal.
    disable, delay = (None, BAR_AFTER_S) if progress is None else (not bool_of(progress, "progress"), 0.0)
    with tqdm(total=total, desc=name, unit=unit, delay=delay, disable=disable) as bar:
        yield bar.update
