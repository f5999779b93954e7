# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Look up tables of poses, and write them as CSV, TUM and Parquet."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tf2_py import BufferCore, ConnectivityException, History, TransformException
from tf2_py.printable import counted, printable
from tf2_ros.serialization import serialize_arrays
from tf2_ros_tools.common.optional_libraries import require
from tf2_ros_tools.diagnosis.stream_statistics import path_to_root, taken
from tf2_ros_tools.recordings.bag_reader import LAST_NS
from tf2_ros_tools.recordings.frames_between import frames_between
from tf2_ros_tools.recordings.header_stamps import UNSET_NS
from tf2_ros_tools.recordings.saved_buffers import by_stamp

if TYPE_CHECKING:
    from tf2_ros import Buffer
    from tf2_ros_tools.recordings.bag_loader import BagContents

S = 1_000_000_000
# A stamp in 1970 beside current ones is a mistake, and must not make the table fill the memory.
MOST_TIMES = 50_000_000
PIECE = 10_000  # rows
# The columns of a table, in each format that has names.
STAMP_NS, POSE, VALID, GAP = "stamp_ns", ("x", "y", "z", "qx", "qy", "qz", "qw"), "valid", "gap"


@dataclass(frozen=True)
class Table:
    """
    The poses of F frames in another one at N times.

    :param stamps_ns: int64, shape (N,), nanoseconds.
    :param poses: float64, shape (N, F, 7): x y z in meters, qx qy qz qw of length one, with the sign that is
        closer to the row before; NaN without an answer.
    :param gaps: float64, shape (N, F): seconds between the two samples that a pose was interpolated from, the
        longest of all frames in between but one that a trajectory corrects; 0 at a sample and if nothing
        moves; NaN without an answer.
    """

    stamps_ns: NDArray[np.int64]
    poses: NDArray[np.float64]
    gaps: NDArray[np.float64]

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Whether there is an answer, shape (N, F)."""
        return ~np.isnan(self.gaps)


def look_up_table(
    heard: BagContents, target: str, frames: Sequence[str], times_ns: ArrayLike, max_gap: float | None = None
) -> tuple[Table, dict[str, str]]:
    """
    Look up F frames in ``target`` at N times; see :func:`look_up`.

    :param max_gap: there is no answer between samples that are further apart, in seconds. None: there is.
    :return: the table; and, by the names of the frames that have no answer at any time, why.
    """
    stamps_ns = np.asarray(times_ns, np.int64)
    poses = np.full((len(stamps_ns), len(frames), 7), np.nan)
    gaps = np.full(poses.shape[:2], np.nan)
    reasons: dict[str, str] = {}
    histories = heard.buffer.histories()
    for i, frame in enumerate(frames):
        try:
            found = _look_up_frame(heard, histories, target, frame, stamps_ns, max_gap)
            poses[:, i], gaps[:, i] = found
        except TransformException as error:
            reasons[frame] = why_unconnected(heard, target, frame, error)
            continue
        if np.isnan(gaps[:, i]).all():
            reasons[frame] = why_unanswered(
                heard.buffer, target, frame, stamps_ns, max_gap, corrected=heard.corrected
            )
    return Table(stamps_ns, poses, gaps), reasons


def _look_up_frame(
    heard: BagContents,
    histories: Mapping[str, History],
    target: str,
    source: str,
    stamps_ns: NDArray[np.int64],
    max_gap: float | None,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """
    Look up one frame: its poses and gaps, shapes (N, 7) and (N,).

    :raises TransformException: the frames are unknown, or never connected.
    """
    corrected = heard.corrected
    between = frames_between(heard.buffer, histories, target, source)
    poses = look_up(heard.buffer, target, source, stamps_ns, None if corrected else max_gap)
    gaps = np.where(np.isnan(poses[:, 0]), np.nan, 0.0)
    # The samples of a corrected frame are keyframes: the time between them is no gap in what was measured.
    for name in between.moving.keys() - {corrected}:
        own = _gaps_at(histories[name].stamps_ns, stamps_ns)
        gaps = np.maximum(gaps, np.where(between.counts(name, stamps_ns), own, 0.0))  # a NaN stays
    if corrected and max_gap is not None:
        is_wide = gaps > max_gap
        poses[is_wide] = gaps[is_wide] = np.nan
    return poses, gaps


def _gaps_at(samples: NDArray[np.int64], times_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """The seconds between the two samples around each time; 0 at a sample."""
    after = np.clip(np.searchsorted(samples, times_ns), 0, len(samples) - 1)
    between = samples[after] - samples[np.maximum(after - 1, 0)]
    return np.where(samples[after] == times_ns, 0.0, between / S)


def look_up(
    buffer: BufferCore, target: str, source: str, times_ns: ArrayLike, max_gap: float | None = None
) -> NDArray[np.float64]:
    """
    Look up the pose of ``source`` in ``target`` at each of N times; see ``Table.poses``.

    :param times_ns: shape (N,), nanoseconds. 0 is the time 0, not the latest one; UNSET_NS has no answer.
    :param max_gap: see :func:`look_up_table`.
    :raises LookupException: a frame is unknown.
    :raises InvalidArgumentException: a name is invalid.
    """
    stamps_ns = np.asarray(times_ns, np.int64)
    # For tf2, 0 means the latest common time.
    is_zero = stamps_ns == 0
    times = np.where(is_zero, UNSET_NS, stamps_ns)
    found = buffer.lookup_transforms(target, source, times, on_missing="nan", max_gap=max_gap)
    poses = np.concatenate(found, axis=1)
    if is_zero.any() and source in (first := _at_zero(buffer)) and target in first:
        found = first.lookup_transforms(target, source, [0], on_missing="nan")
        poses[is_zero] = np.concatenate(found, axis=1)
    # q and -q are the same rotation; a table must not jump from one to the other.
    valid = ~np.isnan(poses[:, 0])
    turns = poses[valid, 3:]
    jumps = (turns[1:] * turns[:-1]).sum(axis=1) < 0.0
    is_opposite = np.cumsum(jumps) % 2 == 1
    turns[1:][is_opposite] = 0.0 - turns[1:][is_opposite]  # without a zero becoming -0.0
    poses[valid, 3:] = turns
    return poses


def _at_zero(buffer: BufferCore) -> BufferCore:
    """Get the static samples and those with the stamp 0, the earliest one that a buffer accepts."""
    first = BufferCore()
    for one in buffer.histories().values():
        begin, end = (-LAST_NS, LAST_NS) if one.static else (0, 1)
        if begin <= one.stamps_ns[0] < end:
            first.set_transforms_cdr(serialize_arrays(*by_stamp([one], begin, end)), "", one.static)
    return first


def times_at_rate(buffer: BufferCore, target: str, source: str, hz: float) -> NDArray[np.int64]:
    """
    Get times at a rate, over the span in which all frames between two frames have data.

    :param hz: above 0.
    :return: int64, shape (N,), nanoseconds, from the beginning of the span; empty without a span. If all
        transforms between the frames are static, the span is that of all frames of the buffer.
    :raises TransformException: the frames are unknown or not connected.
    :raises ValueError: there would be more than 50,000,000 times.
    """
    histories = buffer.histories()
    between = frames_between(buffer, histories, target, source)
    if between.moving:
        span = between.span()
    else:
        stamps = [one.stamps_ns for one in histories.values() if not one.static]
        span = (min(one[0] for one in stamps), max(one[-1] for one in stamps)) if stamps else None
    if span is None:
        return np.zeros(0, np.int64)
    begin, end = map(int, span)
    count = (end - begin) * hz / S + 1.0
    if count > MOST_TIMES:
        when = f"from {begin / S:.3f} s to {end / S:.3f} s"
        raise ValueError(f"expected at most {MOST_TIMES} times, got {count:.0f}: {hz:g} Hz {when}")
    steps = np.rint(np.arange(int(count)) * S / hz).astype(np.int64)
    times: NDArray[np.int64] = np.minimum(begin + steps, end)
    return times


def times_when(heard: BagContents, target: str, source: str, rate: float | None) -> NDArray[np.int64]:
    """
    Get the times at a rate, with :func:`times_at_rate`; without one, whenever something was measured between
    two frames of a recording.

    :raises TransformException: the frames are unknown or not connected.
    """
    if rate is not None:
        return times_at_rate(heard.buffer, target, source, rate)
    between = frames_between(heard.buffer, heard.buffer.histories(), target, source)
    stamps = between.stamps(heard.records, heard.frames)
    # Without anything that moves, one time is enough.
    return stamps if len(stamps) else taken(heard.records)["stamp_ns"][:1].astype(np.int64)


def why_unconnected(heard: BagContents, target: str, source: str, error: TransformException) -> str:
    """Add to the error of a lookup what may explain that a frame is unknown or is not connected."""
    newest, accepted = heard.buffer.frames(), taken(heard.records)
    ends = (source, target) if isinstance(error, ConnectivityException) else ()
    for frame in (name for end in ends for name in path_to_root(newest, end)):
        own = accepted["child"] == heard.frames.index(frame)
        parents = sorted({heard.frames[parent] for parent in accepted["parent"][own]})
        if len(parents) > 1:
            return f"{error}; {frame} has {len(parents)} parents: {', '.join(parents)}"
    return "; ".join([str(error), *heard.absent])


def why_unanswered(
    buffer: Buffer,
    target: str,
    source: str,
    times_ns: NDArray[np.int64],
    max_gap: float | None = None,
    *,
    corrected: str | None = None,
) -> str:
    """Say why a lookup has no answer at any of N times; the parameters are those of :func:`look_up_table`."""
    if not len(times_ns):
        return "there are no times to look up: the frames do not move, or the topic has no messages"
    known = times_ns[times_ns != UNSET_NS]
    if not len(known):
        return unset_among(times_ns)
    try:
        buffer.lookup_transform(target, source, int(known[0]) or 1, max_gap=None if corrected else max_gap)
    except (TransformException, OverflowError) as reason:
        return str(reason)
    if corrected and max_gap is not None:
        return f"all poses are interpolated across gaps of more than {max_gap:g} s"
    return f"the frames between {target} and {source} never had data at the same time"


def why_some_are_missing(heard: BagContents, target: str, source: str, times_ns: NDArray[np.int64]) -> str:
    """Say why a lookup has no answer at some of N times; empty: nothing special is known."""
    if unset := unset_among(times_ns):
        return unset
    try:
        heard.buffer.path(target, source)
    except ConnectivityException as error:
        return f"at last, {why_unconnected(heard, target, source, error)}"
    except TransformException:
        pass
    return ""


def unset_among(times_ns: NDArray[np.int64]) -> str:
    """Say how many messages, at whose stamps something was looked up, have none; empty: all have one."""
    count = int(np.count_nonzero(times_ns == UNSET_NS))
    of = f" of {len(times_ns)}" if count < len(times_ns) else ""
    return f"the stamp is not set in {counted(count, 'message')}{of}" if count else ""


# Write tables: as text, those of one frame.


def as_csv(table: Table) -> bytes:
    """
    Write comma-separated values, after a line of names.

    ``stamp_ns`` is in nanoseconds, ``gap`` in seconds. ``valid`` is true or false; if it is false, the other
    numbers are nan.
    """
    rows = (
        f"{stamp},{','.join(pose)},{str(valid).lower()},{gap!r}\n" for stamp, pose, valid, gap in _rows(table)
    )
    return "".join([f"{','.join((STAMP_NS, *POSE, VALID, GAP))}\n", *rows]).encode()


def as_tum(table: Table) -> bytes:
    """
    Write the format of the TUM RGB-D benchmark: lines of stamp (seconds) x y z qx qy qz qw.

    The format cannot represent a missing answer, so these rows are omitted.
    """
    rows = (f"{_seconds(stamp)} {' '.join(pose)}\n" for stamp, pose, valid, _ in _rows(table) if valid)
    return "".join(rows).encode()


def as_parquet(
    table: Table,
    files: Sequence[str],
    episodes: NDArray[np.int64],
    more: Mapping[str, Any] = {},
    prefixes: Sequence[str] = ("",),
) -> bytes:
    """
    Write Parquet, with the columns ``file``, those of ``more``, ``stamp_ns``, and, for each frame, ``x`` to
    ``qw``, ``valid`` and ``gap``.

    :param files: the names of the recordings.
    :param episodes: the number of its recording for each row.
    :param prefixes: of the columns of each frame.
    :raises ModuleNotFoundError: pyarrow is not installed.
    """
    require("pyarrow", "fleet")
    import pyarrow
    from pyarrow import parquet

    names = pyarrow.array([*map(printable, files)], pyarrow.string())
    file_of_row = pyarrow.DictionaryArray.from_arrays(episodes, names)
    columns = {"file": file_of_row, **more, STAMP_NS: table.stamps_ns}
    for i, prefix in enumerate(prefixes):
        columns |= {f"{prefix}{name}": table.poses[:, i, j].copy() for j, name in enumerate(POSE)}
        columns |= {f"{prefix}{VALID}": table.valid[:, i].copy(), f"{prefix}{GAP}": table.gaps[:, i].copy()}
    written = BytesIO()
    parquet.write_table(pyarrow.table(columns), written)
    return written.getvalue()


def _seconds(stamp_ns: int) -> str:
    # A float cannot represent all digits.
    whole, part = divmod(abs(stamp_ns), S)
    return f"{'-' if stamp_ns < 0 else ''}{whole}.{part:09d}"


def _rows(table: Table) -> Iterator[tuple[int, list[str], bool, float]]:
    # In pieces, because as Python objects, millions of rows take several times the memory of their text.
    for begin in range(0, len(table), PIECE):
        piece = slice(begin, begin + PIECE)
        poses = ([*map(repr, pose)] for pose in table.poses[piece, 0].tolist())
        others = (one[piece, 0].tolist() for one in (table.valid, table.gaps))
        yield from zip(table.stamps_ns[piece].tolist(), poses, *others, strict=True)
