"""Turn recorded joint states and poses into TFMessages."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tf2_ros_tools.cdr import (
    EMPTY,
    Layout,
    Series,
    joint_names,
    numbers_of,
    odometry_frames,
    pose_frames,
    tf_messages,
)
from tf2_ros_tools.reading import RawMessage
from tf2_ros_tools.urdf import Robot

Frames: TypeAlias = tuple[str, str]  # parent and child
Floats: TypeAlias = "NDArray[np.float64]"
Moved: TypeAlias = "tuple[list[Frames], Floats, Floats]"
# What was read of a message: stamp in ns, layout, and the bytes of its numbers; None: nothing.
Pending: TypeAlias = "list[tuple[Any, int, tuple[int, Layout, bytes] | None]]"

BATCH = 20_000  # numbers: some MB of transforms

ODOMETRY = "nav_msgs/msg/Odometry"
POSES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped")


class Source(Protocol):
    """What the messages of a topic mean."""

    series: Series

    def transforms(self, layout: Layout, numbers: Floats) -> Moved:
        """Get M frames, translations of shape (N, M, 3) and rotations of shape (N, M, 4) of N messages."""
        ...


class Joints:
    """
    The joint states of a robot.

    :param without: frames whose transforms are known, which are omitted.

    ``matched`` says whether a joint of the robot was among them; ``names`` are those that came last.
    """

    def __init__(self, robot: Robot, without: Collection[str]) -> None:
        self.series = Series(joint_names)
        self.robot = robot
        self._without = without
        self.matched = False
        self.names: Sequence[str] = ()

    def transforms(self, layout: Layout, numbers: Floats) -> Moved:
        joints, translations, rotations = self.robot.transforms(layout.names, numbers)
        self.names, self.matched = layout.names, self.matched or bool(joints)
        wanted = [k for k, joint in enumerate(joints) if joint.child not in self._without]
        frames = [(joints[k].parent, joints[k].child) for k in wanted]
        return frames, translations[:, wanted], rotations[:, wanted]


class Poses:
    """
    Poses of a frame.

    :param frames: the parent and the child; None: as the messages say.
    """

    def __init__(self, msgtype: str, frames: Frames | None) -> None:
        self.series = Series(odometry_frames if msgtype == ODOMETRY else pose_frames)
        self._frames = frames

    def transforms(self, layout: Layout, numbers: Floats) -> Moved:
        parent, child = self._frames or layout.names
        return [(parent, child)], numbers[:, None, :3], numbers[:, None, 3:]


def converted(
    messages: Iterable[RawMessage],
    sources: Mapping[str, Source],
    on_malformed: Callable[[str, int, ValueError], object],
) -> Iterator[RawMessage]:
    """
    Yield a TFMessage for each message, also for those before an error of the iteration.

    :param sources: by topic.
    :param on_malformed: called with topic, log time and a ValueError for each message that cannot be read.
    """
    pending: Pending = []
    size = 0
    try:
        for connection, log_ns, raw in messages:
            read = None
            try:
                read = sources[connection.topic].series.read(raw)
            except ValueError as error:
                on_malformed(connection.topic, log_ns, error)
            pending.append((connection, log_ns, read))
            size += 1 if read is None else 1 + read[1].count
            if size >= BATCH:
                yield from _batch(pending, sources)
                pending, size = [], 0
    except Exception:
        yield from _batch(pending, sources)
        raise
    yield from _batch(pending, sources)


def _batch(pending: Pending, sources: Mapping[str, Source]) -> Iterator[RawMessage]:
    places: dict[tuple[str, Layout], list[int]] = {}
    for i, (connection, _, read) in enumerate(pending):
        # Positions of joints are optional: a state may have only velocities or efforts.
        if read is not None and read[1].count:
            places.setdefault((connection.topic, read[1]), []).append(i)
    made = [EMPTY] * len(pending)
    for (topic, layout), own in places.items():
        own_reads = [read for i in own if (read := pending[i][2]) is not None]
        numbers = numbers_of(layout, [data for _, _, data in own_reads])
        frames, translations, rotations = sources[topic].transforms(layout, numbers)
        texts = tf_messages(frames, [stamp_ns for stamp_ns, _, _ in own_reads], translations, rotations)
        for i, text in zip(own, texts, strict=True):
            made[i] = text
    for (connection, log_ns, _), text in zip(pending, made, strict=True):
        yield connection, log_ns, text
