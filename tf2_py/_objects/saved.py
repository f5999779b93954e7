"""
Owns buffers as files: recordings in mcap of ``/tf`` and ``/tf_static``, with the rest as metadata.

Any tool reads the transforms. Only this module reads the metadata; it stands before the messages.
"""

from __future__ import annotations

import json
import os
import stat
import sys
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, BinaryIO, NoReturn

from tf2_py._objects.histories import COUNT, FRAME_COLUMNS, KIND, STATIC_KIND
from tf2_py._objects.printable import printable
from tf2_py._objects.sample_messages import SampleReader, serialize_samples
from tf2_py._objects.whole_file import whole_file

if TYPE_CHECKING:
    import numpy as np

# NumPy and mcap are imported with the first call that needs them: the engine itself does without.

__all__ = ["load_state", "save_state"]

METADATA = "tf2_ros_cython.buffer"
DYNAMIC, STATIC = "/tf", "/tf_static"
# The transforms of so long a time share a message: players and readers work message by message.
MESSAGE_NS = 10_000_000
MOST_PER_MESSAGE = 1000  # dynamic transforms; all static ones are one message: late subscribers get the last
# What a state says in arrays of samples, which messages hold.
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


def save_state(state: dict[str, Any], path: str | os.PathLike[str]) -> None:
    """
    Write a state of ``tf2_py._engine.travel``.

    :raises ModuleNotFoundError: the library mcap is missing.
    :raises OSError: the file cannot be written; what was there before stays.
    """
    writer_module = _mcap("writer")
    with whole_file(path) as file:
        writer = writer_module.Writer(file, enable_data_crcs=True)
        writer.start(profile="ros2", library="tf2-ros-cython")
        writer.add_metadata(METADATA, _metadata_of(state))
        schema = writer.register_schema(TYPE, "ros2msg", DEFINITION.encode())
        channels = {
            topic: writer.register_channel(topic, "cdr", schema, {"offered_qos_profiles": qos})
            for topic, qos in QOS.items()
        }
        for sequence, (topic, log_time_ns, data) in enumerate(_messages(state)):
            writer.add_message(channels[topic], log_time_ns, data, log_time_ns, sequence)
        writer.finish()


def load_state(path: str | os.PathLike[str]) -> dict[str, Any]:
    """
    Read what :func:`save_state` wrote. The state that it returns is still to be checked.

    :raises ModuleNotFoundError: the library mcap is missing.
    :raises FileNotFoundError, OSError: the file cannot be opened or read.
    :raises ValueError: it is no mcap file, not whole, or does not hold a buffer; the text names the file.
    """
    stream_reader = _mcap("stream_reader")
    with open(path, "rb") as file:
        try:
            return _read(stream_reader.StreamReader(_Bounded(file), validate_crcs=True).records)
        except (MemoryError, OSError):
            raise
        # The library raises what its own parts and those for compression happen to raise.
        except Exception as error:
            reason = str(error) or type(error).__name__
            raise ValueError(f"{printable(os.fspath(path))}: {reason}") from error


class _Bounded:
    """A file that is never asked for more than it holds: a damaged length would be a matter of memory."""

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


def _messages(state: dict[str, Any]) -> Iterator[tuple[str, int, bytes]]:
    """Topic, log time in ns, and the serialised message: static ones first, the others by stamp."""
    import numpy as np

    names = _names_by_id(state)
    frames, stamps = state["frames"], state["stamps"]
    ids = np.arange(1, len(frames) + 1, dtype=np.uint32)
    children = np.repeat(ids, frames[:, COUNT])
    is_static = np.repeat(frames[:, KIND] == STATIC_KIND, frames[:, COUNT])
    samples = (children, state["parents"], stamps, state["transforms"])
    static_rows = np.flatnonzero(is_static)
    # Stable: of equal stamps, each frame's remain in order of arrival.
    rows = np.flatnonzero(~is_static)
    rows = rows[np.argsort(stamps[rows], kind="stable")]
    times = stamps[rows]
    if len(static_rows):
        first_ns = times[0] if len(times) else stamps[static_rows].max()
        yield STATIC, int(first_ns), serialize_samples(names, static_rows, *samples)
    ends = np.append(np.flatnonzero(np.diff(times // MESSAGE_NS)) + 1, len(rows))
    start = 0
    for end in ends.tolist():
        while start < end:
            next_start = min(end, start + MOST_PER_MESSAGE)
            data = serialize_samples(names, rows[start:next_start], *samples)
            # A sender knows a transform at its stamp, not before.
            yield DYNAMIC, int(times[next_start - 1]), data
            start = next_start


def _names_by_id(state: dict[str, Any]) -> list[bytes]:
    # As sample_messages takes them.
    return [b"", *state["names"].split(b"\0")[:-1]]


def _read(records: Iterator[Any]) -> dict[str, Any]:
    state: dict[str, Any] | None = None
    reader: SampleReader | None = None
    topics: dict[int, str] = {}
    for record in records:
        match type(record).__name__:
            case "Metadata" if record.name == METADATA:
                state = _state_of(record.metadata)
                reader = SampleReader(_names_by_id(state))
            case "Channel":
                topics[record.id] = record.topic
            case "Message":
                if reader is None:
                    _refuse_recording()
                if topics[record.channel_id] in QOS:
                    reader.read(record.data)
    if state is None or reader is None:
        _refuse_recording()
    return state | _samples(state["frames"], *reader.arrays())


def _refuse_recording() -> NoReturn:
    raise ValueError("it holds no buffer that save() wrote; tf2_ros.bag.load reads recordings")


def _state_of(metadata: dict[str, str]) -> dict[str, Any]:
    """The state without samples. Only what this needs is checked."""
    import numpy as np

    state = {key: json.loads(text) for key, text in metadata.items()}
    missing = {"names", "authorities", "frames", "refused"} - state.keys()
    if missing:
        raise ValueError(f"its metadata {METADATA} lack {', '.join(sorted(missing))}")
    for key in ("names", "authorities"):
        if not isinstance(state[key], list) or not all(isinstance(name, str) for name in state[key]):
            raise ValueError(f"its metadata {METADATA} hold {key} that are no list of names")
        state[key] = "".join(f"{name}\0" for name in state[key]).encode()
    state["refused"] = tuple(state["refused"])
    state["frames"] = np.array(state["frames"], dtype=np.uint32).reshape(-1, FRAME_COLUMNS)
    return state


def _samples(
    frames: np.ndarray, children: np.ndarray, parents: np.ndarray, stamps: np.ndarray, transforms: np.ndarray
) -> dict[str, Any]:
    """In the order of the frames, those of each in the order of the messages."""
    import numpy as np

    counts = np.bincount(children, minlength=len(frames) + 1)[1:]
    if not np.array_equal(counts, frames[:, COUNT]):
        raise ValueError(
            f"its messages hold {len(children)} transforms of frames that have {frames[:, COUNT].sum()}, "
            "or not those of the same frames"
        )
    order = np.argsort(children, kind="stable")
    return {"stamps": stamps[order], "transforms": transforms[order], "parents": parents[order]}
