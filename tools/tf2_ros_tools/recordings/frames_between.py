# SPDX-FileCopyrightText: tf2-ros-cython contributors
# SPDX-License-Identifier: BSD-3-Clause
"""Find the moving frames between two frames, which change when a frame gets another parent."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tf2_py import BufferCore, ConnectivityException, ExtrapolationException, History
from tf2_ros_tools.diagnosis.stream_statistics import Records, stamps_of
from tf2_ros_tools.recordings.bag_reader import LAST_NS


class Between(NamedTuple):
    """
    What moves between two frames, in P periods.

    :param begins_ns: int64, shape (P,): when each period begins, ascending. Within a period, no frame that
        leads to the two changes its parent.
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

    def span(self, histories: Mapping[str, History]) -> tuple[int, int] | None:
        """Get the first and the last time at which all that moves has data; None: there is none."""
        begins, ends = self.begins_ns.copy(), np.append(self.begins_ns[1:] - 1, LAST_NS)
        for name, is_between in self.moving.items():
            stamps = histories[name].stamps_ns
            begins[is_between] = np.maximum(begins[is_between], stamps[0])
            ends[is_between] = np.minimum(ends[is_between], stamps[-1])
        known = np.any([*self.moving.values()], axis=0) & (begins <= ends)
        return (int(begins[known].min()), int(ends[known].max())) if known.any() else None

    def counts(self, frame: str, times_ns: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Say whether a frame is between the two at each of N times."""
        return self.moving[frame][self._periods(times_ns)]

    def _periods(self, times_ns: NDArray[np.int64]) -> NDArray[np.intp]:
        return np.maximum(np.searchsorted(self.begins_ns, times_ns, "right") - 1, 0)


def frames_between(buffer: BufferCore, histories: Mapping[str, History], target: str, source: str) -> Between:
    """
    Find the moving frames between two frames of a buffer.

    :param histories: those of the buffer.
    :raises TransformException: the frames are unknown, or never connected.
    """
    begins = _begins(histories, (target, source))
    moving: dict[str, NDArray[np.bool_]] = {}
    connected = np.zeros(len(begins), bool)
    for i, begin_ns in enumerate(begins.tolist()):
        up, down = (_to_root(histories, name, begin_ns) for name in (source, target))
        top = next((name for name in up if name in down), None)
        if top is None:
            continue
        connected[i] = True
        for name in (*up[: up.index(top)], *down[: down.index(top)]):
            if not histories[name].static:
                moving.setdefault(name, np.zeros(len(begins), bool))[i] = True
    try:
        buffer.path(target, source)
    except ExtrapolationException:
        pass  # for tf2, a frame whose newest stamp is 0 has data at any time
    except ConnectivityException:  # at last
        if not connected.any():
            raise
    return Between(begins, moving, connected)


def _begins(histories: Mapping[str, History], ends: Iterable[str]) -> NDArray[np.int64]:
    """Get the times at which a frame that some frames were in gets another parent, and the earliest time."""
    begins = [np.array([-LAST_NS])]
    leading = [*ends]
    for name in leading:  # grows
        if name in histories:
            parents = histories[name].parents
            begins.append(histories[name].stamps_ns[1:][parents[1:] != parents[:-1]])
            leading += {*parents.tolist()}.difference(leading)
    return np.unique(np.concatenate(begins))


def _to_root(histories: Mapping[str, History], frame: str, time_ns: int) -> list[str]:
    """Get a frame and its ancestors at a time; in a loop, up to the last frame before one is repeated."""
    path = [frame]
    while (own := histories.get(path[-1])) is not None:
        parent = own.parents[max(int(own.stamps_ns.searchsorted(time_ns, "right")) - 1, 0)]
        if parent in path:
            break
        path.append(parent)
    return path
