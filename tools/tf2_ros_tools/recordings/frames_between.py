# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Find the moving frames between two frames, which change when a frame gets another parent."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tf2_py import BufferCore, ExtrapolationException, History
from tf2_ros_tools.diagnosis.stream_statistics import Records, stamps_of
from tf2_ros_tools.recordings.bag_reader import LAST_NS

NONE = -1  # no parent


class Between(NamedTuple):
    """
    What moves between two frames, in P periods.

    :param begins_ns: int64, shape (P,): when each period begins, ascending. Within a period, no frame that
        leads to the two changes its parent, and each has data at all times or at none.
    :param moving: by the names of dynamic frames, in which periods they are between the two, bool, shape
        (P,).
    :param connected: in which periods the two are connected, bool, shape (P,).
    """

    begins_ns: NDArray[np.int64]
    moving: dict[str, NDArray[np.bool_]]
    connected: NDArray[np.bool_]

    def stamps(self, records: Records, frames: Sequence[str]) -> NDArray[np.int64]:
        """
        Get the stamps of the recorded transforms that were between the two, in ns, ascending, each once.

        While the two are not connected, those of all frames that ever were count.

        :param frames: names, by the ids in the records.
        """
        kept = [np.zeros(0, np.int64)]
        for name in self.moving:
            own = stamps_of(records, frames, name)
            kept.append(own[self.counts(name, own) | ~self.connected[self._periods(own)]])
        return np.unique(np.concatenate(kept))

    def span(self) -> tuple[int, int] | None:
        """Get the first and the last time at which what moves connects the two; None: it never does."""
        periods = np.flatnonzero(np.any([*self.moving.values()], axis=0) & self.connected)
        if not len(periods):
            return None
        # The two are not connected in the last period, in which nothing that moves has data.
        return int(self.begins_ns[periods[0]]), int(self.begins_ns[periods[-1] + 1]) - 1

    def counts(self, frame: str, times_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Say whether a frame is between the two at each of N times."""
        return self.moving[frame][self._periods(times_ns)]

    def _periods(self, times_ns: NDArray[np.int64]) -> NDArray[np.intp]:
        return np.maximum(np.searchsorted(self.begins_ns, times_ns, "right") - 1, 0)


def frames_between(buffer: BufferCore, histories: Mapping[str, History], target: str, source: str) -> Between:
    """
    Find the moving frames between two frames of a buffer.

    If the two are never connected, but would be if all frames kept their last parents, these frames count.

    :param histories: those of the buffer.
    :raises TransformException: the frames are unknown, or never connected.
    """
    names = _leading(histories, (target, source))
    own = {name: histories[name] for name in names if name in histories}
    begins = _begins(own.values())
    # Which parent each frame has in each period; few combinations occur, even if a parent alternates.
    columns = [_parents_at(one, begins, names) for one in own.values()]
    rows, which = np.unique(np.stack([np.zeros_like(begins), *columns], 1), axis=0, return_inverse=True)
    trees = [
        {name: names[i] for name, i in zip(own, row, strict=True) if i != NONE}
        for row in rows[:, 1:].tolist()
    ]
    paths = [_path(tree, target, source) for tree in trees]
    connected = np.array([path is not None for path in paths])
    if target == source or not connected.any():
        with suppress(ExtrapolationException):
            buffer.path(target, source)
        last = _path({name: one.parents[-1] for name, one in own.items()}, target, source)
        moving = {name: np.ones(len(begins), bool) for name in last or () if not own[name].static}
        return Between(begins, moving, np.zeros(len(begins), bool))
    which = which.reshape(-1)  # NumPy 2.0 keeps the shape of the rows
    between = {name for path in paths for name in path or () if not own[name].static}
    moving = {name: np.array([name in (path or ()) for path in paths])[which] for name in sorted(between)}
    return Between(begins, moving, connected[which])


def _leading(histories: Mapping[str, History], ends: Iterable[str]) -> list[str]:
    """Get some frames, and all in which they ever were."""
    names = dict.fromkeys(ends)
    waiting = [*names]
    while waiting:
        if (own := histories.get(waiting.pop())) is not None:
            new = {*own.parents.tolist()} - names.keys()
            names.update(dict.fromkeys(sorted(new)))
            waiting += new
    return [*names]


def _begins(histories: Iterable[History]) -> NDArray[np.int64]:
    """Get the earliest time, and when the data of frames begins or ends, or their parents change."""
    begins = [np.array([-LAST_NS])]
    for one in histories:
        if not one.static:
            changes = one.stamps_ns[1:][one.parents[1:] != one.parents[:-1]]
            ends = one.stamps_ns[[0, -1]]
            begins += [ends[:1], changes, ends + 1]
    return np.unique(np.concatenate(begins))


def _parents_at(history: History, times_ns: NDArray[np.int64], names: Sequence[str]) -> NDArray[np.int64]:
    """Get the numbers of a frame's parents at N times, int64, shape (N,); NONE where it has no data."""
    numbers = {name: number for number, name in enumerate(names)}
    stamps = history.stamps_ns
    last = np.full(len(times_ns), len(stamps) - 1)
    known = last if history.static else np.maximum(stamps.searchsorted(times_ns, "right") - 1, 0)
    found = np.array([numbers[parent] for parent in history.parents[known].tolist()])
    if stamps[0] < stamps[-1]:  # as in a lookup: the first of several oldest samples, the last of all others
        known = np.where(times_ns == stamps[0], 0, known)
    has_data = history.static | ((stamps[0] <= times_ns) & (times_ns <= stamps[-1]))
    return np.where(has_data, found, NONE)


def _path(parents: Mapping[str, str], target: str, source: str) -> list[str] | None:
    """
    Get the frames whose transforms a lookup needs; None: it has no answer.

    :param parents: that of each frame with data.
    """
    up, down = _ancestors(parents, source, target), _ancestors(parents, target, source)
    if up is None:  # a lookup first goes up from the source
        return None
    if up[-1] == target:
        return up[:-1]
    top = None if down is None else next((name for name in up if name in down), None)
    return None if down is None or top is None else [*up[: up.index(top)], *down[: down.index(top)]]


def _ancestors(parents: Mapping[str, str], frame: str, last: str) -> list[str] | None:
    """Get a frame and its ancestors, up to another frame; None: they are in a loop."""
    path = [frame]
    while path[-1] != last and path[-1] in parents:
        if parents[path[-1]] in path:
            return None
        path.append(parents[path[-1]])
    return path
