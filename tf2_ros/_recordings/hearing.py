"""Owns recordings as a listener would have heard them: a buffer, and who sent which transform when."""

from dataclasses import dataclass
from os import PathLike
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from tf2_py.typing import TimeLike
from tf2_ros._receive.recording import Recording
from tf2_ros._recordings.loading import TOPICS, Topics, fill_buffer, new_buffer, wanted
from tf2_ros._recordings.reading import open_recording

if TYPE_CHECKING:
    from tf2_ros import Buffer

__all__ = ["Heard", "hear"]


@dataclass(frozen=True)
class Heard:
    """
    What a recording holds.

    ``records`` is an array of :data:`tf2_ros._receive.recording.RECORD` in the order of the log times, which
    are its times of reception; its ids are indices into ``frames`` and ``publishers``. A publisher is the
    name of a topic. ``start_ns`` and ``end_ns`` are the first and the last log time of all topics, None where
    there is no message. ``problem`` says what could not be read, or is None.
    """

    buffer: "Buffer"
    records: NDArray[np.void]
    frames: list[str]
    publishers: list[str]
    start_ns: int | None
    end_ns: int | None
    problem: str | None


def hear(
    path: "str | PathLike[str]",
    *,
    topics: Topics = TOPICS,
    partial: bool = False,
    progress: bool | None = None,
    start: TimeLike | None = None,
    end: TimeLike | None = None,
) -> Heard:
    """Read a recording as :func:`tf2_ros.bag.load` does, and note each transform."""
    what = wanted(topics, start, end)
    buffer = new_buffer(None)
    recording = Recording()
    pieces: list[NDArray[np.void]] = []
    with open_recording(path, partial=partial) as recorded:
        fill_buffer(buffer, recorded, what, progress=progress, recording=recording, records=pieces)
    records = np.concatenate([*pieces, recording.take()])
    records = records[np.argsort(records["received_ns"], kind="stable")]
    publishers = [name.decode() for name in recording.publishers()]
    return Heard(
        buffer,
        records,
        recording.frames(),
        publishers,
        recorded.start_ns,
        recorded.end_ns,
        "; ".join(recorded.problems) or None,
    )
