# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Send transforms to a robot, without ROS 2."""

import threading
from collections.abc import Callable, Iterable
from copy import deepcopy

from tf2_py import BufferCore, stored_name
from tf2_ros import TransformStamped
from tf2_ros.records import Recording, refusal_text
from tf2_ros.serialization import MessageSource, insert_messages, serialize_transforms
from tf2_ros_tools.live.transport import Sender

OWN = "this program"  # the authority of what broadcasters send


class Broadcaster:
    """
    Sends transforms on ``/tf``; made by :meth:`Feed.broadcaster`. Several threads may send. It ends with its
    feed.
    """

    def __init__(self, sender: Sender, require_open: Callable[[], None]) -> None:
        self._sender, self._require_open = sender, require_open
        # Says what every buffer refuses. It holds nothing, but knows what it has warned about.
        self._judge = BufferCore()
        self._judging = threading.RLock()

    def sendTransform(self, transform: TransformStamped | Iterable[TransformStamped]) -> None:
        """
        Send one transform, or several in one message.

        :param transform: a ``TransformStamped``, or an iterable of them: translations in meters, rotations as
            unit quaternions.
        :raises TypeError: ``transform`` is neither, or a field has the wrong type; nothing is sent.
        :raises ValueError: every listener would refuse one of them, for example because a number is NaN, as
            with ``strict=True`` of tf2_ros's broadcasters, or a name contains a NUL character; nothing is
            sent.
        :raises OverflowError: a stamp does not fit into a message; nothing is sent.
        :raises ConnectionError: the feed has ended, or sending failed.
        :raises RuntimeError: this is a forked child of the process that made the feed.
        """
        self._sender.send(self._serialized(transform))

    def _serialized(self, transform: TransformStamped | Iterable[TransformStamped]) -> bytes:
        """Serialize valid transforms; raise what ``sendTransform`` raises."""
        self._require_open()  # first, because a forked child must not wait for a lock of its parent
        data, recording = serialize_transforms(transform), Recording()
        with self._judging:
            insert_messages(self._judge, [(OWN, 0, data)], [MessageSource(OWN)], recording=recording)
            self._judge.clear()
        frames = recording.frames()
        for record in recording.take():
            if record["refusals"]:
                parent, child = frames[record["parent"]], frames[record["child"]]
                why = refusal_text(int(record["refusals"]))
                which = f"from frame_id {parent!r} to child_frame_id {child!r}"
                raise ValueError(f"the transform {which} is not sent: {why}")
        return data


class StaticBroadcaster(Broadcaster):
    """
    Sends transforms on ``/tf_static``, where late listeners also receive them; made by
    :meth:`Feed.static_broadcaster`.

    Every message contains all transforms sent so far, one for each child frame. Several threads may send. It
    ends with its feed.
    """

    def __init__(self, sender: Sender, require_open: Callable[[], None]) -> None:
        super().__init__(sender, require_open)
        self._sending = threading.RLock()  # the last message must contain all transforms
        self._sent: dict[str, TransformStamped] = {}  # by child frame

    def sendTransform(self, transform: TransformStamped | Iterable[TransformStamped]) -> None:
        """
        Send one transform, or several; each replaces what was sent before for its child frame.

        :param transform: a ``TransformStamped``, or an iterable of them. Static transforms are valid at all
            times, regardless of their stamps.

        It raises what :meth:`Broadcaster.sendTransform` raises, and then neither sends nor keeps anything.
        """
        new = list(transform) if isinstance(transform, Iterable) else [transform]
        self._serialized(new)  # raises what is wrong with them
        # Listeners ignore a slash at the beginning of a name.
        with self._sending:
            merged = self._sent | {stored_name(one.child_frame_id): deepcopy(one) for one in new}
            self._sender.send(serialize_transforms(merged.values()))
            self._sent = merged
