# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Write buffers as recordings in mcap, which any tool can read: messages on ``/tf`` and ``/tf_static``."""

from __future__ import annotations

import os
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from tf2_py import BufferCore, History
from tf2_py.atomic_files import whole_file
from tf2_ros.serialization import serialize_arrays
from tf2_ros_tools.common.optional_libraries import require
from tf2_ros_tools.recordings.bag_reader import LAST_NS, typestore

DYNAMIC, STATIC = "/tf", "/tf_static"
# The transforms within this time share a message, because players and readers work message by message.
MESSAGE_NS = 10_000_000
# Before compression. A file without its end can be read up to its last whole chunk.
CHUNK_BYTES = 1 << 15
MOST_PER_MESSAGE = 1000  # dynamic ones; one message has all static ones: late subscribers get only the last
AT_ONCE = 100_000  # about as many transforms are sorted at a time, to save memory

# With all keys that rosbag2 writes, without which it does not play a recording.
_QOS = """\
- history: keep_last
  depth: {depth}
  reliability: reliable
  durability: {durability}
  deadline: {{sec: 9223372036, nsec: 854775807}}
  lifespan: {{sec: 9223372036, nsec: 854775807}}
  liveliness: automatic
  liveliness_lease_duration: {{sec: 9223372036, nsec: 854775807}}
  avoid_ros_namespace_conventions: false"""
QOS = {
    DYNAMIC: _QOS.format(depth=100, durability="volatile"),
    STATIC: _QOS.format(depth=1, durability="transient_local"),
}

TYPE = "tf2_msgs/msg/TFMessage"
LIBRARY = "tf2-ros-cython"  # in the header, which begins the file


def save(buffer: BufferCore, path: str | os.PathLike[str]) -> None:
    """
    Write the present samples of a buffer to an ``.mcap`` file, which :func:`load` and other tools can read.

    The transforms are ordinary messages on ``/tf`` and ``/tf_static``, in the order of their stamps. The
    cache time, the limits and the authorities are not saved; :meth:`tf2_py.BufferCore.freeze` keeps them. An
    existing file is replaced when the new one is complete.

    :param buffer: a ``BufferCore`` or a ``Buffer``.
    :param path: the file; :func:`load` needs the ending ``.mcap``.
    :raises OSError: the file cannot be written; an existing file remains unchanged.
    :raises ModuleNotFoundError: the library mcap is missing: ``pip install 'tf2-ros-tools[bag]'``.
    """
    require("mcap", "bag")
    require("rosbags", "bag")
    from mcap.writer import Writer

    histories = [*buffer.histories().values()]
    with whole_file(path) as file:
        writer = Writer(file, chunk_size=CHUNK_BYTES, enable_data_crcs=True)
        writer.start(profile="ros2", library=LIBRARY)
        definition, _ = typestore().generate_msgdef(TYPE, ros_version=2)
        schema = writer.register_schema(TYPE, "ros2msg", definition.encode())
        channels = {
            topic: writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": qos})
            for topic, qos in QOS.items()
        }
        for sequence, (topic, log_time_ns, data) in enumerate(_messages(histories)):
            writer.add_message(channels[topic], log_time_ns, data, log_time_ns, sequence)
        writer.finish()  # type: ignore[no-untyped-call]


def is_saved(path: str | os.PathLike[str]) -> bool:
    """Whether :func:`save` has written a recording, which then has all transforms on the same two topics."""
    if not os.path.isfile(path):
        return False
    with open(path, "rb") as file:
        return LIBRARY.encode() in file.read(64)


def _messages(histories: list[History]) -> Iterator[tuple[str, int, bytes]]:
    """Topic, log time in ns, and serialized message: the static transforms first, the others by stamp."""
    static = [one for one in histories if one.static]
    moving = [one for one in histories if not one.static]
    times_ns = np.sort(np.concatenate([np.empty(0, np.int64), *(one.stamps_ns for one in moving)]))
    if static:
        first_ns = times_ns[0] if len(times_ns) else max(one.stamps_ns[0] for one in static)
        yield STATIC, int(first_ns), serialize_arrays(*by_stamp(static, -LAST_NS, LAST_NS))
    # Each part begins where a message does.
    begins_ns = np.unique(times_ns[::AT_ONCE] // MESSAGE_NS) * MESSAGE_NS
    del times_ns
    for begin_ns, end_ns in pairwise([*begins_ns.tolist(), LAST_NS]):
        frames, stamps_ns, transforms = by_stamp(moving, begin_ns, end_ns)
        ends = np.append(np.flatnonzero(np.diff(stamps_ns // MESSAGE_NS)) + 1, len(stamps_ns))
        start = 0
        for end in ends.tolist():
            while start < end:
                rows = slice(start, min(end, start + MOST_PER_MESSAGE))
                data = serialize_arrays(frames[rows], stamps_ns[rows], transforms[rows])
                # A sender knows a transform at its stamp, not earlier.
                yield DYNAMIC, int(stamps_ns[rows.stop - 1]), data
                start = rows.stop


def by_stamp(
    histories: list[History], begin_ns: int, end_ns: int
) -> tuple[list[tuple[str, str]], NDArray[np.int64], NDArray[np.float64]]:
    """The samples from one stamp until before another, for `serialize_arrays`."""
    frames: list[tuple[str, str]] = []
    stamps_ns, translations, rotations = [], [], []
    limits_ns = np.array([begin_ns, end_ns])
    for one in histories:
        begin, end = one.stamps_ns.searchsorted(limits_ns).tolist()
        if begin == end:
            continue
        parents = one.parents[begin:end].tolist()
        pairs = {parent: (_as_sent(parent), _as_sent(one.frame)) for parent in set(parents)}
        frames += [pairs[parent] for parent in parents]
        stamps_ns.append(one.stamps_ns[begin:end])
        translations.append(one.translations[begin:end])
        rotations.append(one.rotations[begin:end])
    times_ns = np.concatenate(stamps_ns)
    # Stable, so that samples of a frame with equal stamps remain in order of arrival.
    order = np.argsort(times_ns, kind="stable")
    transforms = np.hstack((np.concatenate(translations), np.concatenate(rotations)))
    return [frames[row] for row in order.tolist()], times_ns[order], transforms[order]


def _as_sent(frame: str) -> str:
    # A buffer removes one leading slash.
    return f"/{frame}" if frame.startswith("/") else frame
