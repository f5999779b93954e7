# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause

"""
Record who sent which transform when.

A :class:`Recording` is filled by a listener: ``TransformListener(buffer, node, recording=recording)``; or by
:func:`tf2_ros.serialization.insert_messages`. Neither calls Python for each message.

>>> from tf2_ros import Buffer
>>> from tf2_ros.records import Recording
>>> from tf2_ros.serialization import MessageSource, insert_messages, serialize_arrays
>>> data = serialize_arrays([("map", "odom")], [2_000_000_000], [[1, 0, 0, 0, 0, 0, 1]])
>>> recording = Recording()
>>> insert_messages(Buffer(), [("/tf", 2_500_000_000, data)], [MessageSource("/tf")], recording=recording)
1
>>> (record,) = recording.take()
>>> recording.frames()[record["child"]], int(record["received_ns"] - record["stamp_ns"])
('odom', 500000000)
"""

import numpy as np
from numpy.typing import NDArray

__all__ = ["RECORD", "Recording", "refusal_text"]

RECORD: np.dtype[np.void]

class Recording:
    """
    Records who sent which transform when, for a listener or for ``insert_messages``.

    :param int capacity: how many transforms may arrive between two calls of :meth:`take`. Default: 131,072.
    """
    def __new__(cls, capacity: int = ...) -> Recording: ...
    def take(self) -> NDArray[np.void]:
        """
        Get the records since the last call.

        :return: an array of shape (N,) and dtype :data:`RECORD`, in the order of arrival, with these fields:
            ``received_ns`` and ``stamp_ns`` in nanoseconds; ``child`` and ``parent``, indices into
            :meth:`frames`; ``publisher``, an index into :meth:`publishers`; ``static``, 0 or 1;
            ``refusals``, not 0 if every buffer refuses the transform, see :func:`refusal_text`;
            ``unnormalized``, 1 if buffers accept the transform, but tf2 of Kilted and later refuses it
            because the length of its rotation is not 1; ``value``, an index into :meth:`values` if the
            transform is static, otherwise a larger number.
        """
    def frames(self) -> list[str]:
        """Get the names of the frames; the list only grows, and is the same object each time."""
    def publishers(self) -> list[bytes]:
        """
        Get the publishers as bytes: their gids from a listener; from messages, those of their sources.

        The list only grows, and is the same object each time.
        """
    def values(self) -> list[tuple[float, float, float, float, float, float, float]]:
        """
        Get the numbers of static transforms, each once: x y z in meters, and the quaternion x y z w.

        The list only grows, and is the same object each time. Only the first 65,536 are recorded.
        """
    @property
    def messages(self) -> int:
        """How many messages were recorded."""
    @property
    def malformed(self) -> int:
        """How many messages could not be read."""
    @property
    def lost(self) -> int:
        """How many transforms were lost: beyond ``capacity``, with too many names, or without memory."""

def refusal_text(refusals: int) -> str:
    """Return, as a clause, why every buffer refuses a transform with these ``refusals`` in its record."""
