"""Turn recorded joint states and poses into TFMessages."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tf2_ros_tools.reading import RawMessage
from tf2_ros_tools.serialised import (
    EMPTY,
    Layout,
    Series,
    joint_names,
    numbers_of,
    odometry_frames,
    pose_frames,
    tf_messages,
)
from tf2_ros_tools.urdf import Robot

Frames: TypeAlias = tuple[str, str]  # parent and child
Floats: TypeAlias = "NDArray[np.float64]"
Moved: TypeAlias = "tuple[list[Frames], Floats, Floats]"

BATCH = 20_000  # numbers: some MB of transforms

ODOMETRY = "nav_msgs/msg/Odometry"
POSES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped")


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


Source: TypeAlias = Joints | Poses  # what the messages of a topic mean


class _Read(NamedTuple):
    """A message; without a layout, nothing was read of it."""

    connection: Any
    log_ns: int
    stamp_ns: int
    layout: Layout | None
    numbers: bytes


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
    pending: list[_Read] = []
    size = 0
    try:
        for connection, log_ns, raw in messages:
            stamp_ns, layout, numbers = 0, None, b""
            try:
                stamp_ns, layout, numbers = sources[connection.topic].series.read(raw)
            except ValueError as error:
                on_malformed(connection.topic, log_ns, error)
            pending.append(_Read(connection, log_ns, stamp_ns, layout, numbers))
            size += 1 + (layout.count if layout is not None else 0)
            if size >= BATCH:
                yield from _batch(pending, sources)
                pending, size = [], 0
    except Exception:
        yield from _batch(pending, sources)
        raise
    yield from _batch(pending, sources)


def _batch(pending: Sequence[_Read], sources: Mapping[str, Source]) -> Iterator[RawMessage]:
    places: dict[Layout, list[int]] = {}  # each layout is of one topic
    for i, one in enumerate(pending):
        # Positions of joints are optional: a state may have only velocities or efforts.
        if one.layout is not None and one.layout.count:
            places.setdefault(one.layout, []).append(i)
    made = [EMPTY] * len(pending)
    for layout, own in places.items():
        source = sources[pending[own[0]].connection.topic]
        numbers = numbers_of(layout, [pending[i].numbers for i in own])
        frames, translations, rotations = source.transforms(layout, numbers)
        stamps_ns = [pending[i].stamp_ns for i in own]
        for i, text in zip(own, tf_messages(frames, stamps_ns, translations, rotations), strict=True):
            made[i] = text
    for one, text in zip(pending, made, strict=True):
        yield one.connection, one.log_ns, text
