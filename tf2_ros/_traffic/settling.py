"""Owns thinning the transforms that arrive late because their publisher has only just been discovered."""

import numpy as np
from numpy.typing import NDArray

__all__ = ["Settling", "replaced"]

S = 1_000_000_000
SETTLING_NS = S // 2

Records = NDArray[np.void]
Mask = NDArray[np.bool_]


class Settling:
    """
    Says what a publisher sends early: in its first half second.

    A middleware delivers together, and late, what was sent while a publisher and a subscriber discovered each
    other; their delays say nothing of the robot. An early transform replaces those before it of its stream,
    so that one stays, and nothing is missing that is sent only once.

    Which records are early does not depend on how they are cut into batches.
    """

    def __init__(self) -> None:
        self._begin_ns: dict[int, int] = {}  # when each publisher was first received
        self._settled: set[int] = set()  # publishers

    def early(self, records: Records) -> Mask:
        """Which of these records are early; all of them are later than those before."""
        publishers, received = records["publisher"], records["received_ns"]
        early = np.zeros(len(records), np.bool_)
        for publisher in {*np.flatnonzero(np.bincount(publishers)).tolist()} - self._settled:
            own = np.flatnonzero(publishers == publisher)
            since_ns = received[own] - self._begin_ns.setdefault(publisher, int(received[own[0]]))
            # Less than 0: the clock has jumped back, and may not reach the end of the half second for long.
            after = np.flatnonzero((since_ns < 0) | (since_ns >= SETTLING_NS))
            if len(after):
                own = own[: after[0]]
                self._settled.add(publisher)
            early[own] = True
        # Neither static transforms nor refused ones have a delay that means anything.
        early[(records["static"] != 0) | (records["refusals"] != 0)] = False
        return early


def replaced(records: Records, early: Mask) -> Mask:
    """Which of the early records another early one of their stream follows."""
    latest_first = np.flatnonzero(early)[::-1]
    chosen = records[latest_first]
    streams = np.stack([chosen[part] for part in ("publisher", "child", "parent")], axis=1)
    _, last = np.unique(streams, axis=0, return_index=True)
    followed = early.copy()
    followed[latest_first[last]] = False
    return followed
