# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause

"""
Serialized TFMessages: make them from transforms or arrays, read them, and insert many into a buffer.

:func:`insert_messages` calls no Python for each transform, and also fills a
:class:`~tf2_ros.records.Recording`.

>>> from tf2_ros import Buffer
>>> from tf2_ros.serialization import MessageSource, insert_messages, serialize_arrays
>>> data = serialize_arrays([("map", "odom")], [2_000_000_000], [[1, 0, 0, 0, 0, 0, 1]])
>>> buffer = Buffer()
>>> insert_messages(buffer, [("/tf", 2_000_000_000, data)], [MessageSource("/tf")])
1
>>> buffer.frames()["odom"].parent
'map'
"""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import ArrayLike, NDArray

from tf2_py import BufferCore
from tf2_ros.records import Recording

__all__ = ["MessageSource", "insert_messages", "read_transforms", "serialize_arrays", "serialize_transforms"]

class MessageSource:
    """
    A topic whose transforms are wanted.

    :param str topic: its name, which is also the authority of its transforms.
    :param bool static: whether its transforms are valid at all times.
    :param str prefix: a text that is put in front of the names of its frames.
    :param bytes publisher: its publisher in a recording. Empty: the name of the topic.
    """

    topic: str
    def __new__(
        cls, topic: str, static: bool = False, prefix: str = "", publisher: bytes = b""
    ) -> MessageSource: ...

def insert_messages(
    buffer: BufferCore,
    messages: Iterable[tuple[Any, int, bytes | memoryview]],
    sources: Iterable[MessageSource],
    *,
    on_malformed: Callable[[str, int, ValueError], object] | None = None,
    on_broken: Callable[[Exception, int | None], Exception] | None = None,
    recording: Recording | None = None,
    records: list[NDArray[np.void]] | None = None,
    progress: Callable[[int], object] | None = None,
) -> int:
    """
    Insert all transforms of serialized messages.

    :param buffer: a ``BufferCore``, or a ``Buffer``.
    :param messages: an iterable of ``(topic, time in ns, serialized TFMessage)``. The topic is a name, or an
        object with the name as ``topic``, such as a connection of rosbags.
    :param sources: a :class:`MessageSource` for each topic among them.
    :param on_malformed: ``on_malformed(topic, time_ns, error)`` is called for each message that cannot be
        read, with a ``ValueError``. Raise an exception in it to stop. None: the error is raised.
    :param on_broken: ``on_broken(error, last_time_ns)`` is called if iterating over ``messages`` raises.
        Return the exception to raise instead. ``last_time_ns`` is None before the first message. None: the
        error itself is raised.
    :param Recording recording: records each transform, with the publisher of its source and the time as time
        of reception.
    :param list records: the records that do not fit into ``recording`` are appended, as arrays.
    :param progress: called from time to time with the number of messages since the last call.
    :return: the number of messages.
    :raises KeyError: a topic has no source.
    :raises ValueError: a message cannot be read, a time does not fit into 64 bits, or a message is not bytes.

    The call holds the GIL. If it is interrupted, the buffer keeps the transforms that were inserted before.
    """

def read_transforms(raw: bytes | memoryview, source: MessageSource) -> list[TransformStamped]:
    """
    Read the transforms of one message.

    :param raw: a serialized TFMessage.
    :param source: the topic of the message: whether it is static, and the prefix for the names of frames.
    :return: a list of ``geometry_msgs/TransformStamped``; without ROS, a list of objects with the same
        fields.
    :raises ValueError: the message is malformed.
    """

def serialize_transforms(transforms: TransformStamped | Iterable[TransformStamped]) -> bytes:
    """
    Serialize one TFMessage, as plain CDR.

    :param transforms: a ``geometry_msgs/TransformStamped``, or an iterable of them, as for a broadcaster.
        What every buffer refuses, such as a rotation of zero length, is serialized as it is.
    :return: the bytes that a publisher sends and a recording stores.
    :raises TypeError: ``transforms`` is something else, or a name is not a str.
    :raises ValueError: a name contains a lone surrogate.
    :raises OverflowError: a stamp does not fit into a message.

    >>> from geometry_msgs.msg import TransformStamped
    >>> from tf2_ros.serialization import MessageSource, read_transforms, serialize_transforms
    >>> pose = TransformStamped(child_frame_id="base_link")
    >>> pose.header.frame_id = "odom"
    >>> pose.transform.translation.x = 1.5
    >>> read_transforms(serialize_transforms(pose), MessageSource("/tf")) == [pose]
    True
    """

def serialize_arrays(frames: Iterable[tuple[str, str]], stamps_ns: ArrayLike, transforms: ArrayLike) -> bytes:
    """
    Serialize one TFMessage, as plain CDR.

    :param frames: N pairs of names, parent and child.
    :param stamps_ns: nanoseconds, shape (N,).
    :param transforms: x y z in meters, and the quaternion x y z w, which is not normalized: shape (N, 7).
    :return: the bytes that a publisher sends and a recording stores.
    :raises TypeError: a name is not a str.
    :raises ValueError: a name contains a NUL character, or the three arguments have different lengths.

    >>> from tf2_ros.serialization import MessageSource, read_transforms, serialize_arrays
    >>> data = serialize_arrays([("map", "base")], [2_000_000_000], [[1, 0, 0, 0, 0, 0, 1]])
    >>> read_transforms(data, MessageSource("/tf"))[0].transform.translation.x
    1.0
    """
