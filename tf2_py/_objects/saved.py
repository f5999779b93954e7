"""
Write and read buffers as files: recordings in mcap of ``/tf`` and ``/tf_static``, with the rest as metadata.

Any tool can read the transforms. Only this module reads the metadata, which precedes the messages.
"""

from __future__ import annotations

import json
import os
import stat
import sys
from collections.abc import Callable, Iterator
from typing import Any, BinaryIO

from tf2_py._objects.errors import printable
from tf2_py._objects.listings import COUNT, FRAME_COLUMNS, KIND, STATIC_KIND
from tf2_py._objects.whole_file import whole_file

# NumPy and mcap are imported by the first call that needs them, because the engine does not need them.

METADATA = "tf2_ros_cython.buffer"
DYNAMIC, STATIC = "/tf", "/tf_static"
# The transforms within this time share a message, because players and readers work message by message.
MESSAGE_NS = 10_000_000
# Before compression. A file without its end can be read up to its last whole chunk.
CHUNK_BYTES = 1 << 15
MOST_PER_MESSAGE = 1000  # dynamic ones; one message has all static ones: late subscribers get only the last
# The arrays of samples in a state; the messages hold these.
SAMPLES = {"stamps", "transforms", "parents"}

# As rosbag2 writes it.
_QOS = """\
- history: keep_last
  depth: {depth}
  reliability: reliable
  durability: {durability}
  deadline:
    sec: 9223372036
    nsec: 854775807
  lifespan:
    sec: 9223372036
    nsec: 854775807
  liveliness: automatic
  liveliness_lease_duration:
    sec: 9223372036
    nsec: 854775807
  avoid_ros_namespace_conventions: false"""
QOS = {
    DYNAMIC: _QOS.format(depth=100, durability="volatile"),
    STATIC: _QOS.format(depth=1, durability="transient_local"),
}

TYPE = "tf2_msgs/msg/TFMessage"
_RULE = "=" * 80
DEFINITION = f"""\
geometry_msgs/TransformStamped[] transforms
{_RULE}
MSG: geometry_msgs/TransformStamped
std_msgs/Header header
string child_frame_id
geometry_msgs/Transform transform
{_RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
{_RULE}
MSG: geometry_msgs/Transform
geometry_msgs/Vector3 translation
geometry_msgs/Quaternion rotation
{_RULE}
MSG: geometry_msgs/Vector3
float64 x
float64 y
float64 z
{_RULE}
MSG: geometry_msgs/Quaternion
float64 x 0
float64 y 0
float64 z 0
float64 w 1
"""


def save_state(state: dict[str, Any], path: str | os.PathLike[str], serialize: Callable[..., bytes]) -> None:
    """
    Write a state of ``tf2_py/engine/state.pyx``.

    :param serialize: ``serialize_samples`` of the engine, which imports this module.
    :raises ModuleNotFoundError: the library mcap is missing.
    :raises OSError: the file cannot be written; what was there before stays.
    """
    writer_module = _mcap("writer")
    with whole_file(path) as file:
        writer = writer_module.Writer(file, chunk_size=CHUNK_BYTES, enable_data_crcs=True)
        writer.start(profile="ros2", library="tf2-ros-cython")
        writer.add_metadata(METADATA, _metadata_of(state))
        schema = writer.register_schema(TYPE, "ros2msg", DEFINITION.encode())
        channels = {
            topic: writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": qos})
            for topic, qos in QOS.items()
        }
        for sequence, (topic, log_time_ns, data) in enumerate(_messages(state, serialize)):
            writer.add_message(channels[topic], log_time_ns, data, log_time_ns, sequence)
        writer.finish()


def load_state(path: str | os.PathLike[str], scratch: Any) -> dict[str, Any]:
    """
    Read what :func:`save_state` wrote. The state that it returns is still to be checked.

    :param scratch: an empty BufferCore without limits, which reads the messages.
    :raises ModuleNotFoundError: the library mcap is missing.
    :raises FileNotFoundError, OSError: the file cannot be opened or read.
    :raises ValueError: it is not an mcap file, not whole, or does not hold a buffer; the text names the file.
    """
    stream_reader = _mcap("stream_reader")
    with open(path, "rb") as file:
        try:
            return _read(stream_reader.StreamReader(_Bounded(file), validate_crcs=True).records, scratch)
        except (MemoryError, OSError):
            raise
        # The library raises what its own parts and those for compression happen to raise.
        except Exception as error:
            reason = str(error) or type(error).__name__
            raise ValueError(f"{printable(os.fspath(path))}: {reason}") from error


class _Bounded:
    """Reads no more than a file holds, because a damaged length could allocate any amount of memory."""

    def __init__(self, file: BinaryIO) -> None:
        facts = os.fstat(file.fileno())
        self._file = file
        self._left = facts.st_size if stat.S_ISREG(facts.st_mode) else sys.maxsize

    def read(self, size: int) -> bytes:
        if size > self._left:
            raise ValueError("it is damaged, or not whole: a length goes beyond its end")
        data = self._file.read(size)
        self._left -= len(data)
        return data


def _mcap(module: str) -> Any:
    import importlib

    try:
        return importlib.import_module(f"mcap.{module}")
    except ModuleNotFoundError as missing:
        raise ModuleNotFoundError(
            f"{missing.name} is missing, which reads and writes .mcap: pip install 'tf2-ros-cython[bag]'",
            name=missing.name,
        ) from None


def _metadata_of(state: dict[str, Any]) -> dict[str, str]:
    plain = {key: value for key, value in state.items() if key not in SAMPLES}
    plain["frames"] = plain["frames"].tolist()
    for key in ("names", "authorities"):
        plain[key] = plain[key].decode().split("\0")[:-1]
    return {key: json.dumps(value, ensure_ascii=False) for key, value in plain.items()}


def _messages(state: dict[str, Any], serialize: Callable[..., bytes]) -> Iterator[tuple[str, int, bytes]]:
    """Topic, log time in ns, and serialised message: the static transforms first, the others by stamp."""
    import numpy as np

    names = _names_by_id(state)
    frames, stamps = state["frames"], state["stamps"]
    ids = np.arange(1, len(frames) + 1, dtype=np.uint32)
    children = np.repeat(ids, frames[:, COUNT])
    is_static = np.repeat(frames[:, KIND] == STATIC_KIND, frames[:, COUNT])
    samples = (children, state["parents"], stamps, state["transforms"])
    static_rows = np.flatnonzero(is_static)
    # Stable, so that samples of a frame with equal stamps remain in order of arrival.
    rows = np.flatnonzero(~is_static)
    rows = rows[np.argsort(stamps[rows], kind="stable")]
    times = stamps[rows]
    if len(static_rows):
        first_ns = times[0] if len(times) else stamps[static_rows].max()
        yield STATIC, int(first_ns), serialize(names, static_rows, *samples)
    ends = np.append(np.flatnonzero(np.diff(times // MESSAGE_NS)) + 1, len(rows))
    start = 0
    for end in ends.tolist():
        while start < end:
            next_start = min(end, start + MOST_PER_MESSAGE)
            data = serialize(names, rows[start:next_start], *samples)
            # A sender knows a transform at its stamp, not earlier.
            yield DYNAMIC, int(times[next_start - 1]), data
            start = next_start


def _names_by_id(state: dict[str, Any]) -> list[bytes]:
    # As serialize_samples takes them.
    return [b"", *state["names"].split(b"\0")[:-1]]


def _read(records: Iterator[Any], scratch: Any) -> dict[str, Any]:
    state: dict[str, Any] | None = None
    topics: dict[int, str] = {}
    for record in records:
        match type(record).__name__:
            case "Metadata" if record.name == METADATA:
                state = _state_of(record.metadata)
            case "Channel":
                topics[record.id] = record.topic
            case "Message" if state is None:
                break
            case "Message" if topics[record.channel_id] in QOS:
                scratch.set_transforms_cdr(record.data, "", topics[record.channel_id] == STATIC)
    if state is None:
        raise ValueError("it holds no buffer that save() wrote; tf2_ros_tools.bag.load reads recordings")
    return state | _samples_of(scratch.__getstate__(), state)


def _state_of(metadata: dict[str, str]) -> dict[str, Any]:
    """The state without samples. Checks only what this function needs."""
    import numpy as np

    state = {key: json.loads(text) for key, text in metadata.items()}
    missing = {"names", "authorities", "frames", "refused"} - state.keys()
    if missing:
        raise ValueError(f"its metadata {METADATA} lack {', '.join(sorted(missing))}")
    for key in ("names", "authorities"):
        if not isinstance(state[key], list) or not all(isinstance(name, str) for name in state[key]):
            raise ValueError(f"its metadata {METADATA} hold {key} that are not a list of names")
        state[key] = "".join(f"{name}\0" for name in state[key]).encode()
    state["refused"] = tuple(state["refused"])
    state["frames"] = np.array(state["frames"], dtype=np.uint32).reshape(-1, FRAME_COLUMNS)
    return state


def _samples_of(read: dict[str, Any], wanted: dict[str, Any]) -> dict[str, Any]:
    """The samples of the first state, in the order of the frames of the second, and with its ids."""
    import numpy as np

    names = _names_by_id(read)
    ids = {name: id for id, name in enumerate(_names_by_id(wanted))}
    ends = np.cumsum(read["frames"][:, COUNT], dtype=np.int64)
    counts = np.zeros(len(wanted["frames"]) + 1, np.int64)
    rows: list[Any] = [()] * len(counts)
    for name, end, count in zip(names[1:], ends.tolist(), read["frames"][:, COUNT].tolist(), strict=True):
        if name not in ids:
            raise ValueError(f"a frame that is not among the names: {printable(name.decode())}")
        rows[ids[name]] = range(end - count, end)
        counts[ids[name]] = count
    if not np.array_equal(counts[1:], wanted["frames"][:, COUNT]):
        raise ValueError(
            f"its messages hold {counts.sum()} transforms of frames that have "
            f"{wanted['frames'][:, COUNT].sum()}, or not those of the same frames"
        )
    order = np.concatenate([np.array(one, np.int64) for one in rows])
    places = np.array([ids[name] for name in names], np.uint32)
    return {
        "stamps": read["stamps"][order],
        "transforms": read["transforms"][order],
        "parents": places[read["parents"][order]],
    }
