"""
Insert serialised messages into a buffer, and record what was in them: who sent which transform when.

A :class:`Recording` is filled by :func:`insert_messages`, or by a listener: ``TransformListener(buffer, node,
recording=recording)``. Neither calls Python for each message.

>>> from tf2_ros import Buffer
>>> from tf2_ros.records import MessageSource, Recording, insert_messages
>>> mount = bytes.fromhex("00010000" "00000000")  # a serialised TFMessage of no transforms
>>> recording = Recording()
>>> insert_messages(Buffer(), [("/tf", 1_000_000_000, mount)], [MessageSource("/tf")], recording=recording)
1
>>> len(recording.take())
0
"""

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from geometry_msgs.msg import TransformStamped
from numpy.typing import ArrayLike, NDArray

from tf2_py import BufferCore

__all__ = [
    "RECORD",
    "MessageSource",
    "Recording",
    "insert_messages",
    "read_transforms",
    "refusal_text",
    "serialize_arrays",
]

RECORD: np.dtype[np.void]

class Recording:
    """
    Records who sent which transform when, for a listener or for :func:`insert_messages`.

    :param int capacity: how many transforms may arrive between two calls of :meth:`take`.
    """
    def __new__(cls, capacity: int = ...) -> Recording: ...
    def take(self) -> NDArray[np.void]:
        """
        Get what has arrived since the last call.

        :return: an array of :data:`RECORD`, in the order of arrival. ``child`` and ``parent`` are indices
            into :meth:`frames`, ``publisher`` into :meth:`publishers`; ``refusals`` is not 0 if every
            buffer refuses the transform, see :func:`refusal_text`; ``unnormalised`` is 1 if buffers
            accept it, but those of tf2 of Kilted and later refuse it because the length of its rotation is
            not 1; ``value`` is an index into :meth:`values` if the transform is static, otherwise a larger
            number.
        """
    def frames(self) -> list[str]:
        """Get the names of the frames; the list only grows, and is the same object each time."""
    def publishers(self) -> list[bytes]:
        """
        Get the publishers as bytes: their gids from a listener, or the names of topics from messages.

        The list only grows, and is the same object each time.
        """
    def values(self) -> list[tuple[float, float, float, float, float, float, float]]:
        """
        Get the numbers of static transforms, each once: x y z in metres, and the quaternion x y z w.

        The list only grows, and is the same object each time. Only the first 65,536 are noted.
        """
    @property
    def messages(self) -> int:
        """How many messages were noted."""
    @property
    def malformed(self) -> int:
        """How many messages could not be read."""
    @property
    def lost(self) -> int:
        """Get how many transforms were lost, because there was no place or no memory for them."""

class MessageSource:
    """
    A topic whose transforms are wanted.

    :param str topic: its name, which is also the authority of its transforms.
    :param bool static: whether its transforms are valid at all times.
    :param str prefix: is put in front of the names of its frames.
    """

    topic: str
    def __new__(cls, topic: str, static: bool = False, prefix: str = "") -> MessageSource: ...

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
    Insert all transforms of serialised messages.

    :param buffer: a ``BufferCore``, or a ``Buffer``.
    :param messages: an iterable of ``(topic, time in ns, serialised TFMessage)``. The topic is a name, or an
        object with the name as ``topic``, such as a connection of rosbags.
    :param sources: a :class:`MessageSource` for each topic among them.
    :param on_malformed: called with topic, time and a ``ValueError`` for each message that cannot be read. If
        it raises an exception, the work ends. None: the error is raised.
    :param on_broken: called with an ``Exception`` that the iteration raises, and the time of the last message
        before, or None. What it returns is raised instead. None: the error itself is raised.
    :param Recording recording: records each transform, with the topic as publisher and the time as time of
        reception.
    :param list records: receives, as arrays, the records for which ``recording`` has no place.
    :param progress: called from time to time with the number of messages since the last call.
    :return: the number of messages.
    :raises KeyError: a topic has no source.
    :raises ValueError: a message cannot be read, a time does not fit into 64 bits, or data are not bytes.

    It holds the GIL. If it is interrupted, the buffer keeps what was inserted before.
    """

def read_transforms(raw: bytes | memoryview, source: MessageSource) -> list[TransformStamped]:
    """
    Read the transforms of one message.

    :param raw: a serialised TFMessage.
    :return: a list of ``geometry_msgs/TransformStamped``; without ROS, a list of objects with the same
        fields.
    :raises ValueError: the message is malformed.
    """

def refusal_text(refusals: int) -> str:
    """Say in a clause why every buffer refuses a transform, from the ``refusals`` of a record."""

def serialize_arrays(frames: Iterable[tuple[str, str]], stamps_ns: ArrayLike, transforms: ArrayLike) -> bytes:
    """
    Serialise one TFMessage, as plain CDR.

    :param frames: N pairs of names, parent and child.
    :param stamps_ns: nanoseconds, shape (N,).
    :param transforms: x y z in metres, and the quaternion x y z w, which is not changed: shape (N, 7).
    :return: what a publisher sends, and a recording stores.
    :raises TypeError: a name is not a str.
    :raises ValueError: a name contains a NUL character, or there are not as many of one as of the others.

    >>> from tf2_ros.records import MessageSource, read_transforms, serialize_arrays
    >>> data = serialize_arrays([("map", "base")], [2_000_000_000], [[1, 0, 0, 0, 0, 0, 1]])
    >>> read_transforms(data, MessageSource("/tf"))[0].transform.translation.x
    1.0
    """
