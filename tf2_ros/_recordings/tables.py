"""Owns tables of looked-up transforms, and the contents of files that hold one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from io import BytesIO
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike, NDArray

from tf2_py import BufferCore, FrameInfo
from tf2_ros._recordings.problems import needing
from tf2_ros._traffic.chains import chain_between, moving_on, stamps_on
from tf2_ros._traffic.streams import taken

if TYPE_CHECKING:
    from tf2_ros._recordings.hearing import Heard

__all__ = [
    "Table",
    "as_csv",
    "as_npz",
    "as_parquet",
    "as_tum",
    "check_rate",
    "look_up",
    "look_up_chain",
    "look_up_when",
    "times_at_rate",
    "times_of_chain",
]

S = 1_000_000_000
# A stamp of 1970 among those of today is a mistake, and no reason to fill the memory.
MOST_TIMES = 50_000_000
PIECE = 10_000  # rows
TRANSLATION, ROTATION = ("x", "y", "z"), ("qx", "qy", "qz", "qw")


@dataclass(frozen=True)
class Table:
    """
    The pose of one frame in another one at N times.

    :param stamps_ns: int64, shape (N,), nanoseconds.
    :param translations: float64, shape (N, 3), metres; NaN where there is no answer.
    :param rotations: float64, shape (N, 4), x y z w, of length one; likewise.
    :param valid: bool, shape (N,): whether there is an answer.
    """

    stamps_ns: NDArray[np.int64]
    translations: NDArray[np.float64]
    rotations: NDArray[np.float64]
    valid: NDArray[np.bool_]

    def __len__(self) -> int:
        return len(self.stamps_ns)

    def from_first_to_last_answer(self) -> Table:
        """Without the rows before the first answer, and those after the last one."""
        known = np.flatnonzero(self.valid)
        shown = slice(known[0], known[-1] + 1) if len(known) else slice(0)
        return Table(
            self.stamps_ns[shown], self.translations[shown], self.rotations[shown], self.valid[shown]
        )


def look_up(buffer: BufferCore, target: str, source: str, times_ns: ArrayLike) -> Table:
    """
    Look up the pose of ``source`` in ``target`` at each of N times.

    :param times_ns: shape (N,), nanoseconds. 0 is the time 0, not the latest one.
    :raises LookupException: a frame is unknown.
    :raises InvalidArgumentException: a name is invalid.
    """
    stamps_ns = np.asarray(times_ns, np.int64)
    # For tf2, 0 is the latest common time. One nanosecond later, a frame has not moved.
    times = np.where(stamps_ns == 0, 1, stamps_ns)
    translations, rotations = buffer.lookup_transforms(target, source, times, on_missing="nan")
    return Table(stamps_ns, translations, rotations, ~np.isnan(rotations[:, 0]))


def check_rate(hz: float) -> None:
    """ValueError: ``hz`` is not above 0 and finite."""
    if not 0.0 < hz < np.inf:
        raise ValueError(f"a rate must be a number above 0 Hz, not {hz:g}")


def times_at_rate(buffer: BufferCore, target: str, source: str, hz: float) -> NDArray[np.int64]:
    """
    Times at a rate, over the span in which all frames between two frames have data.

    :param hz: above 0.
    :return: int64, shape (N,), nanoseconds; the first is the beginning of the span. Between frames whose
        transforms are all static, the span is that of all frames of the buffer. Empty where there is none.
    :raises TransformException: the frames are unknown or not connected.
    :raises ValueError: ``hz`` is not above 0 and finite, or these are more than 50,000,000 times.
    """
    check_rate(hz)
    frames = buffer.frames()
    chain = _chain(buffer, frames, target, source)
    moving = [frames[name] for name in moving_on(frames, chain)]
    dynamic = [(one.oldest_ns, one.newest_ns) for one in moving or frames.values()]
    spans = [(oldest, newest) for oldest, newest in dynamic if oldest is not None and newest is not None]
    if not spans:
        return np.zeros(0, np.int64)
    oldest, newest = zip(*spans, strict=True)
    begin, end = (max(oldest), min(newest)) if moving else (min(oldest), max(newest))
    if end < begin:
        return np.zeros(0, np.int64)
    count = (end - begin) * hz / S + 1.0
    if count > MOST_TIMES:
        span = f"from {begin / S:.3f} s to {end / S:.3f} s"
        raise ValueError(f"{hz:g} Hz {span} are {count:.0f} times, more than {MOST_TIMES}")
    steps = np.rint(np.arange(int(count)) * S / hz).astype(np.int64)
    times: NDArray[np.int64] = np.minimum(begin + steps, end)
    return times


def times_of_chain(heard: Heard, target: str, source: str) -> NDArray[np.int64]:
    """
    The stamps of all dynamic transforms between two frames of a recording: at these, something was measured.

    :return: int64, shape (N,), nanoseconds, ascending, each once. Where nothing moves between them, one time
        is enough: the stamp of the recording's first transform.
    :raises TransformException: the frames are unknown or not connected.
    """
    frames = heard.buffer.frames()
    chain = _chain(heard.buffer, frames, target, source)
    stamps = stamps_on(heard.records, heard.frames, frames, chain)
    return stamps if len(stamps) else taken(heard.records)["stamp_ns"][:1]


def look_up_chain(heard: Heard, target: str, source: str) -> Table:
    """
    Look up two frames of a recording at :func:`times_of_chain`, from the first answer to the last one.

    Nobody has asked for the times at which a part of the chain had not begun, or had ended.
    """
    times_ns = times_of_chain(heard, target, source)
    return look_up(heard.buffer, target, source, times_ns).from_first_to_last_answer()


def look_up_when(
    heard: Heard, target: str, source: str, times_ns: ArrayLike | None, rate: float | None
) -> Table:
    """
    Look up two frames of a recording at given times, as :func:`look_up`; at a rate, see
    :func:`times_at_rate`; or, where both are None, by :func:`look_up_chain`.
    """
    if rate is not None:
        times_ns = times_at_rate(heard.buffer, target, source, rate)
    if times_ns is not None:
        return look_up(heard.buffer, target, source, times_ns)
    return look_up_chain(heard, target, source)


# The contents of files.


def as_csv(table: Table) -> bytes:
    """
    Comma-separated values, with a line of names.

    ``stamp_ns`` is in nanoseconds, ``valid`` is true or false; numbers are nan where it is false.
    """
    names = ",".join(("stamp_ns", *TRANSLATION, *ROTATION, "valid"))
    rows = (
        f"{stamp},{','.join(map(repr, numbers))},{'true' if valid else 'false'}"
        for stamp, numbers, valid in _rows(table)
    )
    return _text([names], rows)


def as_tum(table: Table) -> bytes:
    """
    The format of the TUM RGB-D benchmark: lines of stamp (seconds) x y z qx qy qz qw.

    It has no way to say that there is no answer: such rows are left out.
    """
    return _text(
        f"{_seconds(stamp)} {' '.join(map(repr, numbers))}" for stamp, numbers, valid in _rows(table) if valid
    )


def as_npz(table: Table) -> bytes:
    """NumPy's format of several arrays: the fields of :class:`Table`, by their names."""
    written = BytesIO()
    np.savez(
        written,
        stamps_ns=table.stamps_ns,
        translations=table.translations,
        rotations=table.rotations,
        valid=table.valid,
    )
    return written.getvalue()


def as_parquet(table: Table, file: str, metadata: Mapping[bytes, bytes] | None = None) -> bytes:
    """
    Parquet with the columns file, stamp (int64, nanoseconds), x y z, qx qy qz qw (float64) and valid (bool).

    :param file: the recording's name, the same in each row.
    :param metadata: of the file, beside Parquet's own.
    :raises ModuleNotFoundError: pyarrow is not installed.
    """
    with needing("pyarrow", "fleet"):
        import pyarrow
        from pyarrow import parquet
    columns = {
        "file": pyarrow.repeat(pyarrow.scalar(file, pyarrow.string()), len(table)),
        "stamp": table.stamps_ns,
        **dict(zip((*TRANSLATION, *ROTATION), _numbers(table).T.copy(), strict=True)),
        "valid": table.valid,
    }
    written = BytesIO()
    parquet.write_table(pyarrow.table(columns, metadata=metadata), written)
    return written.getvalue()


def _chain(buffer: BufferCore, frames: dict[str, FrameInfo], target: str, source: str) -> list[str]:
    chain = chain_between(frames, target, source)
    if chain is None or not frames.keys() >= {target, source}:
        buffer.lookup_transform_core(target, source, 0)  # raises what is wrong
    return chain or []


def _numbers(table: Table) -> NDArray[np.float64]:
    return np.concatenate((table.translations, table.rotations), axis=1)


def _seconds(stamp_ns: int) -> str:
    # A float would not hold the digits.
    whole, part = divmod(abs(stamp_ns), S)
    return f"{'-' if stamp_ns < 0 else ''}{whole}.{part:09d}"


def _rows(table: Table) -> Iterator[tuple[int, list[float], bool]]:
    # Piece by piece: as objects of Python, millions of rows take several times the memory of their text.
    numbers = _numbers(table)
    for begin in range(0, len(table), PIECE):
        piece = slice(begin, begin + PIECE)
        columns = (table.stamps_ns[piece], numbers[piece], table.valid[piece])
        yield from zip(*(column.tolist() for column in columns), strict=True)


def _text(*parts: Iterable[str]) -> bytes:
    text = BytesIO()
    for lines in parts:
        for line in lines:
            text.write(f"{line}\n".encode())
    return text.getvalue()
