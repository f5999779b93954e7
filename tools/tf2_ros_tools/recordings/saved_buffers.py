# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""
Write and read buffers as files: recordings in mcap of ``/tf`` and ``/tf_static``, with the rest as metadata.

Any tool can read the transforms. Only this module reads the metadata, which precedes the messages.
"""

from __future__ import annotations

import json
import os
import stat
import sys
from collections.abc import Iterator
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO, TypeVar, overload

import numpy as np

from tf2_py import BufferCore
from tf2_py.atomic_files import whole_file
from tf2_py.printable import printable
from tf2_ros import Buffer
from tf2_ros.serialization import serialize_arrays
from tf2_ros_tools.common.optional_libraries import require
from tf2_ros_tools.recordings.bag_reader import typestore

_Kind = TypeVar("_Kind", bound=BufferCore)

METADATA = "tf2_ros_cython.buffer"
DYNAMIC, STATIC = "/tf", "/tf_static"
# The transforms within this time share a message, because players and readers work message by message.
MESSAGE_NS = 10_000_000
# Before compression. A file without its end can be read up to its last whole chunk.
CHUNK_BYTES = 1 << 15
MOST_PER_MESSAGE = 1000  # dynamic ones; one message has all static ones: late subscribers get only the last
# Of a state. The metadata have the rest, the authority of each frame, and the number of samples.
NOT_IN_METADATA = {"frames", "stamps", "transforms", "parents", "parent_names", "attributes"}

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


def save(buffer: BufferCore, path: str | os.PathLike[str]) -> None:
    """
    Write the present contents of a buffer to an ``.mcap`` file, which any tool for recordings can open.

    The transforms are ordinary messages on ``/tf`` and ``/tf_static``, in the order of their stamps; what
    messages cannot hold is metadata of the file. :func:`load_saved` returns an equal buffer. An existing file
    is replaced when the new one is complete. Attributes of a subclass are not saved.

    :param buffer: a ``BufferCore`` or a ``Buffer``.
    :param path: the file, usually with the ending ``.mcap``.
    :raises OSError: the file cannot be written; an existing file remains unchanged.
    :raises ModuleNotFoundError: the library mcap is missing: ``pip install 'tf2-ros-tools[bag]'``.
    """
    require("mcap", "bag")
    require("rosbags", "bag")
    from mcap.writer import Writer

    state = _state_of(buffer)
    with whole_file(path) as file:
        writer = Writer(file, chunk_size=CHUNK_BYTES, enable_data_crcs=True)
        writer.start(profile="ros2", library="tf2-ros-cython")
        writer.add_metadata(METADATA, _metadata_of(state))
        definition, _ = typestore().generate_msgdef(TYPE, ros_version=2)
        schema = writer.register_schema(TYPE, "ros2msg", definition.encode())
        channels = {
            topic: writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": qos})
            for topic, qos in QOS.items()
        }
        for sequence, (topic, log_time_ns, data) in enumerate(_messages(state)):
            writer.add_message(channels[topic], log_time_ns, data, log_time_ns, sequence)
        writer.finish()  # type: ignore[no-untyped-call]


@overload
def load_saved(path: str | os.PathLike[str]) -> Buffer: ...
@overload
def load_saved(path: str | os.PathLike[str], kind: type[_Kind]) -> _Kind: ...
def load_saved(path: str | os.PathLike[str], kind: type[BufferCore] = Buffer) -> BufferCore:
    """
    Load a buffer from a file that :func:`save` wrote; its answers are identical to the last bit.

    :func:`load` reads other recordings.

    :param path: the file.
    :param kind: the class of the buffer, whose ``__init__`` is not called.
    :raises FileNotFoundError, OSError: the file cannot be opened or read.
    :raises ValueError: it is not an mcap file, is damaged or truncated, or does not contain a buffer; the
        text contains the file and, if possible, the frame and sample.
    :raises ModuleNotFoundError: the library mcap is missing: ``pip install 'tf2-ros-tools[bag]'``.
    """
    require("mcap", "bag")
    from mcap.stream_reader import StreamReader

    # Without limits, so that it keeps whatever the file has.
    scratch = BufferCore(float("inf"), max_frames=2**31 - 1, max_bytes=2**63 - 1)
    with open(path, "rb") as file:
        try:
            records = StreamReader(_Bounded(file), validate_crcs=True).records  # type: ignore[arg-type]
            loaded = kind.__new__(kind)
            loaded.__setstate__(_read(records, scratch))
        except (MemoryError, OSError):
            raise
        # The library raises what its own parts and those for compression happen to raise.
        except Exception as error:
            reason = str(error) or type(error).__name__
            raise ValueError(f"{printable(os.fspath(path))}: {reason}") from error
    return loaded


class _Bounded:
    """Reads no more than a file holds, because a damaged length could allocate any amount of memory."""

    def __init__(self, file: BinaryIO) -> None:
        facts = os.fstat(file.fileno())
        self._file = file
        self._left = facts.st_size if stat.S_ISREG(facts.st_mode) else sys.maxsize

    def read(self, size: int) -> bytes:
        if size > self._left:
            raise ValueError("it is damaged or truncated: a length field points beyond its end")
        data = self._file.read(size)
        self._left -= len(data)
        return data


def _state_of(buffer: BufferCore) -> dict[str, Any]:
    """The samples of a buffer, also where the path of its file would stand for them."""
    state = BufferCore.__getstate__(buffer)
    if "frozen" not in state:
        return state
    copied, failure = None, None
    try:
        with TemporaryDirectory() as folder:
            link = os.path.join(folder, "buffer.tf2")
            os.symlink(state["frozen"][0], link)
            opened = BufferCore.open(link)
        # The path that it was opened by is gone, so its state contains the samples.
        copied = BufferCore.__getstate__(opened)
    except (OSError, ValueError) as error:
        failure = error
    # The buffer keeps its file if another one has taken its place, which the copy may come from.
    later = BufferCore.__getstate__(buffer)
    if "frozen" not in later:
        return later
    if copied is None:
        assert failure is not None
        raise failure
    return copied


def _metadata_of(state: dict[str, Any]) -> dict[str, str]:
    kept = {key: value for key, value in state.items() if key not in NOT_IN_METADATA}
    kept["samples"] = len(state["stamps"])
    kept["authorities"] = {name: authority for name, _, authority, _ in state["frames"]}
    return {key: json.dumps(value, ensure_ascii=False) for key, value in kept.items()}


def _messages(state: dict[str, Any]) -> Iterator[tuple[str, int, bytes]]:
    """Topic, log time in ns, and serialized message: the static transforms first, the others by stamp."""
    stamps, transforms = state["stamps"], state["transforms"]
    counts = np.array([count for *_, count in state["frames"]], np.int64)
    children = np.repeat(np.arange(len(counts)), counts)
    names, parent_names = [name for name, *_ in state["frames"]], state["parent_names"]

    def serialized(rows: Any) -> bytes:
        pairs = zip(state["parents"][rows].tolist(), children[rows].tolist(), strict=True)
        frames = [(parent_names[parent], names[child]) for parent, child in pairs]
        return serialize_arrays(frames, stamps[rows], transforms[rows])

    is_static = np.repeat(np.array([is_static for _, is_static, *_ in state["frames"]], bool), counts)
    static_rows = np.flatnonzero(is_static)
    # Stable, so that samples of a frame with equal stamps remain in order of arrival.
    rows = np.flatnonzero(~is_static)
    rows = rows[np.argsort(stamps[rows], kind="stable")]
    times = stamps[rows]
    if len(static_rows):
        first_ns = times[0] if len(times) else stamps[static_rows].max()
        yield STATIC, int(first_ns), serialized(static_rows)
    ends = np.append(np.flatnonzero(np.diff(times // MESSAGE_NS)) + 1, len(rows))
    start = 0
    for end in ends.tolist():
        while start < end:
            next_start = min(end, start + MOST_PER_MESSAGE)
            data = serialized(rows[start:next_start])
            # A sender knows a transform at its stamp, not earlier.
            yield DYNAMIC, int(times[next_start - 1]), data
            start = next_start


def _read(records: Iterator[Any], scratch: BufferCore) -> dict[str, Any]:
    metadata: dict[str, str] | None = None
    topics: dict[int, str] = {}
    for record in records:
        match type(record).__name__:
            case "Metadata" if record.name == METADATA:
                metadata = record.metadata
            case "Channel":
                topics[record.id] = record.topic
            case "Message" if metadata is None:
                break
            case "Message" if topics[record.channel_id] in QOS:
                scratch.set_transforms_cdr(record.data, "", topics[record.channel_id] == STATIC)
    if metadata is None:
        raise ValueError(
            "it does not contain a buffer written by save(); tf2_ros_tools.bag.load reads recordings"
        )
    return _with_metadata(scratch.__getstate__(), metadata)


def _with_metadata(state: dict[str, Any], metadata: dict[str, str]) -> dict[str, Any]:
    as_in_state = state.keys() - NOT_IN_METADATA
    missing = {*as_in_state, "samples", "authorities"} - metadata.keys()
    if missing:
        raise ValueError(f"its metadata {METADATA} lacks {', '.join(sorted(missing))}")
    kept = {key: json.loads(text) for key, text in metadata.items()}
    if kept["samples"] != len(state["stamps"]):
        listed, found = kept["samples"], len(state["stamps"])
        raise ValueError(
            f"it is incomplete: its metadata lists {listed} transforms, its messages contain {found}"
        )
    if kept["authorities"].keys() != {name for name, *_ in state["frames"]}:
        raise ValueError(f"its metadata {METADATA} and its messages contain different frames")
    frames = [
        (name, is_static, kept["authorities"][name], count) for name, is_static, _, count in state["frames"]
    ]
    return state | {key: kept[key] for key in as_in_state} | {"frames": frames}
