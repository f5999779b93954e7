# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read recorded joint states and poses, and turn them into TFMessages."""

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tf2_py import stored_name
from tf2_ros.serialization import serialize_arrays
from tf2_ros_tools.recordings.bag_reader import RawMessage, typestore
from tf2_ros_tools.urdf import Robot

Frames: TypeAlias = tuple[str, str]  # parent and child
Names: TypeAlias = tuple[str, ...]
Floats: TypeAlias = "NDArray[np.float64]"
Row: TypeAlias = "Sequence[float] | NDArray[np.float64]"
FramesAndPoses: TypeAlias = "tuple[list[Frames], Floats, Floats]"

S = 1_000_000_000
EMPTY = serialize_arrays([], [], [])
BATCH = 1000  # messages: some MB of transforms

JOINT_STATE = "sensor_msgs/msg/JointState"
ODOMETRY = "nav_msgs/msg/Odometry"
TRANSFORM = "geometry_msgs/msg/TransformStamped"
POSES = ("geometry_msgs/msg/PoseStamped", "geometry_msgs/msg/PoseWithCovarianceStamped")
# The types whose messages name both frames.
NAMED = (ODOMETRY, TRANSFORM)
# The types with several poses in a message, with and without a stamp for each.
PATH, POSE_ARRAY = "nav_msgs/msg/Path", "geometry_msgs/msg/PoseArray"


class Source:
    """
    What the messages of a topic mean.

    ``msgtype`` is their type. ``left_out`` counts those that are not transforms, and ``reason`` says why the
    first one is not.
    """

    msgtype: str
    left_out = 0
    reason = ""

    def read(self, message: Any) -> tuple[Names, Row]:
        """Get the names and the numbers of a message; no numbers: it is left out."""
        raise NotImplementedError

    def poses_of_messages(self, names: Names, numbers: Floats) -> FramesAndPoses:
        """Compute the transforms of N messages with these names."""
        raise NotImplementedError

    def leave_out(self, reason: str) -> None:
        """Count a message that is left out."""
        self.left_out += 1
        self.reason = self.reason or reason


class Joints(Source):
    """
    The joint states of a robot.

    :param without: frames whose transforms are known, which are omitted.

    ``matched`` says whether a joint of the robot was among them; ``names`` are those that came last, ``seen``
    all that had positions.
    """

    msgtype = JOINT_STATE

    def __init__(self, robot: Robot, without: Collection[str]) -> None:
        self.robot = robot
        self._without = without
        self.matched = False
        self.names: Names = ()
        self.seen: dict[str, None] = {}

    def read(self, message: Any) -> tuple[Names, Row]:
        """Get the names and positions of a message; positions are optional."""
        self.names = tuple(message.name)
        if len(message.position) not in (0, len(self.names)):
            self.leave_out(f"{len(self.names)} names, but {len(message.position)} positions")
            return self.names, []
        return self.names, message.position

    def poses_of_messages(self, names: Names, numbers: Floats) -> FramesAndPoses:
        """Compute the transforms of N messages with these names."""
        joints, translations, rotations = self.robot.transforms(names, numbers)
        self.seen |= dict.fromkeys(names)
        self.matched = self.matched or bool(joints)
        wanted = [k for k, joint in enumerate(joints) if joint.child not in self._without]
        frames = [(joints[k].parent, joints[k].child) for k in wanted]
        return frames, translations[:, wanted], rotations[:, wanted]


class Poses(Source):
    """
    Poses of a frame.

    :param frames: the parent and the child; None: as the messages say.

    ``named`` says whether both frames were known for one of them.
    """

    def __init__(self, msgtype: str, frames: Frames | None) -> None:
        self.msgtype = msgtype
        self.named = False
        self._frames = frames

    def read(self, message: Any) -> tuple[Names, list[float]]:
        """Get the frames and the numbers of a message."""
        frames = self._frames or _frames_of(message)
        if not all(frames):
            self.leave_out("frame_id is not set" if frames[1] else "child_frame_id is not set")
            return tuple(frames), []
        self.named = True
        return tuple(frames), _numbers_of(self.msgtype, message)

    def poses_of_messages(self, names: Names, numbers: Floats) -> FramesAndPoses:
        """Get the transforms of N messages with these frames."""
        return [(names[0], names[1])], numbers[:, None, :3], numbers[:, None, 3:]


def poses_of(msgtype: str, message: Any) -> Iterator[tuple[int, Frames, list[float]]]:
    """
    Get the poses of a message that has one or several.

    :return: the stamp in ns, the parent and the child, and x y z qx qy qz qw of each. A frame that the
        message does not name is empty.
    :raises ValueError: a path and one of its poses are in different frames.
    """
    frames, stamp_ns = _frames_of(message), _stamp_of(message)
    if msgtype == PATH:
        for i, one in enumerate(message.poses, 1):
            parent, _ = _frames_of(one)
            if parent and frames[0] and stored_name(parent) != stored_name(frames[0]):
                raise ValueError(f"the path is in {frames[0]!r}, but its pose {i} is in {parent!r}")
            yield _stamp_of(one), (parent or frames[0], ""), _numbers_of(POSES[0], one)
    elif msgtype == POSE_ARRAY:
        for pose in message.poses:
            yield stamp_ns, frames, _numbers(pose.position, pose.orientation)
    else:
        yield stamp_ns, frames, _numbers_of(msgtype, message)


def _frames_of(message: Any) -> Frames:
    # To tf2, names are C strings.
    child = getattr(message, "child_frame_id", "")
    return message.header.frame_id.partition("\0")[0], child.partition("\0")[0]


def _stamp_of(message: Any) -> int:
    return int(message.header.stamp.sec * S + message.header.stamp.nanosec)


def _numbers_of(msgtype: str, message: Any) -> list[float]:
    if msgtype == TRANSFORM:
        return _numbers(message.transform.translation, message.transform.rotation)
    pose = message.pose if msgtype == POSES[0] else message.pose.pose
    return _numbers(pose.position, pose.orientation)


def _numbers(p: Any, q: Any) -> list[float]:
    return [p.x, p.y, p.z, q.x, q.y, q.z, q.w]


def converted(
    messages: Iterable[RawMessage],
    sources: Mapping[str, Source],
    on_malformed: Callable[[str, int, Exception], object],
) -> Iterator[RawMessage]:
    """
    Yield a TFMessage for each message.

    :param sources: by topic.
    :param on_malformed: called with topic, log time and the reason for each message that cannot be read.
    """
    store, left = typestore(), iter(messages)
    while batch := [*islice(left, BATCH)]:
        serialized = [EMPTY] * len(batch)
        # The messages of a topic with the same names become transforms in one computation.
        alike: dict[tuple[str, Names], list[tuple[int, int, Any]]] = {}
        for i, (connection, log_ns, raw) in enumerate(batch):
            source = sources[connection.topic]
            try:
                message: Any = store.deserialize_cdr(raw, source.msgtype)
                names, numbers = source.read(message)
            except Exception as error:  # rosbags defines an error class only for some kinds of damage
                on_malformed(connection.topic, log_ns, error)
                continue
            if len(numbers):
                entry = i, _stamp_of(message), numbers
                alike.setdefault((connection.topic, names), []).append(entry)
        for (topic, names), own in alike.items():
            indices, stamps_ns, rows = zip(*own, strict=True)
            frames, translations, rotations = sources[topic].poses_of_messages(names, np.array(rows))
            transforms = np.concatenate((translations, rotations), axis=-1)
            for i, stamp_ns, poses in zip(indices, stamps_ns, transforms, strict=True):
                serialized[i] = serialize_arrays(frames, [stamp_ns] * len(frames), poses)
        for (connection, log_ns, _), data in zip(batch, serialized, strict=True):
            yield connection, log_ns, data
