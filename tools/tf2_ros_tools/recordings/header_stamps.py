# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Read the headers of recorded messages, of any type that begins with one: stamps, and names of frames."""

import struct
import warnings
from collections.abc import Collection, Iterator
from itertools import islice
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tf2_py.printable import printable
from tf2_ros_tools.recordings import foxglove_messages
from tf2_ros_tools.recordings.bag_reader import (
    BagError,
    Raw,
    Recorded,
    RecordedTopic,
    S,
    encoding_of,
    explained,
    full_name,
    listed,
    open_recording,
    typestore,
)

if TYPE_CHECKING:
    from rosbags.interfaces import Connection

# In place of a stamp of 0, which is not set: to lookups, 0 means the latest time, and this, NaT, no time.
UNSET_NS = -(1 << 63)
HEADER = "std_msgs/msg/Header"


def stamps(path: "str | PathLike[str]", topic: str) -> NDArray[np.int64]:
    """
    Read the stamps of all messages of a topic, for lookups at these times.

    :param path: the recording, see :func:`tf2_ros_tools.bag.load`.
    :param topic: a topic of any type whose messages begin with a ``std_msgs/Header``, or a type of Foxglove
        with a ``timestamp``.
    :return: int64, shape (N,), nanoseconds, in the order of the recording. If the stamp of a message is not
        set, it is the smallest int64, NaT: a lookup at this time has no answer, whereas 0 would mean the
        latest time.
    :raises FileNotFoundError, ModuleNotFoundError: see :func:`tf2_ros_tools.bag.load`.
    :raises BagError: the recording is broken, does not have the topic, or its messages have no header.

    A warning says if the files of a folder have fewer messages than its ``metadata.yaml`` counts.
    """
    with open_recording(path) as recorded:
        found = stamps_of(recorded, topic)
        for text in recorded.shortfalls([topic]):
            warnings.warn(f"{printable(recorded.path)}: {text}", stacklevel=2)
        return found


def stamps_of(recorded: Recorded, topic: str) -> NDArray[np.int64]:
    """
    Read the stamps of all messages of a topic whose messages begin with a ``std_msgs/Header``, or are those
    of Foxglove.

    :return: nanoseconds, in the order of the recording; UNSET_NS if a stamp is not set.
    :raises BagError: the topic does not exist, its messages begin with something else, or one cannot be read.
    """
    name = f"{printable(recorded.path)}, topic {printable(topic)}"
    if topic not in recorded.topics:
        raise BagError(f"{name}: this topic does not exist; the topics are {listed(recorded.topics)}")
    about = recorded.topics[topic]
    try:
        stamped = _is_stamped(recorded, about)
    except Exception as error:  # the parsers define error classes only for some kinds of damage
        where = f"topic {printable(topic)}, definition of its type"
        raise explained(error, recorded.path, where) from error
    if foxglove_messages.is_stamped(about.msgtype):
        recorded.require_encoding(topic)
    if not stamped:
        raise BagError(f"{name}: {printable(about.msgtype)} does not begin with a {HEADER}")
    found = np.array([*_stamps(recorded, about)], np.int64)
    found[found == 0] = UNSET_NS
    return found


def frames_of_headers(recorded: Recorded, others: Collection[str]) -> dict[str, str]:
    """
    Read the frame that the first message of each topic names in its header, by the topic.

    :param others: topics that are left out.
    """
    found = {}
    for about in recorded.topics.values():
        if about.name in others or about.encoding not in ("cdr", "ros1") or about.count == 0:
            continue
        try:
            if all(map(_begins_with_header, recorded.connections([about.name]))):
                for _, _, raw in islice(recorded.raw([about.name], convert=False), 1):
                    found[about.name] = _frame(about.encoding, raw)
        except Exception:  # of a damaged message, which nobody wants here, the parsers raise any kind
            continue
    return found


def _is_stamped(recorded: Recorded, about: RecordedTopic) -> bool:
    if foxglove_messages.is_stamped(about.msgtype):
        return True
    return all(map(_begins_with_header, recorded.connections([about.name])))


def _stamps(recorded: Recorded, about: RecordedTopic) -> Iterator[int]:
    for connection, log_ns, raw in recorded.checked(recorded.raw([about.name], convert=False)):
        encoding = encoding_of(connection)  # the channels of a topic may differ
        if foxglove_messages.is_stamped(about.msgtype):
            yield recorded.of_foxglove(connection, log_ns, raw, foxglove_messages.stamp_ns)
            continue
        try:
            yield _stamp_ns(encoding, raw)
        except (ValueError, IndexError, struct.error) as error:
            recorded.malformed(about.name, log_ns, error)


def _stamp_ns(encoding: str, raw: Raw) -> int:
    # Four bytes come first: the encapsulation, whose second byte is odd for little-endian numbers; in ROS 1,
    # the `seq` of the header.
    order = "<" if encoding == "ros1" or raw[1] & 1 else ">"
    sec, nanosec = struct.unpack_from(f"{order}iI", raw, 4)
    return int(sec) * S + int(nanosec)


def _frame(encoding: str, raw: Raw) -> str:
    # After the stamp; in ROS 1, no zero ends it.
    order = "<" if encoding == "ros1" or raw[1] & 1 else ">"
    (size,) = struct.unpack_from(f"{order}I", raw, 12)
    return bytes(raw[16 : 16 + size]).rstrip(b"\0").decode()


def _begins_with_header(connection: "Connection") -> bool:
    from rosbags.interfaces import MessageDefinitionFormat
    from rosbags.typesys import get_types_from_msg

    msgtype, (form, text) = full_name(connection.msgtype), connection.msgdef
    if form == MessageDefinitionFormat.MSG:
        types = get_types_from_msg(text, msgtype)
    else:
        types = typestore().fielddefs
    _, fields = types.get(msgtype, ([], []))
    return msgtype == HEADER or (bool(fields) and fields[0][1][1] == HEADER)
