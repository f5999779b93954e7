# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read a recording with a record of each transform, for reports, tables and programs."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tf2_py.printable import printable
from tf2_ros.records import Recording
from tf2_ros_tools.recordings import foxglove_messages
from tf2_ros_tools.recordings.bag_loader import WITH_URDF, Wanted, fill_buffer, new_buffer, topics_of, wanted
from tf2_ros_tools.recordings.bag_reader import TF_TYPES, Recorded, is_static, listed, open_recording
from tf2_ros_tools.recordings.header_stamps import stamps_of
from tf2_ros_tools.recordings.joints_and_poses import JOINT_STATE, NAMED, POSES

if TYPE_CHECKING:
    from tf2_ros import Buffer


@dataclass(frozen=True)
class BagContents:
    """
    What a recording contains.

    ``records`` is an array of :data:`tf2_ros.records.RECORD`, in the order of the log times, which are its
    times of reception. Its ids are indices into ``frames``, ``publishers`` and ``values``; a publisher is
    the name of a topic. ``start_ns`` and ``end_ns`` are the first and the last log time of all topics, up to
    the end that was wanted; None if there are no messages. ``times_ns`` are the stamps of the topic whose
    stamps were asked for, or None.
    ``left_out`` has a sentence for each topic of which something is left out or lost, ``absent`` says what
    may explain that a frame is unknown, ``unused`` counts the poses of a trajectory that are left out.
    ``corrected`` is the frame whose transforms the trajectory has replaced, or None; its records are those of
    before.
    """

    buffer: "Buffer"
    records: NDArray[np.void]
    frames: list[str]
    publishers: list[str]
    values: Sequence[tuple[float, ...]]
    start_ns: int | None
    end_ns: int | None
    times_ns: NDArray[np.int64] | None
    left_out: list[str]
    absent: list[str]
    unused: list[str]
    corrected: str | None


def read_contents(
    path: "str | PathLike[str]",
    what: Wanted | None = None,
    *,
    at: str | None = None,
    progress: bool | None = None,
) -> BagContents:
    """
    Read a recording as :func:`tf2_ros_tools.bag.load` does, and record each transform.

    :param what: None: the transforms on TOPICS.
    :param at: a topic whose stamps are read, too; see :func:`tf2_ros_tools.bag.stamps`.
    """
    what = what or wanted()
    buffer, recording = new_buffer(None), Recording()
    pieces: list[NDArray[np.void]] = []
    with open_recording(path) as recorded:
        how: dict[str, Any] = {"progress": progress, "recording": recording, "records": pieces}
        left_out, unused = fill_buffer(buffer, recorded, what, **how)
        times_ns = None if at is None else stamps_of(recorded, at)
        if at is not None and at not in what.poses:
            left_out += recorded.shortfalls([at])
    records = np.concatenate([*pieces, recording.take()])
    records = records[np.argsort(records["received_ns"], kind="stable")]
    publishers = [name.decode() for name in recording.publishers()]
    start_ns, end_ns = recorded.start_ns, recorded.end_ns
    if end_ns is not None and what.end_ns is not None:
        end_ns = min(end_ns, what.end_ns)
    frames, values, absent = recording.frames(), recording.values(), [*_absent(recorded, what)]
    corrected = None
    if what.trajectory is not None:
        corrected = what.trajectory.child
        frames = [*dict.fromkeys([*frames, *buffer.frames()])]  # a trajectory may add some
    own = (left_out, absent, unused, corrected)
    return BagContents(buffer, records, frames, publishers, values, start_ns, end_ns, times_ns, *own)


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
